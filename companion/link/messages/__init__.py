"""Messages as events, requests as bytes: codec, telemetry, detections of others, streams, our answers.

Without input or output: bytes and clock readings are passed in, events and bytes are returned. The codec is
the only place that knows pymavlink.
"""
