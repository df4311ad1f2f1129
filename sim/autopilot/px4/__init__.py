"""PX4 as measured on 1.17-dev: lists that are switched as a whole, named by a checksum and checked before.

It uses the autopilots' common base and the simulator's mission types, and nothing of ArduPlane.
"""
