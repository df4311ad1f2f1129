"""A flight written down while it is flown, and read back: telemetry log, decisions, and the old ones let go.

Writes to the folder of flights alone, and never holds the flight up: a disk that is full ends the recording,
not the service. Knows the link's frames and the planner's records, and nothing of who decides.
"""
