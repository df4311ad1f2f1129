"""One flight: what is known and decided of it, who flies when, and how missions reach the autopilot.

``tasks`` waits and composes; ``state`` decides, without a clock and without the link.
"""
