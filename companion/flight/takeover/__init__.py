"""From the ground to the takeover: what the operator's list comes to, and from when on the service flies.

Decides nothing of a flight that is under way; neither waits nor speaks.
"""
