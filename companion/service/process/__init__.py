"""The service as a process: its start and end, and what it tells systemd, Prometheus and the ground station.

The only folder that reads the environment, opens ports of its own and listens to signals. It composes the
flight, and decides nothing about it.
"""
