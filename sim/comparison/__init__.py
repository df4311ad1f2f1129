"""Planners of others, on our maps: what they need to know of these, and what comes of it.

Uses the planner's kernels and nothing of the simulator; each library is loaded by what needs it alone.
"""
