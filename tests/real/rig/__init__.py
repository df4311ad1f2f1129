"""What a flight beside a real autopilot is rigged of: processes, operator, and what stands between."""
