"""From a mission file to everything the simulator is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry import LineString, Point, Polygon

from companion.config import MissionConfig
from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from companion.types.threat import Obstacle
from sim.autopilot.arduplane.arduplane import ArduPlane, home_item
from sim.autopilot.autopilot_parameters import Parameters
from sim.autopilot.base import Autopilot
from sim.autopilot.px4.px4 import Px4
from sim.autopilot.telemetry import Home
from sim.projection import FastProjection
from sim.threats.adsb_source import TrackSource
from sim.threats.pursuer import CLEARANCE_M, Pursuer
from sim.threats.roads import Roads
from sim.truth import Truth
from sim.vehicle.control import TICK_S, Flight
from sim.vehicle.fdm import FlightDynamics, Start, Weather
from sim.vehicle.sensors import Sensors

_AHEAD_M = (400.0, 300.0, 200.0, 500.0)
_BEARINGS_DEG = (0.0, 20.0, -20.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0)
_MARGIN_M = 40.0
_OVERSHOOT_M = 40.0  # a circle entered from its centre is first flown that much wider
_HEIGHT_MARGIN_M = 20.0
_LANDING_M, _PATTERN_HEIGHT_M = 1000.0, 60.0  # from the landing pattern's circle to the runway, and above it


@dataclass(slots=True)
class Scenario:
    """The parts of a simulation, ready to be stepped."""

    dynamics: FlightDynamics
    flight: Flight
    autopilot: Autopilot
    pursuers: list[tuple[str, Pursuer]]
    tracks: TrackSource
    truth: Truth


def safe_loiter(
    obstacles: tuple[Obstacle, ...], start: tuple[float, float, float], course_rad: float, radius_m: float
) -> tuple[float, float]:
    """East and north [m] of a circle near the start that can be flown to and round without hitting anything.

    Straight ahead if that is free; else to either side; else, with obstacles everywhere, where they
    are farthest.
    """
    east, north, up = start
    level = [
        Polygon(entry.polygon_enu_m)
        for entry in obstacles
        if entry.base_m - _HEIGHT_MARGIN_M <= up <= entry.top_m + _HEIGHT_MARGIN_M
    ]
    walls = shapely.unary_union(level)
    best, best_gap = (east, north), -math.inf
    tries = [(bearing, ahead) for bearing in _BEARINGS_DEG for ahead in _AHEAD_M]
    for bearing_deg, ahead_m in [*tries, (0.0, 100.0), (0.0, 0.0)]:
        bearing = course_rad + math.radians(bearing_deg)
        centre = (east + ahead_m * math.sin(bearing), north + ahead_m * math.cos(bearing))
        gap = walls.distance(Point(centre)) - radius_m - _OVERSHOOT_M if level else math.inf
        way = walls.distance(LineString([(east, north), centre])) if level else math.inf
        gap = min(gap, way)
        if gap >= _MARGIN_M:
            return centre
        if gap > best_gap:
            best, best_gap = centre, gap
    return best


def operator_mission(
    home: Home, projection: FastProjection, centre: tuple[float, float], height_m: float, radius_m: float
) -> list[MissionItem]:
    """Make what the operator left in the autopilot: home, a waypoint, a loiter there."""
    latitude, longitude = projection.degrees(*centre)
    place = (round(latitude * 1e7), round(longitude * 1e7), height_m)
    frame = MavFrame.GLOBAL_RELATIVE_ALT
    return [
        home_item(home),
        MissionItem(1, Command.NAV_WAYPOINT, frame, (0.0, 0.0, 0.0, 0.0), *place),
        MissionItem(2, Command.NAV_LOITER_UNLIM, frame, (0.0, 0.0, round(radius_m), 0.0), *place),
    ]


def px4_operator_mission(
    home: Home, projection: FastProjection, centre: tuple[float, float], height_m: float, radius_m: float
) -> list[MissionItem]:
    """Make what the operator left in a PX4: takeoff, a waypoint, a loiter there, and a landing at home."""
    relative, nothing = MavFrame.GLOBAL_RELATIVE_ALT_INT, (0.0, 0.0, 0.0, None)

    def place(east: float, north: float, height: float) -> tuple[int, int, float]:
        latitude, longitude = projection.degrees(east, north)
        return round(latitude * 1e7), round(longitude * 1e7), height

    circle = place(*centre, height_m)
    pattern = place(home.east_m, home.north_m + _LANDING_M, _PATTERN_HEIGHT_M)
    touchdown = place(home.east_m, home.north_m, 0.0)
    return [
        MissionItem(0, Command.NAV_TAKEOFF, relative, nothing, *touchdown[:2], height_m),
        MissionItem(1, Command.NAV_WAYPOINT, relative, nothing, *circle),
        MissionItem(2, Command.NAV_LOITER_UNLIM, relative, (0.0, 0.0, round(radius_m), None), *circle),
        MissionItem(3, Command.DO_LAND_START, MavFrame.MISSION, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0),
        MissionItem(4, Command.NAV_LOITER_TO_ALT, relative, (1.0, round(radius_m), 0.0, 1.0), *pattern),
        MissionItem(5, Command.NAV_LAND, relative, nothing, *touchdown),
    ]


def _weather(mission: MissionConfig) -> Weather:
    simulation = mission.simulation
    wind_from = math.radians(simulation.wind_from_deg)
    return Weather(
        -simulation.wind_speed_m_s * math.sin(wind_from),
        -simulation.wind_speed_m_s * math.cos(wind_from),
        simulation.turbulence,
    )


def _parameters(mission: MissionConfig, dialect: Dialect) -> Parameters:
    vehicle = mission.vehicle
    parameters = Parameters() if dialect is Dialect.ARDUPILOT else Parameters.of_px4()
    parameters["AIRSPEED_CRUISE"] = vehicle.airspeed_cruise_m_s
    parameters["AIRSPEED_MIN"] = math.floor(vehicle.airspeed_min_m_s)
    parameters["AIRSPEED_MAX"] = math.ceil(vehicle.airspeed_max_m_s)
    parameters["WP_LOITER_RAD"] = round(vehicle.turn_radius_min_m)
    return parameters


def _pursuers(mission: MissionConfig) -> list[tuple[str, Pursuer]]:
    bounds = mission.bounds
    box = (bounds.east_m[0], bounds.north_m[0], bounds.east_m[1], bounds.north_m[1])
    moving = [
        entry for entry in mission.dynamic_threats if entry.speed_m_s > 0 and entry.behaviour == "pursue"
    ]
    roads = Roads(mission.obstacle_list if moving else (), box, CLEARANCE_M)
    return [
        (
            entry.name,
            Pursuer(
                roads,
                (float(entry.east_m), float(entry.north_m)),
                float(entry.speed_m_s) if entry.behaviour == "pursue" else 0.0,
                float(entry.turn_radius_m),
            ),
        )
        for entry in mission.dynamic_threats
    ]


def build(mission: MissionConfig, seed: int, dialect: Dialect) -> Scenario:
    """Set everything up at the mission's start: airborne, trimmed, flying the operator's mission."""
    frame = mission.frame
    projection = FastProjection(frame)
    sensing, tracking = (np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2))
    start = Start(
        float(mission.start.east_m),
        float(mission.start.north_m),
        float(mission.start.up_m),
        math.radians(mission.start.course_deg),
        float(mission.vehicle.airspeed_cruise_m_s),
    )
    dynamics = FlightDynamics(frame, start, _weather(mission), seed=seed, projection=projection)
    parameters = _parameters(mission, dialect)
    flight = Flight(dynamics, Sensors(sensing, TICK_S), parameters)
    latitude, longitude = projection.degrees(start.east_m, start.north_m)
    home = Home(
        start.east_m, start.north_m, 0.0, round(latitude * 1e7), round(longitude * 1e7), frame.altitude_amsl_m
    )
    radius = parameters["WP_LOITER_RAD"]
    place = (start.east_m, start.north_m, start.up_m)
    centre = safe_loiter(mission.obstacle_list, place, start.course_rad, radius)
    autopilot: Autopilot
    if dialect is Dialect.ARDUPILOT:
        autopilot = plane = ArduPlane(flight, projection, parameters, home)
        plane.start(operator_mission(home, projection, centre, start.up_m, radius), "AUTO")
    else:
        autopilot = px4 = Px4(flight, projection, parameters, home)
        px4.start(px4_operator_mission(home, projection, centre, start.up_m, radius), "MISSION", 1)
    pursuers = _pursuers(mission)
    tracks = TrackSource(autopilot, pursuers, projection, tracking)
    return Scenario(dynamics, flight, autopilot, pursuers, tracks, Truth(mission.obstacle_list))
