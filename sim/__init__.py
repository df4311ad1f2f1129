"""JSBSim fixed-wing software-in-the-loop simulator that stands in for the aircraft.

- ``vehicle``: the small UAV in JSBSim, its battery, sensors and control loops, and the ground below it. Its
  figures are the Aerosonde's of Beard and McLain (the aircraft's file names source and adaptations); it flies
  from 12.5 to 37.5 m/s equivalent airspeed.
- ``autopilot``: what an ArduPlane or a PX4 makes of missions, modes and commands, over MAVLink.
- ``threats``: ground vehicles that pursue the aircraft, aircraft that pass it, and how both are reported.
- ``team``: several aircraft in one world, and teams of point masses in fast time.
- ``bench``, ``comparison``: measured flights and reactions, and planners of other libraries.

``simulator`` steps one aircraft's world, ``truth`` judges the flight, and ``faults`` disturbs the link to it.
``sitl`` flies it together with the service; ``server`` and ``python -m sim`` put it on a socket.

Airspeeds that the autopilot accepts and reports are equivalent airspeeds, as a pitot tube measures them;
the truth has true airspeeds. Not modelled: wheels (a catapult launches the aircraft, and a touch of the
ground ends the flight as a landing or as a collision), stick input (MANUAL and FBWA hold the wings level),
avoidance by the autopilot itself, fence breaches, and failing sensors other than a position that jumps.
"""
