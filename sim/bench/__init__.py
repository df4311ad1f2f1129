"""``companion bench``: how fast the service plans and reacts, and how well it knows when it will be where.

Flies the service in the simulator, in real time where time is what is measured; changes nothing of either.
"""
