"""The problem that a mission file states, for plans without a flight."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.config.compose import goals_of, planner_settings_of, vehicle_of, world_of
from companion.config.models import MissionConfig
from companion.config.rules import rules_of
from companion.errors import ConfigError
from companion.frames import direction_from_course
from companion.planning.comparators import METHODS
from companion.planning.plugins.installed_planners import method_fault
from companion.planning.problem import Problem, StartState, initial_covariances
from companion.types.plan import Plan, PlanStatus
from companion.types.threat import TrackState
from companion.world.snapshot import Snapshot

GOAL_TOLERANCE_M = 1.0  # As in flight, where a path may end this much outside the acceptance radius.


def offline_problem(mission: MissionConfig, snapshot: Snapshot, method: str | None, seed: int) -> Problem:
    """Return the problem the mission file states: from its start, at time 0.

    Raises
    ------
    ConfigError
        If there is no such method.
    """
    name = method or mission.planning.method
    if expected := method_fault(name):
        raise ConfigError(mission.name, None, "method", name, expected)
    vehicle, settings = vehicle_of(mission), planner_settings_of(mission, name)
    world = snapshot if settings.strategies.minds_dts else snapshot.with_tracks(0.0, ())
    east, north = float(mission.start.east_m), float(mission.start.north_m)
    std = float(mission.vehicle.initial_position_std_m)
    start = StartState(
        stamp_s=0.0,
        position_enu_m=(east, north, float(mission.start.up_m)),
        direction_rad=direction_from_course(math.radians(mission.start.course_deg)),
        climb_rad=0.0,
        airspeed_m_s=vehicle.airspeed_cruise_m_s,
        error_covariance=initial_covariances(vehicle, std, std),
        estimate_covariance=np.zeros((6, 6)),
    )
    sensed = world.with_known(world.sensed(east, north, settings.sensing_horizon_m))
    return Problem(start, goals_of(mission), sensed, vehicle, settings, seed)


def offline_world(mission: MissionConfig) -> Snapshot:
    """Return the mission's world at time 0, each moving threat seen standing at its start."""
    tracks = [
        TrackState(
            stamp_s=0.0,
            identity=threat.name,
            position_enu_m=threat.position_enu_m,
            velocity_enu_m_s=(0.0, 0.0, 0.0),
            covariance=np.eye(4),
            speed_max_m_s=threat.speed_m_s,
            max_threat_radius_m=threat.max_threat_radius_m,
            turn_radius_m=threat.turn_radius_m,
            is_airborne=False,
            observed_s=0.0,
        )
        for threat in mission.dynamic_threat_list
    ]
    return world_of(mission).with_tracks(0.0, tracks)


def judged_plan(mission: MissionConfig, problem: Problem, plan: Plan) -> Plan:
    """Return the plan; one of another package's planner is refused if the independent check refuses its path.

    In flight the check judges every path. Offline it is asked for other packages' planners, because nothing
    else knows whether these keep the limits; otherwise a path through a wall would count as a success.

    Parameters
    ----------
    mission : MissionConfig
        The mission, whose limits count.
    problem : Problem
        The problem.
    plan : Plan
        The answer to it.
    """
    if plan.method in METHODS or plan.path is None or not plan.reaches_goal:
        return plan
    goal = problem.goals[-1]
    found = rules_of(mission).checker.check_path(
        plan.path,
        goal_enu_m=goal.position_enu_m,
        acceptance_radius_m=goal.acceptance_radius_m + GOAL_TOLERANCE_M,
        wind_enu_m_s=problem.snapshot.wind_enu_m_s,
        picture=problem.snapshot.picture,
    )
    if not found:
        return plan
    note = f"the check refuses the path: {found[0]} ({len(found)} violations)"
    return replace(plan, status=PlanStatus.REFUSED, notes=(*plan.notes, note))
