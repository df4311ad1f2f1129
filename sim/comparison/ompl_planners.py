"""Planners of the Open Motion Planning Library on our maps: C++ search, compiled judgement of edges.

Python stands between the two: OMPL asks for an edge by a virtual function that its bindings hand to a Python
object, and that makes one call of compiled code. What these steps cost is measured, too.

References
----------
.. [1] Sucan, Moll, Kavraki, "The Open Motion Planning Library", IEEE Robotics & Automation Magazine 19, 2012.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ompl import base, geometric, util

from companion.planning.explore import Exploration
from companion.planning.problem import GoalRegion
from .ompl_edges import Edges, Pose

PLANNERS: dict[str, Callable[[Any], Any]] = {
    "ompl-rrt": geometric.RRT,
    "ompl-rrt-star": geometric.RRTstar,
    "ompl-bit-star": geometric.BITstar,
    "ompl-aorrtc": geometric.AORRTC,
}
GOAL_RING, GOAL_COURSES, RING_SHARE = 8, 8, 0.9
INTERVAL_S = 0.001  # OMPL asks this often whether to stop.
SLICE_S, SLICE_SHARE = (
    0.002,
    0.05,
)  # Resolution of the first path's time: absolute, and as a share of the search so far.
_Typed = Any  # The bindings have no types.


@dataclass(slots=True)
class Asked:
    """Number of calls of Python, and their time [s]."""

    edges: int = 0
    costs: int = 0
    edges_s: float = 0.0
    costs_s: float = 0.0


@dataclass(slots=True)
class Found:
    """Result of a search.

    Parameters
    ----------
    first_s : float or None
        Time of the first path [s].
    poses : dict
        By seconds of search: the best path's poses, or None.
    asked : Asked
        Calls of Python.
    """

    first_s: float | None = None
    poses: dict[float, list[Pose] | None] = field(default_factory=dict)
    asked: Asked = field(default_factory=Asked)


class _Space:
    """OMPL's space of poses: Dubins' in the plane, with a height besides in space."""

    def __init__(self, exploration: Exploration) -> None:
        limits = exploration.limits
        self.dimension = limits.dimension
        self._up = exploration.problem.start.position_enu_m[2]
        flat = base.DubinsStateSpace(limits.r_min)
        bounds = base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, float(limits.bounds[2 * axis]))
            bounds.setHigh(axis, float(limits.bounds[2 * axis + 1]))
        flat.setBounds(bounds)
        self.space: _Typed = flat
        if self.dimension == 3:
            height, heights = base.RealVectorStateSpace(1), base.RealVectorBounds(1)
            heights.setLow(float(limits.bounds[4]))
            heights.setHigh(float(limits.bounds[5]))
            height.setBounds(heights)
            self.space = base.CompoundStateSpace()
            self.space.addSubspace(flat, 1.0)
            self.space.addSubspace(height, 1.0)

    def pose(self, state: _Typed) -> Pose:
        """Return the pose of a state."""
        if self.dimension == 3:
            flat = state[0]
            return flat.getX(), flat.getY(), state[1][0], flat.getYaw()
        return state.getX(), state.getY(), self._up, state.getYaw()

    def write(self, pose: Pose, state: _Typed) -> None:
        """Put a pose into a state."""
        flat = state
        if self.dimension == 3:
            flat = state[0]
            state[1][0] = float(pose[2])
        flat.setX(float(pose[0]))
        flat.setY(float(pose[1]))
        flat.setYaw(math.remainder(float(pose[3]), 2.0 * math.pi))


class _Motions(base.MotionValidator):  # type: ignore[misc]
    """Answers whether an edge can be flown."""

    def __init__(self, information: _Typed, space: _Space, edges: Edges, asked: Asked) -> None:
        super().__init__(information)
        self._space, self._edges, self._asked = space, edges, asked

    def checkMotion(self, first: _Typed, second: _Typed) -> bool:
        began = time.perf_counter()
        is_free = self._edges.is_free(self._space.pose(first), self._space.pose(second))
        self._asked.edges += 1
        self._asked.edges_s += time.perf_counter() - began
        return is_free


class _Costs(base.OptimizationObjective):  # type: ignore[misc]
    """(9) over edges, in metres of straight flight; the lengths that bound it from below stay OMPL's own."""

    def __init__(self, information: _Typed, space: _Space, edges: Edges, asked: Asked) -> None:
        super().__init__(information)
        self._space, self._edges, self._asked = space, edges, asked

    def motionCost(self, first: _Typed, second: _Typed) -> _Typed:
        began = time.perf_counter()
        cost = self._edges.cost(self._space.pose(first), self._space.pose(second)) / self._edges.weight
        self._asked.costs += 1
        self._asked.costs_s += time.perf_counter() - began
        return base.Cost(cost)


def searched(exploration: Exploration, method: str, seed: int, marks_s: tuple[float, ...]) -> Found:
    """Search from a problem's start to its only goal.

    Parameters
    ----------
    exploration : Exploration
        The problem's world and weights; it is not searched itself.
    method : str
        One of :data:`PLANNERS`.
    seed : int
        Seed of OMPL's random numbers; the clock ends the search, so that no two searches are alike.
    marks_s : tuple of float
        Rising times of search after which the best path is noted [s]; the last ends it.
    """
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(seed % 2**32 or 1)
    space, edges, found = _Space(exploration), Edges(exploration), Found()
    information = base.SpaceInformation(space.space)
    motions, costs = (kind(information, space, edges, found.asked) for kind in (_Motions, _Costs))
    information.setMotionValidator(motions)
    information.setStateValidityChecker(base.AllValidStateValidityChecker(information))
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(_start(exploration, space))
    definition.setGoal(_goal(exploration.problem.goals[0], information, space))
    definition.setOptimizationObjective(costs)
    planner = PLANNERS[method](information)
    planner.setProblemDefinition(definition)
    planner.setup()
    spent_s = 0.0
    for mark_s in marks_s:
        while spent_s < mark_s and not (method == "ompl-rrt" and found.first_s is not None):
            began = time.perf_counter()
            slice_s = mark_s - spent_s
            if found.first_s is None:  # Some planners report a path only at the end of a search.
                slice_s = min(slice_s, max(SLICE_S, SLICE_SHARE * spent_s))
            planner.solve(base.timedPlannerTerminationCondition(slice_s, min(slice_s, INTERVAL_S)))
            spent_s += time.perf_counter() - began
            if found.first_s is None and definition.hasExactSolution():
                found.first_s = spent_s
        found.poses[mark_s] = _poses(definition, space) if definition.hasExactSolution() else None
    return found


def _start(exploration: Exploration, space: _Space) -> _Typed:
    state = space.space.allocState()
    start = exploration.problem.start
    space.write((*start.position_enu_m, start.direction_rad), state)
    return state


def _goal(goal: GoalRegion, information: _Typed, space: _Space) -> _Typed:
    """Poses in the goal region, in eight directions each: its middle, and places near its rim."""
    states = base.GoalStates(information)
    east, north, up = goal.position_enu_m
    ring = np.arange(GOAL_RING) * 2.0 * math.pi / GOAL_RING
    radius = RING_SHARE * goal.acceptance_radius_m
    places = [(east, north)] + [(east + radius * math.cos(at), north + radius * math.sin(at)) for at in ring]
    for x, y in places:
        for course in np.arange(GOAL_COURSES) * 2.0 * math.pi / GOAL_COURSES:
            state = space.space.allocState()
            space.write((x, y, up, float(course)), state)
            states.addState(state)
    return states


def _poses(definition: _Typed, space: _Space) -> list[Pose]:
    """Poses of the best path so far."""
    return [space.pose(state) for state in definition.getSolutionPath().getStates()]
