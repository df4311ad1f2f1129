"""Simulated moving threats: vehicles that drive around obstacles after the aircraft, and their reports.

They know the truth; the program under test knows only the reports.
"""
