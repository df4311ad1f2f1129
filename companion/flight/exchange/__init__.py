"""The exchange with the autopilot: reading its list, storing, verifying and entering a mission.

The modules talk to the autopilot through the link, and apply what they learn to the flight's state.
"""
