"""The service as a process, the checks before a flight, and the replay of recorded flights.

Only this package reads the environment, opens its own ports and handles signals.
"""
