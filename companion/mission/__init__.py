"""Waypoints and mission items: from paths to lists as each autopilot keeps them, and back.

Touches paths and the checker's findings; what is sent to an autopilot is the swap's and the link's business.
"""
