"""Kernels of the objective J: what a row costs, the least cost from anywhere to a goal, the search along it.

Numbers and arrays in, numbers and status codes out; nothing is random.
"""
