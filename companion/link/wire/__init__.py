"""Frames and what carries them: transports, cutting frames out of bytes, signatures, telemetry logs.

Knows a frame's header and checksum, and nothing of what messages mean. Sockets, serial lines and the files of
keys and logs are touched here and nowhere else in the link.
"""
