"""ArduPlane as measured on 4.7-dev: lists that are changed in place and rounded, home in slot 0, jumps.

Knows the autopilots' common base and the simulator's mission types; PX4 and it do not know each other.
"""
