"""Composes the settings of all layers from a mission file; only this module knows both."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.assurance.check_limits import CheckLimits
from companion.assurance.exposure import Exposure, ExposureModel
from companion.config.models import MissionConfig
from companion.config.sections.terrain_map import ground_heights_of, ground_of
from companion.frames import equivalent_airspeed
from companion.mission.energy_budget import EnergyBudget, budget_of
from companion.mission.glide.landing_choice import LandingPlace, Place
from companion.planning.comparators import Certainty
from companion.planning.problem import GoalRegion
from companion.planning.settings import PlannerSettings, settings_for
from companion.types.state import AutopilotSettings
from companion.world.snapshot import Snapshot, first_snapshot
from companion.world.vehicle.energy import PowerModel, level_power_range
from companion.world.vehicle.glide import GlideModel
from companion.world.vehicle.vehicle_model import VehicleModel

ALTITUDE_TOLERANCE_M = 20.0
HOME_RADIUS_M = 60.0  # Home and rally points name no radius in which to come down.


def start_altitude_m(mission: MissionConfig) -> float:
    """Return the height of the start above mean sea level [m]."""
    return float(mission.origin.altitude_amsl_m) + float(mission.start.up_m)


def measured_airspeed_m_s(mission: MissionConfig, true_airspeed_m_s: float | None = None) -> float:
    """Return a true airspeed as an autopilot measures it: equivalent, at the start's height [m/s].

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    true_airspeed_m_s : float, optional
        By default that of cruise [m/s].
    """
    return equivalent_airspeed(
        true_airspeed_m_s or float(mission.vehicle.airspeed_cruise_m_s), start_altitude_m(mission)
    )


def vehicle_of(mission: MissionConfig) -> VehicleModel:
    """Return the planner's model of the aircraft."""
    vehicle = mission.vehicle
    return VehicleModel(
        airspeed_min_m_s=float(vehicle.airspeed_min_m_s),
        airspeed_max_m_s=float(vehicle.airspeed_max_m_s),
        airspeed_cruise_m_s=float(vehicle.airspeed_cruise_m_s),
        airspeed_fast_m_s=float(vehicle.airspeed_fast_m_s or vehicle.airspeed_max_m_s),
        acceleration_max_m_s2=float(vehicle.acceleration_max_m_s2),
        turn_radius_min_m=float(vehicle.turn_radius_min_m),
        bank_max_rad=math.radians(vehicle.bank_max_deg),
        coordination=float(vehicle.coordination),
        straight_length_min_m=float(vehicle.straight_length_min_m),
        climb_angle_max_rad=math.radians(vehicle.climb_angle_max_deg),
        descent_angle_max_rad=math.radians(vehicle.descent_angle_max_deg),
        penetration_speed_m_s=float(vehicle.penetration_speed_m_s),
        acceleration_std_m_s2=float(vehicle.acceleration_std_m_s2),
        course_rate_std_rad_s=float(vehicle.course_rate_std_rad_s),
        climb_rate_std_rad_s=float(vehicle.climb_rate_std_rad_s),
        position_std_m=float(vehicle.position_std_m),
        altitude_std_m=float(vehicle.altitude_std_m),
        course_std_rad=math.radians(vehicle.course_std_deg),
        climb_std_rad=math.radians(vehicle.climb_std_deg),
    )


def power_model_of(mission: MissionConfig) -> PowerModel | None:
    """Return the model of the aircraft's power; None if the mission file has no section ``energy``."""
    energy, vehicle = mission.energy, mission.vehicle
    if energy is None:
        return None
    slow = float(vehicle.airspeed_cruise_m_s), float(energy.power_cruise_w)
    fastest_m_s = float(vehicle.airspeed_max_m_s)
    low_w, high_w = level_power_range(*slow, fastest_m_s)  # A rounded power may lie a little outside.
    fast = fastest_m_s, min(max(float(energy.power_max_airspeed_w), low_w), high_w)
    return PowerModel.from_level_flight(slow, fast, float(energy.climb_energy_j_m))


def wind_of(mission: MissionConfig) -> tuple[float, float]:
    """Return the velocity of the air in the mission file's weather, east and north [m/s]."""
    speed, wind_from = mission.simulation.wind_speed_m_s, math.radians(mission.simulation.wind_from_deg)
    return -speed * math.sin(wind_from), -speed * math.cos(wind_from)


def energy_budget_of(
    mission: MissionConfig, goals: tuple[GoalRegion, ...], on_board_wh: float | None = None
) -> EnergyBudget | None:
    """Return what is left at each goal, flown straight from the start in the mission file's wind.

    Parameters
    ----------
    mission : MissionConfig
        The mission file; without a section ``energy`` there is no budget, and the result is None.
    goals : tuple of GoalRegion
        Goals in order: the mission file's, or the operator's waypoints.
    on_board_wh : float, optional
        Energy at the start; by default that of a full battery or tank [Wh].
    """
    model, energy, start = power_model_of(mission), mission.energy, mission.start
    if model is None or energy is None:
        return None
    return budget_of(
        (
            (float(start.east_m), float(start.north_m), float(start.up_m)),
            *(goal.position_enu_m for goal in goals),
        ),
        lambda begin, end: model.leg_energy_j(begin, end, vehicle_of(mission), wind_of(mission)),
        on_board_wh=float(energy.capacity_wh) if on_board_wh is None else on_board_wh,
        reserve_wh=float(energy.reserve_wh),
    )


def glide_model_of(mission: MissionConfig) -> GlideModel | None:
    """Return the model of the glide; None if the mission file has no section ``glide``.

    The turns have the bank of the tightest turn at cruise.
    """
    glide, vehicle = mission.glide, mission.vehicle
    if glide is None:
        return None
    share = float(glide.airspeed_m_s / vehicle.airspeed_cruise_m_s)
    return GlideModel(
        float(glide.ratio), float(glide.airspeed_m_s), float(vehicle.turn_radius_min_m) * share**2
    )


def landing_places_of(
    mission: MissionConfig, home_enu_m: Place | None = None, rally_points_enu_m: tuple[Place, ...] = ()
) -> tuple[LandingPlace, ...]:
    """Return the places to come down: the mission file's fields, home, and the rally points.

    Parameters
    ----------
    mission : MissionConfig
        The mission file, with a section ``glide``.
    home_enu_m : tuple of float, optional
        Home; by default the start's place on the ground [m].
    rally_points_enu_m : tuple of tuple of float
        Rally points, at flying height. Their ground is the map's; without one it counts as home's [m].
    """
    ground = ground_heights_of(mission)

    def on_ground(east: float, north: float, flat_m: float) -> Place:
        """Return a place at the height of the map's ground, or at that of flat ground [m]."""
        up = flat_m if ground is None else float(ground.up_m(np.array([[east, north]]))[0])
        return float(east), float(north), up

    fields = () if mission.glide is None else mission.glide.fields
    places = [
        LandingPlace(
            entry.name,
            on_ground(entry.east_m, entry.north_m, float(entry.up_m or 0.0)),
            float(entry.radius_m),
        )
        for entry in fields
    ]
    home = home_enu_m or on_ground(mission.start.east_m, mission.start.north_m, 0.0)
    places.append(LandingPlace("home", home, HOME_RADIUS_M))
    for number, (east, north, _) in enumerate(rally_points_enu_m, 1):
        places.append(LandingPlace(f"rally {number}", on_ground(east, north, home[2]), HOME_RADIUS_M))
    return tuple(places)


def planner_settings_of(mission: MissionConfig, method: str | None = None) -> PlannerSettings:
    """Return the planner's settings for the mission file's method or another."""
    planning = mission.planning
    certainty = Certainty.LITERAL if planning.certainty == "literal" else Certainty.SHIFTED
    settings = settings_for(
        method or planning.method,
        certainty=certainty,
        clearance_min_m=float(planning.clearance_min_m),
        clearance_wanted_m=float(planning.clearance_wanted_m),
        sensing_horizon_m=float(planning.sensing_horizon_m),
        max_iterations=int(planning.max_iterations),
        threat_level_max=float(planning.threat_level_max),
        quality_min=float(planning.quality_min),
    )
    return replace(
        settings,
        seen_max_s=math.inf if planning.seen_max_s is None else float(planning.seen_max_s),
        price_seen=float(planning.price_seen),
        price_pursued=float(planning.price_pursued),
        price_near=float(planning.price_near),
        price_energy=float(planning.price_energy),
        price_collision=float(planning.price_collision),
    )


def bounds_of(mission: MissionConfig) -> tuple[float, float, float, float, float, float]:
    """Return the lowest and highest east, north and up, in this order [m]."""
    east, north, up = mission.bounds.east_m, mission.bounds.north_m, mission.bounds.up_m
    return float(east[0]), float(east[1]), float(north[0]), float(north[1]), float(up[0]), float(up[1])


def world_of(mission: MissionConfig, *, none_known: bool = True) -> Snapshot:
    """Return the first snapshot of the world; with ``none_known`` unlisted radars are still to be sensed."""
    return first_snapshot(
        dimension=mission.dimension,
        unit_m=float(mission.unit_m),
        bounds=bounds_of(mission),
        obstacles=mission.obstacle_list,
        radars=mission.radar_list,
        ground=ground_of(mission),
        none_known=none_known,
    )


def goals_of(mission: MissionConfig) -> tuple[GoalRegion, ...]:
    """Return the goals in order."""
    return tuple(
        GoalRegion((float(g.east_m), float(g.north_m), float(g.up_m)), float(g.acceptance_radius_m))
        for g in mission.goals
    )


def exposure_of(mission: MissionConfig) -> Exposure:
    """Return the model by which the independent check computes threat levels."""
    vehicle = mission.vehicle
    model = ExposureModel(
        airspeed_min_m_s=float(vehicle.airspeed_min_m_s),
        airspeed_max_m_s=float(vehicle.airspeed_max_m_s),
        penetration_speed_m_s=float(vehicle.penetration_speed_m_s),
        is_literal=mission.planning.certainty == "literal",
        is_plane=mission.dimension == 2,
    )
    return Exposure(mission.obstacle_list, bounds_of(mission), model, ground_heights_of(mission))


def vehicle_within(
    mission: MissionConfig, reported: AutopilotSettings, coordination: float | None = None
) -> VehicleModel:
    """Return the planner's model of the aircraft within the autopilot's limits, as far as they are known.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    reported : AutopilotSettings
        Settings of the autopilot.
    coordination : float, optional
        Rate of turn as a share of that of a coordinated turn; by default that of the mission file.
    """
    at_cruise_rad = reported.bank_limit_rad(measured_airspeed_m_s(mission))
    vehicle = vehicle_of(mission)
    vehicle = replace(vehicle, coordination=coordination or vehicle.coordination)
    vehicle = vehicle.with_banks(reported.bank_limit_rad(math.inf), at_cruise_rad)
    if reported.airspeed_max_m_s:
        fast = min(vehicle.airspeed_fast_m_s, reported.airspeed_max_m_s)
        vehicle = replace(vehicle, airspeed_fast_m_s=fast)
    return vehicle.with_rates(reported.climb_rate_max_m_s, reported.sink_rate_max_m_s)


def check_limits_of(mission: MissionConfig, vehicle: VehicleModel | None = None) -> CheckLimits:
    """Return the limits of the independent check; those of the mission file's aircraft if none is given."""
    vehicle = vehicle_of(mission) if vehicle is None else vehicle
    return CheckLimits(
        bounds=bounds_of(mission),
        margin_m=0.5 * float(mission.planning.clearance_min_m),
        deviations=1.0,
        turn_radius_min_m=vehicle.turn_radius_min_m,
        sideways_max_m_s2=vehicle.sideways_max_m_s2,
        straight_length_min_m=vehicle.straight_length_min_m,
        climb_angle_max_rad=vehicle.climb_angle_max_rad,
        descent_angle_max_rad=vehicle.descent_angle_max_rad,
        airspeed_min_m_s=vehicle.airspeed_min_m_s,
        airspeed_max_m_s=vehicle.airspeed_max_m_s,
        acceleration_max_m_s2=vehicle.acceleration_max_m_s2,
        threat_level_max=float(mission.planning.threat_level_max),
        quality_min=float(mission.planning.quality_min),
        altitude_tolerance_m=ALTITUDE_TOLERANCE_M,
    )
