"""JSBSim fixed-wing software-in-the-loop simulator that stands in for the aircraft.

From the ground up:

- ``aircraft/``, ``fdm``: the small UAV. Its figures are the Aerosonde's of Beard and McLain (source
  and adaptations are named in the aircraft's file), flown from 12.5 to 37.5 m/s equivalent airspeed.
- ``sensors``, ``attitude``, ``guidance``, ``flight``: estimator noise and the control loops.
- ``autopilot``, ``ardupilot`` with ``mission_*``: the MAVLink side, with ArduPlane's own semantics.
- ``roads``, ``pursuer``, ``tracks``: the ground vehicles that pursue it, and how they are reported.
- ``truth``: what really happened. ``simulator`` steps all this; ``faults`` disturbs the link to it;
  ``link`` and ``python -m sim`` put it on a socket.

Airspeeds that the autopilot accepts and reports are equivalent airspeeds, as a pitot tube measures them;
the truth has true airspeeds. Not modelled: take-off and landing, ground contact (the flight counts
as a collision), terrain, stick input (MANUAL and FBWA hold the wings level), avoidance by the
autopilot itself, fence breaches, and failing sensors.
"""
