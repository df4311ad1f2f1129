"""Independent check of every plan and mission, the order of the emergency steps, and encounters with threats.

Plain NumPy and shapely. The package uses no code of the planner, because it would share its mistakes.
"""
