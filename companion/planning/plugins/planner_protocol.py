"""The contract of a planner of another package."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from companion.frames import FloatArray
from companion.planning.problem import Problem


class PathPlanner(Protocol):
    """A planner of another package: a function, or a class whose objects are called.

    An entry point of the group ``safe_rrt_companion.planners`` gives it the name of a method. A class is
    instantiated once a process, without arguments.
    """

    def __call__(self, problem: Problem, should_stop: Callable[[], bool], /) -> FloatArray | None:
        """Search for a path from the problem's start through all goals, in order.

        Equal problems must give equal paths, so a planner draws random numbers from a generator with
        ``problem.seed`` only. It must not change the problem.

        Parameters
        ----------
        problem : Problem
            The start, the goals, the world, the aircraft and the settings. The start's position is east,
            north, up [m], its direction counter-clockwise from east [rad]. ``snapshot.obstacle_list``
            are upright prisms, ``snapshot.picture`` the sighted radars and moving threats,
            ``snapshot.bounds`` the lowest and highest east, north and up [m]. ``vehicle`` has the limits
            of the aircraft, and ``settings.tau_s`` is the time between two rows [s].
        should_stop : callable
            Returns True once the time for planning is over. A planner calls it at least every 10 ms, and
            then returns what it has. In flight nothing else can stop it.

        Returns
        -------
        ndarray, shape (N, 6), or None
            The path: east, north, up [m], direction counter-clockwise from east [rad], climb angle
            [rad] and true airspeed [m/s]. The first row is the start. Two rows are at most one and a half
            steps apart, a step being ``tau_s`` at the faster one's airspeed, and the path turns by at
            most 1 rad between them. A path that ends before the last goal says how far the search got;
            The start alone, or None, says that there is no path.
        """
        ...
