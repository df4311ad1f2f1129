"""The service as a process, the check of its surroundings before a flight, and the replay of a recorded one.

The only room that reads the environment, opens ports of its own and listens to signals.
"""
