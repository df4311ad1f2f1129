"""MAVLink messages: decoding into events, encoding of requests, track messages, streams and our own answers.

These modules do no I/O: callers pass in bytes and clock readings and get events and bytes back. Only the
codec imports pymavlink.
"""
