"""Noise of the aircraft, identified from recorded flights: how it strays, and how well it knows its place.

Reads recordings as the reports do, and asks the planner's own uncertainty model which noise explains them.
"""
