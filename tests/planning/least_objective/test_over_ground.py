"""Paths over ground beside an exact grid search, and beside a planner that believes the ground flat."""

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.config.offline_problem import offline_problem, offline_world
from companion.config.sections.terrain_map import posts_of
from companion.planning.solver import solve
from sim.vehicle.true_ground import TrueGround
from tests.ground.ground_flights import LEAST_M, MOST_M, scenario_text
from tests.support.exact_over_ground import (
    ExactGridOverGround,
    hidden_by_ground,
    memberships_over_ground,
)

J_MEDIAN_MOST = 1.15  # over the exact grid's
SEEN_SHARE_MOST = 1.0 / 3.0  # of what is seen of a planner that believes the ground flat
RANGE_TIMES = 2.5  # Radars see over 1,500 to 3,750 m.
PRICE = 3.0


class OverGround:
    """A random mission over ground, all of its radars known, and the exact answer."""

    def __init__(self, seed):
        text = scenario_text(seed, range_times=RANGE_TIMES, is_known=True, has_pursuers=False)
        self.mission = mission_from_text(text, f"ground {seed}")
        self.ups_m = TrueGround(posts_of(self.mission)).ups_m
        self.problem = offline_problem(self.mission, offline_world(self.mission), None, 1)

    def exact(self):
        vehicle, bounds = self.problem.vehicle, self.mission.bounds
        return ExactGridOverGround(
            self.ups_m, self.mission.radar_list, [float(b) for b in (*bounds.east_m, *bounds.north_m)],
            start=self.problem.start.position_enu_m, goal=self.problem.goals[0].position_enu_m,
            limits_m=(LEAST_M, MOST_M), speed=vehicle.airspeed_cruise_m_s, price_seen=PRICE, spacing=62.5,
            slopes=(math.tan(vehicle.climb_angle_max_rad), math.tan(vehicle.descent_angle_max_rad)),
            rise=17.5,
        )  # fmt: skip

    def believed_flat(self):
        """The same flight of a planner that believes the ground everywhere as high as at its highest."""
        flat = self.mission.bounds
        axes = (np.linspace(*(float(bound) for bound in axis), 200) for axis in (flat.east_m, flat.north_m))
        highest = float(self.ups_m(*(axis.ravel() for axis in np.meshgrid(*axes))).max())
        up = 0.5 * (LEAST_M + MOST_M) + highest
        text = {
            "terrain": None, "start": self.mission.start.model_copy(update={"up_m": up}),
            "goals": [self.mission.goals[0].model_copy(update={"up_m": up})],
            "bounds": self.mission.bounds.model_copy(update={"up_m": [highest + LEAST_M, highest + MOST_M]}),
        }  # fmt: skip
        flat = self.mission.model_copy(update=text)
        return offline_problem(flat, offline_world(flat), None, 1)

    def judged(self, path):
        """J of a path and metres seen along it, by the oracle's lines of sight."""
        places = path.positions_enu_m
        seen = memberships_over_ground(places, self.mission.radar_list, self.ups_m)
        lengths, seen = np.linalg.norm(np.diff(places, axis=0), axis=1), 0.5 * (seen[1:] + seen[:-1])
        return float(lengths @ (1.0 + PRICE * seen)) / 25.0, float(lengths @ seen)


# An exact answer takes half a minute.
@pytest.mark.slow
def test_paths_over_ground_are_nearly_as_cheap_as_can_be_and_hide():
    """As without ground, a flight begins as the exact way does, which knows no turning limit."""
    ratios, seen_m, flat_m = [], [], []
    for seed in range(12):
        there = OverGround(seed)
        exact = there.exact()
        start = replace(there.problem.start, direction_rad=exact.direction_rad())
        plan = solve(replace(there.problem, start=start))
        assert plan.reaches_goal, seed
        cost_s, seen = there.judged(plan.path)
        ratios.append(cost_s / exact.least_s)
        seen_m.append(seen)
        flat_m.append(there.judged(solve(there.believed_flat()).path)[1])
        places = plan.path.positions_enu_m
        assert (places[:, 2] - there.ups_m(places[:, 0], places[:, 1])).min() >= LEAST_M
    assert np.median(ratios) <= J_MEDIAN_MOST
    assert sum(seen_m) <= SEEN_SHARE_MOST * sum(flat_m)


def test_the_oracle_flies_over_a_plain_in_a_straight_line():
    exact = ExactGridOverGround(
        lambda east, north: 0.0 * east, [], (0.0, 1000.0, 0.0, 500.0), start=(0.0, 250.0, 100.0),
        goal=(1000.0, 250.0, 100.0), limits_m=(50.0, 150.0), slopes=(0.17, 0.17), speed=25.0,
        price_seen=PRICE, spacing=62.5, rise=50.0,
    )  # fmt: skip
    assert exact.least_s == pytest.approx(1000.0 / 25.0, rel=1e-6)


def test_the_oracle_hides_behind_a_ridge():
    """From 10 m over the plain, a ridge 100 m high and 500 m away hides 190 m at 1,000 m."""
    eye = (0.0, 0.0, 10.0)
    places = np.array([[1000.0, 0.0, 180.0], [1000.0, 0.0, 200.0], [300.0, 0.0, 20.0]])
    hidden = hidden_by_ground(places, eye, lambda east, north: 100.0 * (abs(east - 500.0) <= 20.0))
    assert list(hidden) == [True, False, False]
