"""Compare what a mission file asks of the aircraft with what the autopilot's parameters allow."""

from __future__ import annotations

import math

import numpy as np

from companion.config import MissionConfig
from companion.config.compose import measured_airspeed_m_s, vehicle_within
from companion.config.sections.terrain_map import ground_heights_of
from companion.types.state import AutopilotSettings

FENCE_HEIGHT, FENCE_CIRCLE = 1, 2  # Bits of ArduPlane's FENCE_TYPE.
TOLERANCE = 1.02  # Relative tolerance, because some parameters are whole numbers.


def shortfalls(
    mission: MissionConfig,
    settings: AutopilotSettings,
    home_enu_m: tuple[float, float, float] | None = None,
    *,
    flies_by: bool = True,
) -> tuple[str, ...]:
    """Return what the mission file asks for and the autopilot does not do, each with the two numbers.

    A mission with any shortfall is not taken over.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    settings : AutopilotSettings
        The autopilot's parameters; parameters that were not read cause no shortfall.
    home_enu_m : tuple of float, optional
        Home: east, north, up [m]. The fences are about the mission file's start until it is reported.
    flies_by : bool
        Whether the autopilot turns before a waypoint, as ArduPlane does.
    """
    cruise = measured_airspeed_m_s(mission)
    found = []
    if settings.airspeed_min_m_s and cruise * TOLERANCE < settings.airspeed_min_m_s:
        found.append(f"cruise {cruise:.1f} m/s EAS, autopilot at least {settings.airspeed_min_m_s:g}")
    if settings.airspeed_max_m_s and cruise > settings.airspeed_max_m_s * TOLERANCE:
        found.append(f"cruise {cruise:.1f} m/s EAS, autopilot at most {settings.airspeed_max_m_s:g}")
    radius_m = vehicle_within(mission, settings).turn_radius_min_m
    horizon_m = float(mission.planning.sensing_horizon_m)
    if 2.0 * radius_m >= horizon_m:
        found.append(f"turn radius {radius_m:.0f} m, sensing horizon {horizon_m:g}")
    if settings.height_offset_m:
        found.append(f"ALT_OFFSET {settings.height_offset_m:g}: must be 0")
    if settings.passing_max_m:
        found.append(f"WP_MAX_RADIUS {settings.passing_max_m:g}: must be 0")
    found += _beyond_fences(mission, settings, home_enu_m)
    return (
        *found,
        *_no_heights_over_ground(mission, settings, flies_by),
        *_other_ground(mission, home_enu_m),
    )


def _no_heights_over_ground(mission: MissionConfig, settings: AutopilotSettings, flies_by: bool) -> list[str]:
    """Return why the autopilot keeps no heights over ground, if waypoints ask for that."""
    if mission.terrain is None or mission.terrain.item_frame != "terrain":
        return []
    if not flies_by:  # PX4 answers MAV_MISSION_UNSUPPORTED_FRAME (``mavlink_mission.cpp``).
        return ["item_frame terrain: PX4 has only amsl"]
    return ["item_frame terrain, TERRAIN_ENABLE 0"] if settings.terrain_enable == 0.0 else []


def _other_ground(mission: MissionConfig, home_enu_m: tuple[float, float, float] | None) -> list[str]:
    """Return the heights of home and of the map there if they differ by more than the tolerance."""
    ground, terrain, bounds = ground_heights_of(mission), mission.terrain, mission.bounds
    if ground is None or terrain is None or home_enu_m is None:
        return []
    east, north, up = home_enu_m
    sides = (bounds.east_m, east), (bounds.north_m, north)
    is_mapped = all(low <= at <= high for (low, high), at in sides)
    mapped = float(ground.up_m(np.array([[east, north]]))[0])
    if not is_mapped or abs(mapped - up) <= terrain.home_tolerance_m:
        return []
    sea = mission.frame.altitude_amsl_m
    return [f"home at {up + sea:.0f} m AMSL, map {mapped + sea:.0f}"]


def _beyond_fences(
    mission: MissionConfig, settings: AutopilotSettings, home_enu_m: tuple[float, float, float] | None
) -> list[str]:
    """Return goals beyond the fences that are parameters: height above home, and distance from it."""
    east, north, up = home_enu_m or (float(mission.start.east_m), float(mission.start.north_m), 0.0)
    found = []
    height = settings.fence_limit_m(settings.fence_height_m, FENCE_HEIGHT)
    radius = settings.fence_limit_m(settings.fence_radius_m, FENCE_CIRCLE)
    for number, goal in enumerate(mission.goals, 1):
        if height is not None and goal.up_m - up > height:
            found.append(f"goal {number} at {goal.up_m - up:.0f} m, fence {height:g}")
        away = math.dist((goal.east_m, goal.north_m), (east, north))
        if radius is not None and away > radius:
            found.append(f"goal {number} {away:.0f} m away, fence {radius:g}")
    return found
