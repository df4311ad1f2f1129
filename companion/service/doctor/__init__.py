"""``companion doctor``: what would keep the service from working, found before a flight.

Looks at this computer and at the autopilot's link, asks for parameters and rates, and changes nothing on
either. It knows what the service needs, and runs none of it.
"""
