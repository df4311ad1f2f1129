"""Immutable snapshots of the world: obstacles, radars with their shadows, and the pursuers' trees.

The modules convert the world into the kernels' arrays. They use types and kernels only.
"""
