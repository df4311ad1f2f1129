"""Pursuits by an adversary with perfect knowledge, against what the RS estimators say.

The adversary knows the whole path with its times, has the DT's speed, turn radius and RD_max, and drives
the shortest way round the obstacles (a visibility graph at 12 m from the walls) to the place from which it
catches the aircraft earliest. It shares nothing with the estimators but the definition of a capture:
the aircraft within RD_max, in sight. Arcs at corners take their time but no room, to its advantage.
"""

import csv
import itertools
import math
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import shapely
from matplotlib.figure import Figure

from companion.config import load_mission
from companion.config.offline_problem import offline_world
from companion.kernels.aircraft.dubins import distance_to_point
from companion.kernels.arrays import empty_tree
from companion.kernels.printed import reachability as r
from companion.kernels.workspace import reach_scratch
from companion.planning.solver import solve
from companion.types.threat import TrackState
from companion.world.pursuer_trees import threat_trees
from sim.threats.roads import Roads
from tests.sim.client import CONFIGS
from tests.support.worlds import packed, problem

SPEED, RADIUS, TURN = 25.0, 250.0, 15.0
CLEARANCE_M, EYE_M = 12.0, 2.0
BEARINGS, SHARES = 24, (0.97, 0.7, 0.4, 0.0)
ESTIMATORS = {  # which, and whether its tree starts with the corners
    "ExRRT with corners": (r.EX_RRT, True),
    "ExRRT": (r.EX_RRT, False),
    "RRT-Reach": (r.RRT_REACH, False),
    "RRT": (r.RRT, False),
}
EFFORTS = (1, 2, 4, 8, 16)
FIGURES = FilePath("docs/figures")


class Chase:
    """One planned path in one map, with the places from which each of its nodes can be caught.

    ``places`` (M, 2), ``node`` (M,) the node each belongs to.
    """

    def __init__(self, name, seed):
        mission = load_mission(CONFIGS / f"{name}.yaml")
        obstacles, world = mission.obstacle_list, offline_world(mission)
        self.up = float(mission.start.up_m) if mission.dimension == 2 else 150.0
        # Seen from above, every obstacle on a sight line bars it.
        assert all(o.base_m <= 0.0 and o.top_m > self.up for o in obstacles)
        self.ground = self.up if mission.dimension == 2 else 0.0
        goal, start = mission.goals[-1], mission.start
        asked = problem(
            obstacles,
            dimension=2,
            start=(start.east_m, start.north_m, self.up),
            direction=math.radians(90.0 - start.course_deg),
            goal=(goal.east_m, goal.north_m, self.up),
            bounds=(*world.bounds[:4], self.up - 10.0, self.up + 10.0),
            seed=seed,
            sensing_horizon_m=800.0,
            max_iterations=60_000,
            tree_capacity=6000,
        )
        plan = solve(asked)
        assert plan.reaches_goal
        self.points, self.times = plan.path.positions_enu_m, plan.path.times_s
        self.bounds, self.packed = np.array(asked.snapshot.bounds), packed(obstacles, asked.snapshot.bounds)
        west, east, south, north = world.bounds[:4]
        self.roads = Roads(obstacles, (west, south, east, north), CLEARANCE_M)
        self._find_places()

    def _find_places(self):
        reach = math.sqrt(RADIUS**2 - (self.up - self.ground) ** 2)
        angles = np.arange(BEARINGS) * 2.0 * math.pi / BEARINGS
        ring = np.column_stack([np.cos(angles), np.sin(angles)])
        around = np.concatenate([reach * share * ring[: BEARINGS if share else 1] for share in SHARES])
        places = (self.points[:, None, :2] + around).reshape(-1, 2)
        node = np.repeat(np.arange(len(self.points)), len(around))
        b = self.bounds
        good = (
            (places[:, 0] >= b[0]) & (places[:, 0] <= b[1]) & (places[:, 1] >= b[2]) & (places[:, 1] <= b[3])
        )
        good &= self.roads.is_clear(places) & self.sees(places, self.points[node, :2])
        self.places, self.node = places[good], node[good]
        corners = self.roads.corners
        self.from_corners = np.array([self.roads.distances(corner, self.places) for corner in corners])

    def sees(self, here, there):
        """Whether the lines between pairs of places cross no wall, shape (N,)."""
        return ~shapely.intersects(self.roads.walls, shapely.linestrings(np.stack([here, there], axis=1)))

    def random_start(self, rng):
        """A free place and a direction."""
        while True:
            place = rng.uniform(self.bounds[[0, 2]], self.bounds[[1, 3]])
            if self.roads.is_clear(place[None])[0]:
                return place, float(rng.uniform(-math.pi, math.pi))

    def hunt(self, start, heading):
        """The drive that catches the aircraft earliest, as (times, places); None where there is none."""
        to_corner, entry = self.roads.reach(start)
        by_corner = to_corner[:, None] + self.from_corners
        last = np.argmin(by_corner, axis=0)
        lengths = by_corner[last, np.arange(len(last))]
        direct = self.roads.distances(start, self.places)
        shortest = np.minimum(direct, lengths)
        possible = np.flatnonzero(shortest / SPEED <= self.times[self.node])
        for m in possible[np.lexsort((shortest[possible], self.node[possible]))]:
            way = [start]
            if direct[m] > lengths[m]:
                way += [np.array(p) for p in self.roads.way(int(entry[last[m]]), int(last[m]))]
            times, way = driven([*way, self.places[m]], heading)
            if times[-1] <= self.times[self.node[m]]:
                return times, way
        return None

    def threatened(self, drive):
        """Nodes at which the aircraft is within RD_max and in sight of a drive, shape (N,) of bool."""
        times, way = drive
        at = np.column_stack([np.interp(self.times, times, way[:, axis]) for axis in range(2)])
        away = np.hypot(*(at - self.points[:, :2]).T)
        near = np.hypot(away, self.up - self.ground) <= RADIUS
        return near & self.sees(at, self.points[:, :2])

    def estimated(self, start, heading, kind, with_corners, efforts, rng):
        """Nodes that an estimator calls reachable after so many iterations a node, one row an effort."""
        n = len(self.points)
        track = TrackState(
            0.0, "dt", (*start, self.ground), (SPEED * math.cos(heading), SPEED * math.sin(heading), 0.0),
            np.eye(4), SPEED, RADIUS, TURN, False, 0.0,
        )  # fmt: skip
        answers = []
        for effort in efforts:
            trees = threat_trees([track], self.packed, None, tuple(self.bounds), with_corners=with_corners)
            tree = empty_tree(n, 1)
            tree.state[:n, :3], tree.time[:n] = self.points, self.times
            tree.parent[:n] = np.arange(-1, n - 1)
            estimator, scratch = r.Estimator(kind, 0.5, 3), reach_scratch()
            for i in range(n):
                tree.count[0], tree.active[i] = i + 1, 1
                for draws in rng.random((effort, 3)):
                    r.estimate_reachability(
                        tree, trees, i, estimator, self.bounds, draws, self.packed, scratch
                    )
            answers.append(tree.threat_point[:n, 0, 3] > 0.0)
        return np.array(answers)


def driven(way, heading):
    """Arrival times along corners by Dubins lengths, turning towards each leg from the one before."""
    times = [0.0]
    for here, there in itertools.pairwise(way):
        length = distance_to_point(*here, heading, *there, TURN)
        times.append(times[-1] + length / SPEED)
        heading = math.atan2(there[1] - here[1], there[0] - here[0])
    return np.array(times), np.array(way)


@dataclass
class Tally:
    """Counts over pursuits, for one estimator and effort."""

    pursuits: int = 0
    hunts: int = 0  # that caught the aircraft
    surprises: int = 0  # first caught at a node called unreachable
    captures: int = 0  # nodes at which it was caught
    missed: int = 0  # of those, called unreachable
    called: int = 0  # nodes called reachable
    nodes: int = 0

    def row(self, name, effort):
        """The figures of a table."""
        return {
            "estimator": name,
            "iterations per node": effort,
            "pursuits": self.pursuits,
            "with a capture": self.hunts,
            "first capture at a node called unreachable": self.surprises,
            "captures": self.captures,
            "captures at nodes called unreachable": self.missed,
            "missed %": round(100.0 * self.missed / max(self.captures, 1), 2),
            "nodes called reachable %": round(100.0 * self.called / max(self.nodes, 1), 1),
        }


def tallied(chases, num_pursuits, efforts, seed):
    """Run the pursuits; a :class:`Tally` for each (estimator, effort)."""
    rng = np.random.default_rng(seed)
    tallies = {(name, effort): Tally() for name in ESTIMATORS for effort in efforts}
    for number in range(num_pursuits):
        chase = chases[number % len(chases)]
        start, heading = chase.random_start(rng)
        drive = chase.hunt(start, heading)
        caught = np.zeros(len(chase.points), dtype=bool) if drive is None else chase.threatened(drive)
        for name, (kind, with_corners) in ESTIMATORS.items():
            answers = chase.estimated(start, heading, kind, with_corners, efforts, rng)
            for effort, answer in zip(efforts, answers, strict=True):
                tally = tallies[name, effort]
                tally.pursuits += 1
                tally.nodes += len(answer)
                tally.called += int(answer.sum())
                tally.captures += int(caught.sum())
                tally.missed += int((caught & ~answer).sum())
                if caught.any():
                    tally.hunts += 1
                    tally.surprises += int(not answer[np.argmax(caught)])
    return tallies


def maps(num_plans):
    """Paths over both maps of the paper, the second flown low where its obstacles stand."""
    return [Chase(name, seed) for name in ("paper-2d", "paper-3d") for seed in range(1, num_plans + 1)]


def write(tallies, folder=FIGURES):
    """The table as CSV, and the share of missed captures over the effort as a picture."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [tally.row(*key) for key, tally in tallies.items()]
    with (folder / "reachability.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    draw(rows, folder)


def draw(rows, folder):
    """The picture of the table's rows."""
    figure = Figure(figsize=(6.0, 4.0), layout="constrained")
    axes = figure.subplots()
    efforts = sorted({int(row["iterations per node"]) for row in rows})
    for name in ESTIMATORS:
        missed = [float(row["missed %"]) for row in rows if row["estimator"] == name]
        axes.plot(efforts, missed, marker="o", label=name, clip_on=False)
    axes.set_xscale("log", base=2)
    axes.set_xticks(efforts, [str(effort) for effort in efforts])
    axes.set(xlabel="RS iterations a path node", ylabel="captures at nodes called unreachable [%]")
    axes.set_ylim(0.0, 80.0)
    axes.grid(alpha=0.3)
    axes.legend(loc=(0.55, 0.15))
    figure.savefig(folder / "reachability.png", dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    write(tallied(maps(3), 1000, EFFORTS, seed=2026))
