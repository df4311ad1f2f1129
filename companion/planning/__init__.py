"""Safe-RRT and its strategies: sub goals, search, safety adjustment, optimisation, and how long it may take.

Runs on the kernels, in one immutable snapshot of the world; touches neither the link nor the flight's state.
"""
