"""Planning in flight: when a plan is due, its start, and what follows from it for missions and return paths.

The modules wait, plan and hand over; the tasks call them.
"""
