"""Missions to and from the autopilot: our own transfers, MAVSDK's readings, and what others' transfers tell.

Waits by the clock that it is given and sends by the callable that it is given. The reader is the only place
that knows MAVSDK, and the only one that goes by the computer's clock.
"""
