"""What a plan takes with other members about: processor time, medians of plans with as many seeds."""

import itertools
import time

import numpy as np

from companion.config import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.config.sections.team_section import TeamConfig
from companion.flight.exchange.team_exchange import PLANNED_SLACK_M
from companion.mission.team.member_tracks import may_come_into, track_of_plan
from companion.mission.team.separation import margin_between
from companion.mission.team.shared_plan import SharedPlan
from companion.mission.team.team_settings import TeamSettings
from companion.planning.solver import solve
from tests.sim.client import CONFIGS

MAPS = ("paper-2d", "paper-3d")
ABOVE_M, APART_M = 500.0, 100.0
NUMS = (0, 1, 10, 50)
START_FREE_M, CIRCLE_M, TRIES_MAX = 400.0, 80.0, 20_000
SEEDS = 12


def others(mission, num, heights_m, team):
    """As many members at the heights in turn, each straight between random places, clear of all before it.

    There may be fewer of them, if there is no room.
    """
    settings = TeamSettings(apart_m=team.apart_m, apart_up_m=team.apart_up_m)
    random, bounds = np.random.default_rng(1), np.array([mission.bounds.east_m, mission.bounds.north_m])
    start = np.array([mission.start.east_m, mission.start.north_m])
    found = []
    for _ in range(TRIES_MAX):
        if len(found) == num:
            break
        begin, end = random.uniform(*bounds.T, (2, 2))
        if np.hypot(*(begin - start)) < START_FREE_M:
            continue
        up, flown_s = heights_m[len(found) % len(heights_m)], np.hypot(*(end - begin)) / 25.0
        rows = np.array([[0.0, *begin, up], [flown_s, *end, up]])
        plan = SharedPlan(len(found) + 2, 0, rows, CIRCLE_M, team.tolerance_m, team.tolerance_up_m)
        if all(margin_between(plan, other, settings, 0.0) >= 0.0 for other in found):
            found.append(plan)
    return found


def tracks_of(mission, plans, team):
    """What the service has the planner know of them."""
    reach_m = team.apart_m + 2.0 * team.tolerance_m + PLANNED_SLACK_M
    up_m = team.paths_apart_up_m
    area = np.array([mission.bounds.east_m, mission.bounds.north_m, mission.bounds.up_m])
    near = [plan for plan in plans if may_come_into(area, plan, reach_m, up_m)]
    return [track_of_plan(plan, 0.0, 0.0, reach_m, up_m) for plan in near]


def cost_ms(mission, tracks, seeds):
    """Median processor time of the plans [ms], and how many reach the goal."""
    world, took_ms, reached = offline_world(mission).with_tracks(0.0, tracks), [], 0
    for seed in seeds:
        problem, began = offline_problem(mission, world, None, seed), time.process_time()
        reached += solve(problem).reaches_goal
        took_ms.append(1e3 * (time.process_time() - began))
    return float(np.median(took_ms)), reached


def lines():
    """A line for each map, heights and number: how many count, the median, and over that of none."""
    team = TeamConfig(members=(1, 2))
    for name, is_pursued, far in itertools.product(MAPS, (True, False), (True, False)):
        mission = load_mission(CONFIGS / f"{name}.yaml")
        up_m, pursuers = float(mission.start.up_m), offline_world(mission).tracks if is_pursued else ()
        heights_m = [up_m + ABOVE_M] if far else [up_m, up_m + APART_M, up_m - APART_M]
        where = f"{name}, {'pursued' if is_pursued else 'alone'}, {'500 m above' if far else 'near'}"
        alone_ms = None
        for num in NUMS:
            tracks = tracks_of(mission, others(mission, num, heights_m, team), team)
            cost_ms(mission, (*pursuers, *tracks), [0])  # Fields of the world are made once.
            took_ms, reached = cost_ms(mission, (*pursuers, *tracks), range(1, SEEDS + 1))
            alone_ms = alone_ms or took_ms
            times, of = took_ms / alone_ms, f"{reached} of {SEEDS} reach the goal"
            yield f"{where}: {num} others, {len(tracks)} count: {took_ms:.0f} ms, {times:.2f} times; {of}"
