"""MAVLink frames and the transports that carry them: framing, signatures, rate limits and telemetry logs.

This folder knows a frame's header and checksum, but not the meaning of messages. Within the link, sockets,
serial lines, key files and log files are accessed here only.
"""
