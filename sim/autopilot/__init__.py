"""Simulated autopilots: how ArduPlane and PX4 treat missions, modes and commands, peculiarities included.

They speak MAVLink over given channels and fly the aircraft of ``sim/vehicle``. They share only the data types
of the program under test.
"""
