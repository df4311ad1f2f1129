"""Planners that other packages install, found by their entry points and loaded when they are named."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

from companion.errors import PlannerError
from companion.planning.comparators import ANYTIME_METHODS, FLOWN_METHODS, METHODS
from companion.planning.plugins.foreign_code import blamed, entries_of, named, origin_of, the_entry
from companion.planning.plugins.planner_protocol import PathPlanner
from companion.planning.problem import Problem

GROUP = "safe_rrt_companion.planners"
BUILT_IN = frozenset({*METHODS, *FLOWN_METHODS, *ANYTIME_METHODS})


@dataclass(frozen=True, slots=True)
class InstalledPlanner:
    """A planner of another package, loaded.

    Parameters
    ----------
    planner : PathPlanner
        The planner.
    origin : str
        The distribution, its version and the entry point, for errors and for the rows of campaigns.
    """

    planner: PathPlanner
    origin: str

    def states(self, problem: Problem, should_stop: Callable[[], bool]) -> object:
        """Return what the planner returns, unchecked.

        Raises
        ------
        PlannerError
            If the planner fails.
        """
        with blamed(self.origin, "a path or None", PlannerError):
            return self.planner(problem, should_stop)


def method_fault(name: str, others: Sequence[str] = ()) -> str:
    """Return what is expected instead of a method's name; empty if plans can be made by it.

    Names of ours are answered without a look at other packages. A planner of another package is loaded.

    Parameters
    ----------
    name : str
        Name of a method.
    others : sequence of str
        Names that are valid here and are no planner of ours.
    """
    if name in METHODS or name in others:
        return ""
    if name in BUILT_IN or not named(GROUP, name):
        return "one of " + ", ".join([*sorted(METHODS), *others, *installed_names()])
    try:
        installed_planner(name)
    except PlannerError as error:
        return f"a method that can be loaded: {error}"
    return ""


def installed_names() -> list[str]:
    """Return the names of other packages' planners, sorted. A name of ours is never theirs."""
    return sorted({entry.name for entry in entries_of(GROUP)} - BUILT_IN)


@functools.cache
def installed_planner(name: str) -> InstalledPlanner:
    """Load the planner of a name, once a process.

    Raises
    ------
    PlannerError
        If no package, or more than one, has a planner of this name; if it cannot be imported, or is not
        called with a problem and a stopping rule.
    """
    if name in BUILT_IN:
        raise PlannerError(f"'{name}'", "0 planners of one name", "one of each name")
    entry = the_entry(GROUP, name, PlannerError)
    origin = origin_of(entry)
    with blamed(origin, "a module that can be imported, with this name", PlannerError):
        loaded = entry.load()
        planner = loaded() if isinstance(loaded, type) else loaded
    if not _takes_two_arguments(planner):
        found = f"{type(planner).__name__} {getattr(planner, '__name__', '')}".rstrip()
        raise PlannerError(origin, found, "what can be called with (problem, should_stop)")
    return InstalledPlanner(cast("PathPlanner", planner), origin)


def _takes_two_arguments(planner: object) -> bool:
    """Return whether something can be called with two positional arguments, as far as can be seen."""
    if not callable(planner):
        return False
    try:
        inspect.signature(planner).bind(None, None)
    except TypeError:
        return False
    except ValueError:  # A function of a compiled extension shows no signature.
        return True
    return True
