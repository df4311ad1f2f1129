"""Monitors that run besides planning: fences, rally points, and the age of everything that is received.

They decide nothing: they apply what they read to the flight's state, and inform the pilot.
"""
