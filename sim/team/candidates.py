"""A simple planner for one of many: straight to the goal, or around, higher, lower, or later."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.mission.team.separation import PackedPlans
from companion.mission.team.shared_plan import SharedPlan, entering_circle
from .scenes import Scene

OFFSETS = (0.0, 0.06, -0.06, 0.15, -0.15, 0.3, -0.3)  # Of the middle of the path, as shares of its length.
TURNS = (0, 1, 2, 4, 8)  # Turns waited in the circle.
# The announced plan has larger tolerances, for what is rounded and left out. A path that is clear by less
# would be refused, again and again.
ROUNDING_M, ROUNDING_UP_M = 5.0, 2.5
LEVEL_M = 100.0  # The last part of a path is at the height of the circle, and longer than its radius.
LEVEL_COST_S = 5.0  # Changing the level once costs as much as this time on the way.


@dataclass(frozen=True, slots=True)
class Circling:
    """An aircraft in its circle, which it flies counter-clockwise.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        East, north, up [m].
    angle_rad : float
        Direction from the centre at time zero, counter-clockwise from east [rad].
    rate_rad_s : float
        How fast that grows [rad/s].
    """

    centre: FloatArray
    angle_rad: float
    rate_rad_s: float

    def passes(self, angle_rad: float, after_s: float) -> float:
        """Return the first time after another at which the aircraft is in a direction from the centre [s]."""
        ahead = (angle_rad - self.angle_rad - self.rate_rad_s * after_s) % (2.0 * math.pi)
        return after_s + ahead / self.rate_rad_s


@dataclass(frozen=True, slots=True)
class CandidatePath:
    """A path to the goal, whenever it is flown.

    Parameters
    ----------
    angle_rad : float
        Direction from the centre in which the circle is left [rad].
    rows : ndarray, shape (M, 4)
        Time after leaving [s], east, north, up [m]: where the circle is left, places on the path, the centre.
    cost_s : float
        What the path costs, as time [s].
    """

    angle_rad: float
    rows: FloatArray
    cost_s: float


def paths_to(scene: Scene, circling: Circling, goal: FloatArray) -> list[CandidatePath]:
    """Return paths to a goal: straight and around, on all levels.

    Parameters
    ----------
    scene : Scene
        The team.
    circling : Circling
        Where the aircraft is.
    goal : ndarray, shape (3,)
        Centre of the circle in which the path ends [m].
    """
    centre, found = circling.centre, []
    across = np.array([centre[1] - goal[1], goal[0] - centre[0]])  # To the left, as long as the path.
    for offset in OFFSETS:
        middle = 0.5 * (centre[:2] + goal[:2]) + offset * across
        towards = middle - centre[:2]
        angle = math.atan2(towards[1], towards[0]) - math.acos(scene.radius_m / math.hypot(*towards))
        exit_m = centre[:2] + scene.radius_m * np.array([math.cos(angle), math.sin(angle)])
        places = np.vstack([exit_m, middle, goal[:2]]) if offset else np.vstack([exit_m, goal[:2]])
        for level in scene.levels_m:
            profile = _with_heights(places, (centre[2], level, goal[2]), scene.climb)
            if profile is not None:
                steps = np.hypot(*np.diff(profile[:, :2], axis=0).T) / scene.speed_m_s
                after = np.concatenate([[0.0], np.cumsum(steps)])
                rows = entering_circle(np.column_stack([after, profile]), scene.radius_m)
                found.append(
                    CandidatePath(angle, rows, rows[-1, 0] + LEVEL_COST_S * abs(level - goal[2]) / 50.0)
                )
    return found


def candidates(circling: Circling, paths: list[CandidatePath], leaves_after_s: float) -> Iterator[FloatArray]:
    """Go through paths and the times at which they can be flown, the one that costs least first.

    Parameters
    ----------
    circling : Circling
        Where the aircraft is.
    paths : list of CandidatePath
        The paths.
    leaves_after_s : float
        The aircraft stays in its circle until then [s].

    Returns
    -------
    iterator of ndarray, each of shape (M, 4)
        Time [s], east, north, up [m] of a path.
    """
    turn_s = 2.0 * math.pi / circling.rate_rad_s
    found = [
        (circling.passes(path.angle_rad, leaves_after_s) + turns * turn_s, path)
        for path in paths
        for turns in TURNS
    ]
    for leaves_s, path in sorted(found, key=lambda each: each[0] + each[1].cost_s):
        yield path.rows + np.array([leaves_s, 0.0, 0.0, 0.0])


def _with_heights(places: FloatArray, ups: tuple[float, float, float], climb: float) -> FloatArray | None:
    """Return ``places`` (M, 2) with heights, (K, 3): a climb, level flight, a descent; None if too short."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(places, axis=0).T))])
    level = along[-1] - LEVEL_M
    begin, end = abs(ups[1] - ups[0]) / climb, level - abs(ups[2] - ups[1]) / climb
    if begin > end:
        return None
    at = np.unique(np.concatenate([along, [begin, end, level]]))
    at = at[np.concatenate([[True], np.diff(at) > 1.0])]
    at[-1] = along[-1]
    bends = [0.0, begin, max(end, begin + 1e-6), level + 1e-5]
    east, north = np.interp(at, along, places[:, 0]), np.interp(at, along, places[:, 1])
    return np.column_stack([east, north, np.interp(at, bends, [ups[0], ups[1], ups[1], ups[2]])])


def first_clear(
    scene: Scene,
    circling: Circling,
    paths: Iterable[FloatArray],
    against: tuple[SharedPlan, ...],
    now_s: float,
) -> SharedPlan | None:
    """Return the first path that keeps clear of others, as a plan that begins now; None if none does.

    Parameters
    ----------
    scene : Scene
        The team.
    circling : Circling
        Where the aircraft is.
    paths : iterable of ndarray, each of shape (M, 4)
        UTC time [s], east, north, up [m] of each path.
    against : tuple of SharedPlan
        The plans of others.
    now_s : float
        UTC time [s].
    """
    packed = PackedPlans(against, scene.settings)
    for path in paths:
        rows = np.vstack([[now_s, *circling.centre], path])
        plan = SharedPlan(
            0, 0, rows, scene.radius_m, scene.tolerance_m + ROUNDING_M, scene.tolerance_up_m + ROUNDING_UP_M,
            first_radius_m=scene.radius_m,
        )  # fmt: skip
        if packed.first_conflict(plan, now_s) is None:
            return plan
    return None
