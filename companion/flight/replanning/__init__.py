"""When the service plans, what it plans from, and what it does with a plan: missions and return paths.

The modules wait, plan and hand over; the tasks call them.
"""
