"""Recording of flights: telemetry log and MCAP file, their readers, exports, and deletion of old flights.

These modules write to the folder of flights only, and never delay a flight: a full disk ends the recording,
not the service. They know frames and plan records, but do not make decisions.
"""
