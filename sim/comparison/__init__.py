"""Planners of other libraries on our maps.

It uses the planner's kernels and nothing of the simulator. Each library is loaded only where it is used.
"""
