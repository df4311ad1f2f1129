"""The link to the autopilot: MAVLink, the dialects of both autopilots, mission transfers and MAVSDK.

Bytes come in and events go out. Damaged and impossible data is counted and dropped; it never raises. Only
``wire/transport`` accesses sockets and serial lines.
"""
