"""From a mission file to the parts of the simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from companion.config import MissionConfig
from companion.types.events import Dialect
from .autopilot.arduplane.arduplane import ArduPlane
from .autopilot.autopilot_parameters import Parameters
from .autopilot.operator_missions import (
    Place,
    ground_of,
    landing_circle,
    mission_over,
    operator_mission,
    px4_operator_mission,
    safe_loiter,
)
from .autopilot.px4.px4 import Px4
from .autopilot.telemetry import Home
from .projection import FastProjection
from .threats.adsb_source import TrackSource
from .threats.pursuers import Pursuers, pursuers_of
from .truth import Truth
from .vehicle.control import TICK_S, Flight
from .vehicle.fdm import FlightDynamics, Start, Weather
from .vehicle.sensors import Sensors
from .vehicle.simulated_battery import SimulatedBattery


@dataclass(slots=True)
class Scenario:
    """The parts of a simulation, ready to be stepped."""

    dynamics: FlightDynamics
    flight: Flight
    autopilot: ArduPlane | Px4
    pursuers: Pursuers
    tracks: TrackSource
    truth: Truth


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
    parameters = Parameters() if dialect is Dialect.ARDUPILOT else Parameters.px4_defaults()
    parameters["AIRSPEED_CRUISE"] = vehicle.airspeed_cruise_m_s
    parameters["AIRSPEED_MIN"] = math.floor(vehicle.airspeed_min_m_s)
    parameters["AIRSPEED_MAX"] = math.ceil(vehicle.airspeed_max_m_s)
    parameters["WP_LOITER_RAD"] = round(vehicle.turn_radius_min_m)
    return parameters


def _battery(
    mission: MissionConfig, parameters: Parameters, dialect: Dialect, drain: float
) -> SimulatedBattery | None:
    """The full battery of a mission with a section ``energy``, and its parameters; None for all others."""
    if mission.energy is None:
        return None
    parameters.add_battery()
    if dialect is Dialect.ARDUPILOT:
        parameters["BATT_CAPACITY"] = round(SimulatedBattery.charge_mah(mission.energy.capacity_wh))
    return SimulatedBattery(float(mission.energy.capacity_wh), drain)


def build(
    mission: MissionConfig,
    seed: int,
    dialect: Dialect,
    *,
    on_ground: bool = False,
    route_enu_m: tuple[Place, ...] = (),
    battery_drain: float = 1.0,
    aircraft: Pursuers = (),
) -> Scenario:
    """Set everything up at the mission's start: airborne, trimmed, flying the operator's mission.

    With ``on_ground`` the aircraft stands below it instead, disarmed and without a mission; with
    ``route_enu_m`` the operator's mission leads over these places. There is a battery if the mission file has
    a section ``energy``; it is drained ``battery_drain`` times as fast as the flight takes. The ``aircraft``
    pass besides the mission's threats.
    """
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
    ground, home_m = ground_of(mission)
    dynamics = FlightDynamics(
        frame, start, _weather(mission), seed=seed, projection=projection,
        lowest_m=0.0 if ground is None else ground.lowest_m,
    )  # fmt: skip
    parameters = _parameters(mission, dialect)
    battery = _battery(mission, parameters, dialect, battery_drain)
    flight = Flight(dynamics, Sensors(sensing, TICK_S), parameters, battery, ground)
    latitude, longitude = projection.degrees(start.east_m, start.north_m)
    home = Home(
        start.east_m, start.north_m, home_m, round(latitude * 1e7), round(longitude * 1e7),
        frame.altitude_amsl_m + home_m,
    )  # fmt: skip
    radius = parameters["WP_LOITER_RAD"]
    place = (start.east_m, start.north_m, start.up_m)
    centre = safe_loiter(mission, place, start.course_rad, ground)
    autopilot: ArduPlane | Px4
    if dialect is Dialect.ARDUPILOT:
        autopilot = plane = ArduPlane(flight, projection, parameters, home)
        items = operator_mission(home, projection, centre, start.up_m - home_m, radius)
        if route_enu_m:
            items = mission_over(items, route_enu_m, place, projection, radius)
        plane.start(items[:1] if on_ground else items, "LOITER" if on_ground else "AUTO")
    else:
        autopilot = px4 = Px4(flight, projection, parameters, home)
        area = mission.bounds.east_m, mission.bounds.north_m
        begins = landing_circle(mission.obstacle_list, area, home, radius)
        items = px4_operator_mission(home, projection, centre, begins, start.up_m - home_m, radius)
        if route_enu_m:
            items = mission_over(items, route_enu_m, place, projection, radius)
        px4.start([] if on_ground else items, "LOITER" if on_ground else "MISSION", 0 if on_ground else 1)
    if on_ground:
        flight.stand(home.up_m)
        autopilot.is_armed = False
    pursuers = [*pursuers_of(mission), *aircraft]
    tracks = TrackSource(autopilot, pursuers, projection, tracking)
    truth = Truth(mission.obstacle_list, _last_goal(mission), ground)
    return Scenario(dynamics, flight, autopilot, pursuers, tracks, truth)


def _last_goal(mission: MissionConfig) -> tuple[float, float, float] | None:
    """Return the last goal [m], if the mission file has any."""
    goals = [(goal.east_m, goal.north_m, goal.up_m) for goal in mission.goals]
    return goals[-1] if goals else None
