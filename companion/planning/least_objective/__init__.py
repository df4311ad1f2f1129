"""Plans of the least objective J, before pursuers and past others; and what is measured of any plan.

Runs on the kernels, in one immutable snapshot of the world; touches neither the link nor the flight's state.
"""
