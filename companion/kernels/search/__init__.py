"""Kernels of the search: the tree and its extensions, sub goals, rewiring, and the editing of paths.

Numbers and arrays in, numbers and status codes out; what is random is drawn outside and passed in.
"""
