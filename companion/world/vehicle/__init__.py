"""What the aircraft can do, and the LQG-MP tables of how well it keeps to a path.

Figures and tables for the kernels; touches nothing that is heard or planned.
"""
