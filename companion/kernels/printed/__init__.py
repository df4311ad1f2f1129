"""Kernels of the paper's own search: sub goals, the tree between them, the choice of a node, and RRT*.

Numbers and arrays in, numbers and status codes out; what is random is drawn outside and passed in.
"""
