"""The aircraft from recorded flights: its noise, how well its turns are coordinated, and its power.

The modules read recordings as the reports do. They find the numbers with which the planner's models explain
them.
"""
