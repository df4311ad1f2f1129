"""The service as a process: start, end, and reports to systemd, Prometheus and the ground station.

Only this folder reads the environment, opens its own ports and handles signals. It composes the flight, but
makes no decisions about it.
"""
