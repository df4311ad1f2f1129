"""Random maps with boxes and radars, for comparisons with an exact answer."""

import math
from dataclasses import replace

import numpy as np

from companion.planning.comparators import Certainty
from companion.planning.problem import GoalRegion, Problem, StartState, initial_covariances
from companion.planning.settings import settings_for
from companion.types.threat import Obstacle, Radar
from companion.world.snapshot import first_snapshot
from companion.world.vehicle.vehicle_model import VehicleModel
from tests.support.exact_paths import ExactGrid

SIDE = 3000.0
BOUNDS = (0.0, SIDE, 0.0, SIDE, 50.0, 450.0)
CLEAR_ABOUT_ENDS_M = 250.0
MARGIN_M, WANTED_M, GOAL_RADIUS_M = 15.0, 60.0, 60.0
PRICE = 3.0
VEHICLE = VehicleModel()


class RandomMap:
    """A map: up to 18 boxes, two to eight radars, start and goal at opposite corners."""

    def __init__(self, seed, dimension):
        rng = np.random.default_rng(seed)
        self.dimension = dimension
        self.start = (150.0, 150.0, 150.0)
        self.goal = (SIDE - 150.0, SIDE - 150.0, 150.0 if dimension == 2 else 250.0)
        self.obstacles, self.radars = [], []
        for number in range(int(rng.integers(6, 19))):
            width, height = rng.uniform(80.0, 450.0, 2)
            west, south = rng.uniform(0.0, SIDE - width), rng.uniform(0.0, SIDE - height)
            middle, radius = (west + 0.5 * width, south + 0.5 * height), 0.5 * math.hypot(width, height)
            if (
                min(math.dist(middle, end[:2]) for end in (self.start, self.goal))
                < radius + CLEAR_ABOUT_ENDS_M
            ):
                continue
            corners = [(0, 0), (width, 0), (width, height), (0, height)]
            polygon = np.array([(west + dx, south + dy) for dx, dy in corners])
            top = 300.0 if dimension == 2 else float(rng.uniform(100.0, 600.0))
            self.obstacles.append(Obstacle(f"box_{number}", polygon, 0.0, top))
        for number in range(int(rng.integers(2, 9))):
            east, north = (float(value) for value in rng.uniform(200.0, SIDE - 200.0, 2))
            up, boundary = (150.0, 0.0) if dimension == 2 else (0.0, 0.0006)
            reach = float(rng.uniform(400.0, 900.0))
            self.radars.append(Radar(f"radar_{number}", (east, north, up), reach, boundary, True))

    def problem(self, direction_rad=math.pi / 4, **changes):
        snapshot = first_snapshot(
            dimension=self.dimension, unit_m=25.0, bounds=BOUNDS, obstacles=self.obstacles,
            radars=self.radars, none_known=False,
        )  # fmt: skip
        asked = settings_for(
            "safe-rrt", certainty=Certainty.SHIFTED, sensing_horizon_m=800.0, max_iterations=60_000,
            clearance_min_m=MARGIN_M, clearance_wanted_m=WANTED_M,
        )  # fmt: skip
        settings = replace(asked, price_near=PRICE, **{"price_seen": PRICE} | changes)
        start = StartState(
            0.0, self.start, direction_rad, 0.0, VEHICLE.airspeed_cruise_m_s,
            initial_covariances(VEHICLE, 2.0, 2.0), np.zeros((6, 6)),
        )  # fmt: skip
        return Problem(start, (GoalRegion(self.goal, GOAL_RADIUS_M),), snapshot, VEHICLE, settings, 1)

    def exact(self, price_seen=PRICE):
        return ExactGrid(
            self.obstacles, self.radars, BOUNDS, start=self.start, goal=self.goal, margin=MARGIN_M,
            spacing=30.0 if self.dimension == 2 else 60.0, speed=VEHICLE.airspeed_cruise_m_s,
            prices=(price_seen, PRICE, WANTED_M), rise=None if self.dimension == 2 else 10.0,
        )  # fmt: skip
