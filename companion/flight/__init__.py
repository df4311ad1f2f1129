"""One flight: its state, the decisions about it, and the exchange of missions with the autopilot.

``tasks`` waits and composes; ``state`` decides, without a clock and without the link.
"""
