"""``companion doctor``: finds problems of the service's surroundings before a flight.

It checks this computer and the autopilot's link, requests parameters and rates, and changes nothing on
either. It knows the requirements of the service, but runs no part of it.
"""
