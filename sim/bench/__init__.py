"""``companion bench``: how fast the service plans and reacts, and how well it predicts its arrival.

It flies the unchanged service in the simulator, in real time where time is measured.
"""
