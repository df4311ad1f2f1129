"""Kernels of how the aircraft moves: one extension, Dubins paths, and the uncertainty along them.

Numbers and arrays in, numbers and status codes out; numpy, math and numba only, no chance and no clock.
"""
