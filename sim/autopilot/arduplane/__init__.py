"""ArduPlane as measured on 4.7-dev: lists that are changed in place and rounded, home in slot 0, jumps.

It uses the autopilots' common base and the simulator's mission types, and nothing of PX4.
"""
