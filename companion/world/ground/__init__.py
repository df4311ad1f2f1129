"""Heights of the ground: from files or generated, as the planner's cells, and as served to the autopilot.

The modules use types and kernels only, and PROJ and rasterio.
"""
