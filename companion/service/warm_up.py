"""Every kernel compiled before the first flight: what a flight does, done once beforehand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from companion.config import MissionConfig
from companion.config.models import Goal, ObstacleConfig, RadarConfig
from companion.flight.decision import judge
from companion.flight.flight_state import after_restart, first_state
from companion.flight.flown_track import guidance_of
from companion.flight.list_state import FlownPath
from companion.flight.progress import start_after
from companion.flight.situation import Situation
from companion.frames import direction_from_course
from companion.tasks.plan_maker import Planner, least_threat_request, plan_request
from companion.types.events import Emitter, TrackReport
from companion.types.mission import Mission
from companion.types.state import Ownship
from companion.vehicle.guidance import track_of_circle

NUM_PLANS = 3
GOAL_RADIUS_M = 60.0
LEAD_S = 2.0
AHEAD, ASIDE = 8.0, 15.0  # of goal and vehicles, in turn radii


def warm_up(mission: MissionConfig) -> None:
    """Follow two vehicles, plan, plan anew and for an emergency, and foresee flights: all kernels compile.

    The first plan in flight is then as fast as the others. It is done in a small world around the mission's
    start, of a wall and a radar, in which a plan is found at once: the mission's own may have none. Kernels
    that were compiled before are read from the cache.
    """
    mission = _in_small_world(mission)
    state, planner = first_state(mission, 0.0), Planner(0)
    situation = Situation(state.rules, 0)
    start, speed = mission.start, state.rules.vehicle.airspeed_cruise_m_s
    position = float(start.east_m), float(start.north_m), float(start.up_m)
    own = Ownship(0.0, position, math.radians(start.course_deg), 0.0, speed, speed)
    track_of_circle(guidance_of(state), own, np.array(position), 0.0, LEAD_S)
    for now_s in map(float, range(NUM_PLANS)):
        begin, snapshot = start_after(state, own, LEAD_S), situation.snapshot(now_s)
        world = snapshot.with_known(np.ones_like(snapshot.threats.known))
        world = replace(world, wind_enu_m_s=(now_s, 0.0))  # a flown path is restamped
        plan = planner.plan(plan_request(state, begin, world), lambda: False)
        judge(state, plan, begin)
        if plan.path is not None and plan.reaches_goal:
            flown = FlownPath(plan.path, Mission((), 0, 0), float(plan.path.times_s[-1]))
            state = after_restart(state, flown)
        for emitter, aside in ((Emitter.GROUND, -ASIDE), (Emitter.AIR, ASIDE)):
            situation.observe(_sighting(mission, now_s, emitter, aside), now_s)
        situation.threat_at(own, situation.tracker.tracks(now_s))
    planner.plan(least_threat_request(state, start_after(state, own, LEAD_S), world), lambda: False)


def _in_small_world(mission: MissionConfig) -> MissionConfig:
    """The mission from its start round a wall to a goal in a radar's sight, and whatever the threat there."""
    start, radius = mission.start, float(mission.vehicle.turn_radius_min_m)
    far, height = 2.0 * (AHEAD + ASIDE) * radius, 2.0 * radius
    up = (start.up_m - height, start.up_m + height)
    box = {"east_m": start.east_m, "north_m": start.north_m}
    bounds = {key: (value - far, value + far) for key, value in box.items()} | {"up_m": up}
    wall = ObstacleConfig(
        name="wall", base_m=up[0], top_m=up[1],
        polygon_enu_m=tuple(
            _place(mission, 0.5 * AHEAD + ahead, aside)[:2]
            for ahead, aside in ((0.0, -0.5), (0.1, -0.5), (0.1, 0.5), (0.0, 0.5))
        ),
    )  # fmt: skip
    east, north, _ = _place(mission, AHEAD, 2.0)
    radar = RadarConfig(
        name="radar", east_m=east, north_m=north, up_m=start.up_m, max_threat_radius_m=3.0 * radius
    )
    east, north, level = _place(mission, AHEAD, 0.0)
    goal = Goal(east_m=east, north_m=north, up_m=level, acceptance_radius_m=GOAL_RADIUS_M)
    return mission.model_copy(
        update={
            "goals": (goal,), "obstacles": (wall,), "radars": (radar,), "dynamic_threats": (),
            "bounds": mission.bounds.model_copy(update=bounds),
            "planning": mission.planning.model_copy(update={"threat_level_max": 1.0}),
        }
    )  # fmt: skip


def _place(mission: MissionConfig, ahead: float, aside: float) -> tuple[float, float, float]:
    """A place so many turn radii ahead of the start and to its left."""
    start, radius = mission.start, float(mission.vehicle.turn_radius_min_m)
    direction = direction_from_course(math.radians(start.course_deg))
    along, left = (math.cos(direction), math.sin(direction)), (-math.sin(direction), math.cos(direction))
    east, north = (radius * (ahead * one + aside * other) for one, other in zip(along, left, strict=True))
    return float(start.east_m) + east, float(start.north_m) + north, float(start.up_m)


def _sighting(mission: MissionConfig, stamp_s: float, emitter: Emitter, aside: float) -> TrackReport:
    latitude, longitude, altitude = mission.frame.global_from_local(*_place(mission, AHEAD, aside))
    return TrackReport(
        stamp_s=stamp_s,
        source="warm-up",
        identity=f"warm-up:{emitter.value}",
        emitter=emitter,
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_amsl_m=altitude,
        velocity_enu_m_s=(1.0, 0.0, 0.0),
        position_std_m=None,
    )
