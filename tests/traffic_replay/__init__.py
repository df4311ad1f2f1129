"""Recorded tracks of real aircraft, replayed about a flight: what the pilot is told, and what is flown."""
