"""Flights of the service beside a real ArduPlane or PX4, in real time; their binaries are the user's own.

``python -m tests.real`` (``make real``) starts each flight in a process of its own, in a network namespace
where that is possible. Nothing here is part of the quick suite but the tests of what needs no autopilot.
"""
