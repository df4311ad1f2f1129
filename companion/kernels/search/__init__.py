"""Kernels of every search: an edge's checks, costs and assessment, a tree's growth, the editing of paths.

Numbers and arrays in, numbers and status codes out; what is random is drawn outside and passed in.
"""
