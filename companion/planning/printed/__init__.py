"""The paper's own search: sub goals, a tree between them, RRT*, safety adjustment; some methods go by it.

Runs on the kernels, in one immutable snapshot of the world; touches neither the link nor the flight's state.
"""
