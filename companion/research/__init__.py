"""Experiments: campaigns of plans and flights, what their rows say, and noise identified from recordings.

Nothing here runs in a flight.
"""
