"""What the check knows of an aircraft's surroundings: prisms, lines of sight, and the ground.

Plain NumPy, PROJ and shapely; no code of the planner.
"""
