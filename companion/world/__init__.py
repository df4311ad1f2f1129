"""Obstacles, visibility, threats and reachability, in one immutable snapshot."""
