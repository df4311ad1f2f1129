"""Plans become missions: judged, made of waypoints, flown in simulation, and replaced by emergency missions.

Synchronous and without a clock. The modules never use the link.
"""
