"""Waypoints and mission items: from paths to each autopilot's list of items, and back.

The modules use paths and the checker's results. Sending lists to an autopilot is left to `flight.exchange`.
"""
