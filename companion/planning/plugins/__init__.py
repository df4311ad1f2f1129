"""Planners and threat models of other packages: what they must keep, how they are found, what they make.

Only the name of a method leads here. Nothing foreign is imported before such a name is asked for, and a
path from here is judged by the independent check like any other; the checker knows no planner.
"""
