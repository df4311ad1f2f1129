"""Pursuit games: random maps that can be won, proved so by an oracle that shares nothing with the planner.

``python -m tests.games`` finds such maps and flies them; the oracle knows the map, the pursuer and the clock.
"""
