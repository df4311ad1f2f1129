"""Simulated autopilots: what ArduPlane and PX4 make of missions, modes and commands, warts included.

Speaks MAVLink over channels that are passed in, flies the aircraft of ``sim/vehicle``, and shares only the
data types of the program under test.
"""
