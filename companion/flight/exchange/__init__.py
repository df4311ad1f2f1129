"""How a mission gets into the autopilot and is flown: reading its list, storing, verifying and entering.

Speaks to the autopilot by the link's calls, and applies what it finds out to the flight's state.
"""
