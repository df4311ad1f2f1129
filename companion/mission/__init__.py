"""Waypoints, mission items and the verified swap."""
