"""MAVLink: transport, codec, recording, autopilot protocols."""
