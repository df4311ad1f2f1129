"""Kernels of the plane and of space: prisms, lines of sight, radar shadows, grids, ways round obstacles.

Numbers and arrays in, numbers and status codes out; numpy, math and numba only, no chance and no clock.
"""
