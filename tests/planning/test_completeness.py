"""How often Safe-RRT fails on random maps that can be solved (paper 4.6: complete in probability only).

A map counts as solvable if a way ``CORRIDOR_M`` from every obstacle joins start and goal; that is
decided by shapely, apart from the planner, and leaves room for turns of 125 m.
"""

import math

import numpy as np
import pytest
from shapely import Point, Polygon
from shapely import box as rectangle
from shapely.ops import unary_union

from companion.planning.solver import solve
from companion.types.threat import Radar
from tests.support.paths import box
from tests.support.worlds import problem, track

SIDE_M = 3000.0
CORRIDOR_M = 70.0
BUDGET = 30_000
START, GOAL = (200.0, 200.0), (2800.0, 2800.0)


def random_map(seed, dimension):
    """Walls and towers, some radars and now and then a vehicle; None where there is no wide way."""
    rng = np.random.default_rng((seed, dimension))
    obstacles, footprints = [], []
    for k in range(int(rng.integers(6, 16))):
        long, short = rng.uniform(200.0, 1100.0), rng.uniform(40.0, 250.0)
        width, depth = (long, short) if rng.random() < 0.5 else (short, long)
        west, south = rng.uniform(0.0, SIDE_M - width), rng.uniform(0.0, SIDE_M - depth)
        footprint = rectangle(west, south, west + width, south + depth)
        if min(footprint.distance(Point(START)), footprint.distance(Point(GOAL))) < 300.0:
            continue
        top = 400.0 if dimension == 2 else rng.uniform(150.0, 400.0)
        obstacles.append(box(f"b{k}", west, south, west + width, south + depth, 0.0, top))
        footprints.append(footprint)
    free = rectangle(0.0, 0.0, SIDE_M, SIDE_M).buffer(-CORRIDOR_M).difference(
        unary_union([f.buffer(CORRIDOR_M) for f in footprints])
    )  # fmt: skip
    parts = free.geoms if hasattr(free, "geoms") else [free]
    if not any(_holds(part, START) and _holds(part, GOAL) for part in parts):
        return None
    coefficient = 0.0 if dimension == 2 else 0.001
    radars = [
        Radar(f"r{k}", (*rng.uniform(600.0, 2400.0, 2), 0.0), rng.uniform(300.0, 700.0), coefficient)
        for k in range(int(rng.integers(0, 3)))
    ]
    tracks = [track(*rng.uniform(800.0, 2200.0, 2), radius=200.0)] if seed % 2 else []
    return obstacles, radars, tracks


def _holds(part: Polygon, point: tuple[float, float]) -> bool:
    return bool(part.contains(Point(point)))


def solvable_maps(dimension, number):
    seed, found = 0, 0
    while found < number:
        made = random_map(seed, dimension)
        if made is not None:
            found += 1
            yield seed, *made
        seed += 1


def failures(dimension, number):
    failed = []
    for seed, obstacles, radars, tracks in solvable_maps(dimension, number):
        asked = problem(
            obstacles, radars, tracks, dimension=dimension, seed=seed,
            bounds=(0.0, SIDE_M, 0.0, SIDE_M, 50.0, 400.0), start=(*START, 150.0), direction=math.pi / 4.0,
            goal=(*GOAL, 150.0 if dimension == 2 else 200.0), max_iterations=BUDGET,
            sensing_horizon_m=750.0, tree_capacity=6000,
        )  # fmt: skip
        if not solve(asked).reaches_goal:
            failed.append(seed)
    return failed


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_of_a_hundred_solvable_maps_at_most_one_is_not_solved(dimension):
    assert len(failures(dimension, 100)) <= 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_first_solvable_maps_are_solved(dimension):
    assert failures(dimension, 8) == []
