"""Obstacles, static threats, their shadows and the pursuers' trees, in one immutable snapshot.

Turns what is known into the kernels' arrays; touches types and kernels, and asks nobody.
"""
