"""The mission that leads an aircraft without thrust to a field: a circle before it, and the landing.

The items are a waypoint, the airspeed, a circle down to the height of the final, and the landing. The mission
is entered at the airspeed: the waypoint before it only makes the items recognisable after a restart. A final
that is due before the circle is flown down is begun by a command that makes the landing current. Without such
a command, the autopilot itself leaves the circle for the landing at the circle's height.

PX4 refuses a landing whose slope, from where its line touches the circle before it, is steeper than
FW_LND_ANG, by default 5°.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.frames import LocalFrame
from companion.mission.glide.landing_choice import LandingChoice, Wind
from companion.mission.waypoints import MissionPart, Waypoints, loiter_item, path_items, speed_item
from companion.types.mission import Command, MissionItem
from companion.types.path import Path

ENTRY_ITEM = 1  # The airspeed: the mission is entered there.
CIRCLE_ITEM, LAND_ITEM = 2, 3
APPROACH_SLOPE = math.tan(math.radians(4.8))  # Slope of PX4's default FW_LND_ANG, less rounding.
HEADING_REQUIRED, EXIT_AT_CENTRE = 1.0, 0.0  # The first and last parameter of NAV_LOITER_TO_ALT.


def glide_waypoints(choice: LandingChoice) -> Waypoints:
    """Return the circle's middle and the field as waypoints, with the circle.

    Parameters
    ----------
    choice : LandingChoice
        The field, and the circle before it.
    """
    east, north, up = choice.approach.centre_enu_m
    ground, radius = choice.place.position_enu_m[2], choice.approach.radius_m
    away = math.dist((east, north), choice.place.position_enu_m[:2])
    tangent = math.sqrt(max(away**2 - radius**2, 0.0))
    centre = np.array([east, north, min(up, ground + APPROACH_SLOPE * tangent)])
    lengths = np.array([math.dist(choice.direct.begin_enu_m[:2], (east, north)), 0.0])
    lengths[1] = lengths[0] + away
    return Waypoints(
        np.array([centre, choice.place.position_enu_m]), lengths, choice.direct.model.airspeed_m_s,
        loiter_centre_enu_m=centre, loiter_radius_m=float(math.ceil(radius)),
    )  # fmt: skip


def glide_part(waypoints: Waypoints, frame: LocalFrame) -> MissionPart:
    """Return the glide as mission items.

    Parameters
    ----------
    waypoints : Waypoints
        As :func:`glide_waypoints` returns them.
    frame : LocalFrame
        The frame of their coordinates.
    """
    circle = loiter_item(waypoints, frame)
    first, speed, last = path_items(waypoints, frame)
    down: MissionItem = replace(
        circle, command=Command.NAV_LOITER_TO_ALT,
        parameters=(HEADING_REQUIRED, waypoints.loiter_radius_m, 0.0, EXIT_AT_CENTRE),
    )  # fmt: skip
    land = replace(last, command=Command.NAV_LAND)
    return MissionPart((first, speed, down, land), speed_item(waypoints, frame), circle, False)


def glide_path(choice: LandingChoice, begin_s: float, wind_enu_m_s: Wind) -> Path:
    """Return the glide to the circle and on to the field as a path.

    Parameters
    ----------
    choice : LandingChoice
        The field, and the circle before it.
    begin_s : float
        Clock reading at the beginning [s].
    wind_enu_m_s : tuple of float
        Velocity of the air, east and north [m/s].
    """
    model = choice.direct.model
    track = choice.to_circle.track(choice.place.position_enu_m[2])
    places = np.vstack([track, [choice.place.position_enu_m]])
    steps = np.diff(places, axis=0)
    keep = np.append(True, np.hypot(steps[:, 0], steps[:, 1]) > 1e-6)
    keep[-1] = True
    places = places[keep]
    steps = np.diff(places, axis=0)
    level = np.hypot(steps[:, 0], steps[:, 1])
    courses = np.arctan2(steps[:, 0], steps[:, 1]) % (2.0 * math.pi)
    climbs = np.arctan2(steps[:, 2], np.maximum(level, 1e-6))
    num = len(places)
    return Path(
        times_s=begin_s + np.append(0.0, np.cumsum(level)) / model.airspeed_m_s,
        positions_enu_m=places,
        courses_rad=np.append(courses, courses[-1:]),
        climb_angles_rad=np.append(climbs, climbs[-1:]),
        speeds_m_s=np.full(num, model.airspeed_m_s),
        position_covariances_m2=np.zeros((num, 3, 3)),
        collision_free=np.ones(num),
        threat_levels=np.zeros(num),
        wind_enu_m_s=wind_enu_m_s,
    )
