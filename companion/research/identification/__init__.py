"""Noise of the aircraft from recorded flights: how far it strays, and how well it knows its position.

It reads recordings as the reports do. It finds the noise with which the planner's uncertainty model explains
them.
"""
