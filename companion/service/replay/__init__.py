"""Replay of a recorded flight with the present code: the same missions, or the first difference.

It reads recordings and runs the flight on their time, with replacements for link and plan timing. It writes
nothing and reaches no autopilot.
"""
