"""The surroundings that the check knows: prisms, lines of sight, and the ground.

Plain NumPy, PROJ and shapely; no code of the planner.
"""
