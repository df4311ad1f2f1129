"""``python -m tests.ground.map_pairs MAP``: paths between random places of a map, beside OMPL's RRT*.

The limits are those with which terrain-navigation [1]_ is shown over Davos: between 50 and 120 m over ground,
turns of 66.67 m, climbs of 0.15 rad. Start and goal lie on circles that keep these heights, as its do. OMPL
searches in the space of Owen's Dubins airplane [2]_. Its bindings take no sampler, so that it draws heights
from the lowest to the highest of the map.

References
----------
.. [1] Lim, Lawrance, Achermann, Stastny, Girod, Siegwart, "Safe low-altitude navigation in steep terrain with
   fixed-wing aerial vehicles", IEEE Robotics and Automation Letters 9, 2024.
.. [2] Owen, Beard, McLain, "Implementing Dubins airplane paths on fixed-wing UAVs", Handbook of Unmanned
   Aerial Vehicles, 2015.
"""

import argparse
import math
import sys
import time
from pathlib import Path
from statistics import median

import numba
import numpy as np
import rasterio
from ompl import base, geometric, util
from pyproj import Transformer

from companion.config import mission_from_text
from companion.config.offline_problem import offline_problem, offline_world
from companion.config.sections.terrain_map import posts_of
from companion.errors import ConfigError
from companion.frames import LocalFrame
from companion.planning.solver import solve
from sim.vehicle.true_ground import TrueGround

TURN_M, CLIMB_RAD, LEAST_M, MOST_M = 66.67, 0.15, 50.0, 120.0
EDGE_M, APART_M = 250.0, 1_500.0
GOAL_COURSES = 16
STEP_M = 10.0  # OMPL looks at its motions so often.
GRID_M = 10.0  # OMPL's ground is bilinear between places so far apart.

MISSION = """
name: pair
dimension: 3
unit_m: 25
origin: {{latitude_deg: {latitude}, longitude_deg: {longitude}, altitude_amsl_m: 0}}
bounds: {{east_m: [{west:.0f}, {east:.0f}], north_m: [{south:.0f}, {north:.0f}], up_m: [0, 9000]}}
start: {{east_m: {a[0]:.1f}, north_m: {a[1]:.1f}, up_m: {a[2]:.1f}, course_deg: {course:.0f}}}
goals:
  - {{east_m: {b[0]:.1f}, north_m: {b[1]:.1f}, up_m: {b[2]:.1f}, acceptance_radius_m: 20}}
vehicle: {{airspeed_min_m_s: 10, airspeed_max_m_s: 22, airspeed_cruise_m_s: 15, acceleration_max_m_s2: 0.5,
  turn_radius_min_m: 66.67, straight_length_min_m: 0, penetration_speed_m_s: 20,
  climb_angle_max_deg: 8.6, descent_angle_max_deg: 8.6}}
planning: {{sensing_horizon_m: 10000, time_horizon_s: 15, total_planning_time_s: 600, clearance_min_m: 10}}
terrain: {{file: "{file}", height_min_m: 50{most}}}
"""


class Map:
    """The ground of a raster file in the local frame, on a grid of its own for OMPL."""

    def __init__(self, file):
        with rasterio.open(file) as source:
            to_degrees = Transformer.from_crs(source.crs, "EPSG:4326", always_xy=True)
            box = source.bounds
            corners = [(x, y) for x in (box.left, box.right) for y in (box.bottom, box.top)]
            middle = to_degrees.transform(0.5 * (box.left + box.right), 0.5 * (box.bottom + box.top))
        self.values = {
            "longitude": middle[0],
            "latitude": middle[1],
            "file": Path(file).resolve(),
            "course": 0.0,
        }
        self.values |= dict.fromkeys("ab", (0.0, 0.0, 8_000.0))
        frame = LocalFrame(middle[1], middle[0], 0.0)
        sides = [frame.local_from_global(*to_degrees.transform(*corner)[::-1], 0.0)[:2] for corner in corners]
        east, north = (sorted(axis) for axis in zip(*sides, strict=True))
        # The second least and greatest: a box within the map, which is turned a little in the local frame.
        self.box = np.array([east[1], east[2], north[1], north[2]]) + 60.0 * np.array([1, -1, 1, -1])
        self.values |= dict(zip(("west", "east", "south", "north"), self.box, strict=True))
        self.ups_m = TrueGround(posts_of(self.mission(is_limited=False))).ups_m
        axes = [np.arange(low, high, GRID_M) for low, high in (self.box[:2], self.box[2:])]
        grid = np.meshgrid(*axes, indexing="ij")
        self.grid_m = self.ups_m(grid[0].ravel(), grid[1].ravel()).reshape(grid[0].shape)

    def mission(self, *, is_limited=True, **values):
        """The mission between two places."""
        most = f", height_max_m: {MOST_M:g}" if is_limited else ""
        return mission_from_text(MISSION.format(**(self.values | values), most=most), "pair")

    def on_circle(self, rng):
        """East, north, up and course of a place on a circle all of which keeps the limits of height."""
        angles = np.linspace(0.0, 2.0 * math.pi, 36)
        while True:
            middle = rng.uniform(self.box[::2] + EDGE_M, self.box[1::2] - EDGE_M)
            ups = self.ups_m(middle[0] + TURN_M * np.sin(angles), middle[1] + TURN_M * np.cos(angles))
            low, high = float(ups.max()) + LEAST_M + 5.0, float(ups.min()) + MOST_M - 5.0
            if low < high:
                at = rng.uniform(0.0, 2.0 * math.pi)
                east, north = middle + TURN_M * np.array([math.sin(at), math.cos(at)])
                return (east, north, 0.5 * (low + high)), (math.degrees(at) + 90.0) % 360.0

    def pair(self, seed):
        """Start, goal, and the course at the start [°]."""
        rng = np.random.default_rng(seed)
        while True:
            (a, course), (b, _) = self.on_circle(rng), self.on_circle(rng)
            if math.dist(a[:2], b[:2]) < APART_M:
                continue
            try:
                self.mission(a=a, b=b, course=course)
                return a, b, course
            except ConfigError:  # The highest ground of a cell is too high for the start or the goal.
                continue


def ours(there, pair, seed):
    """Seconds of a plan, and the places of its path; none if it does not lead to the goal."""
    a, b, course = pair
    mission = there.mission(a=a, b=b, course=course)
    problem = offline_problem(mission, offline_world(mission), None, seed)
    began = time.perf_counter()
    plan = solve(problem)
    took_s = time.perf_counter() - began
    return took_s, plan.path.positions_enu_m if plan.reaches_goal else None


def length_m(places):
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def over_ground_m(there, places):
    """Heights over ground along a path, a metre apart."""
    at = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
    line = np.column_stack([np.interp(np.arange(0.0, at[-1]), at, axis) for axis in places.T])
    return line[:, 2] - there.ups_m(line[:, 0], line[:, 1])


@numba.njit(cache=False)
def ground_at(grid_m, west, south, east, north):
    """Height of the ground between four places of a grid [m]."""
    across, along = (east - west) / GRID_M, (north - south) / GRID_M
    i = min(max(int(across), 0), grid_m.shape[0] - 2)
    j = min(max(int(along), 0), grid_m.shape[1] - 2)
    u, v = across - i, along - j
    low = grid_m[i, j] + u * (grid_m[i + 1, j] - grid_m[i, j])
    high = grid_m[i, j + 1] + u * (grid_m[i + 1, j + 1] - grid_m[i, j + 1])
    return low + v * (high - low)


class Airplane:
    """OMPL's RRT* between two places in the space of a Dubins airplane."""

    def __init__(self, there, pair, seed):
        a, b, course = pair
        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(seed + 1)
        space = base.OwenStateSpace(TURN_M, CLIMB_RAD)
        bounds = base.RealVectorBounds(3)
        heights = float(there.grid_m.min()) + LEAST_M, float(there.grid_m.max()) + MOST_M
        for axis, (low, high) in enumerate((there.box[:2], there.box[2:], heights)):
            bounds.setLow(axis, float(low))
            bounds.setHigh(axis, float(high))
        space.setBounds(bounds)
        space.setLongestValidSegmentFraction(STEP_M / space.getMaximumExtent())
        self._information = base.SpaceInformation(space)
        west, south, grid_m = float(there.box[0]), float(there.box[2]), there.grid_m

        class Heights(base.StateValidityChecker):
            def isValid(self, state):
                over = state[2] - ground_at(grid_m, west, south, state[0], state[1])
                return space.satisfiesBounds(state) and LEAST_M <= over <= MOST_M

        self._heights = Heights(self._information)
        self._information.setStateValidityChecker(self._heights)
        self._information.setMotionValidator(base.OwenMotionValidator(self._information))
        self._information.setup()
        definition = base.ProblemDefinition(self._information)
        definition.addStartState(self._state(space, a, math.radians(90.0 - course)))
        goals = base.GoalStates(self._information)
        for yaw in np.arange(GOAL_COURSES) * 2.0 * math.pi / GOAL_COURSES:
            goals.addState(self._state(space, b, float(yaw)))
        definition.setGoal(goals)
        definition.setOptimizationObjective(base.PathLengthOptimizationObjective(self._information))
        self._planner, self._definition = geometric.RRTstar(self._information), definition
        self._planner.setProblemDefinition(definition)
        self._planner.setup()

    def _state(self, space, place, yaw):
        state = space.allocState()
        for axis in range(3):
            state[axis] = float(place[axis])
        state.setYaw(math.remainder(yaw, 2.0 * math.pi))
        return state

    def length_m(self, seconds):
        """Length of the path after so many more seconds of search; infinite without one."""
        self._planner.solve(base.timedPlannerTerminationCondition(seconds, 0.01))
        return (
            self._definition.getSolutionPath().length() if self._definition.hasExactSolution() else math.inf
        )

    def first_s(self, seconds):
        """Seconds until a path is found; infinite if it takes longer than so many."""
        began = time.perf_counter()
        while (spent := time.perf_counter() - began) < seconds:
            if math.isfinite(self.length_m(0.5)):
                return spent
        return math.inf


def main():
    parser = argparse.ArgumentParser(
        prog="python -m tests.ground.map_pairs", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("map", type=Path, help="raster file of heights, such as a GeoTIFF")
    parser.add_argument("-n", type=int, default=100, help="pairs")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--ompl", type=float, default=1.0, help="seconds of OMPL's search; 0 for none")
    parser.add_argument("--patience", type=float, default=60.0, help="seconds of OMPL where we find no path")
    given = parser.parse_args()
    there, took_s, least_m, lengths, peers = Map(given.map), [], [], [], []
    ours(there, there.pair(given.first_seed), 0)  # Kernels are loaded, the ground is laid out.
    for seed in range(given.first_seed, given.first_seed + given.n):
        pair = there.pair(seed)
        seconds, places = ours(there, pair, seed)
        took_s.append(1e3 * seconds)
        peer = Airplane(there, pair, seed) if given.ompl else None
        if places is None:
            first_s = peer.first_s(given.patience) if peer else math.nan
            say(f"pair {seed}: no path in {seconds:.2f} s; OMPL's first after {first_s:.0f} s")
            continue
        least_m.append(float(over_ground_m(there, places).min()))
        lengths.append(length_m(places))
        peers.append(peer.length_m(given.ompl) if peer else math.inf)
    found = np.isfinite(peers)
    ratios = np.array(lengths)[found] / np.array(peers)[found]
    say(
        f"{len(lengths)} of {given.n} reach the goal; a plan {median(took_s):.0f} ms (median), "
        f"{np.quantile(took_s, 0.95):.0f} ms (95 %); lowest {min(least_m):.1f} m over ground"
    )
    if found.any():
        say(
            f"OMPL's RRT* finds {found.sum()} in {given.ompl:g} s; "
            f"ours are {median(ratios):.3f} times as long (median), {ratios.max():.3f} at most"
        )


def say(text):
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
