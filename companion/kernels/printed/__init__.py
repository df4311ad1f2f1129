"""Kernels of the paper's own operators: sub goals, the tree between them, RRT*, and the pursuers' trees.

Numbers and arrays in, numbers and status codes out; what is random is drawn outside and passed in.
"""
