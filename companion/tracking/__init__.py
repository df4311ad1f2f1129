"""Ownship state and tracks of moving threats."""
