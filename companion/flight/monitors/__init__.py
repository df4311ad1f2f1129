"""Monitors that run in parallel to planning: fences, rally points, and the age of all received data.

They decide nothing: they apply what they read to the flight's state, and inform the pilot.
"""
