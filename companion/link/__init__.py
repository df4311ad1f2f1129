"""Between bytes and events: everything that is known of MAVLink, of both autopilots' dialects and of MAVSDK.

Bytes come in and events go out; what is damaged or cannot be true is counted and dropped, never raised.
Only ``wire/transport`` touches sockets and serial lines.
"""
