"""Planners that other packages install, found by their entry points and loaded when they are named."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from companion.errors import PlannerError
from companion.frames import FloatArray
from companion.planning.comparators import ANYTIME_METHODS, FLOWN_METHODS, METHODS
from companion.planning.plugins.planner_protocol import PathPlanner
from companion.planning.problem import Problem

GROUP = "safe_rrt_companion.planners"
BUILT_IN = frozenset({*METHODS, *FLOWN_METHODS, *ANYTIME_METHODS})

# What the code of another package raises while it is imported or called, short of errors of its own making:
# those, and whatever ends a process, are not ours to interpret.
FOREIGN_FAULTS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
)


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
        try:
            found: FloatArray | None = self.planner(problem, should_stop)
        except FOREIGN_FAULTS as fault:
            raise PlannerError(self.origin, _told(fault), "a path or None") from fault
        return found


def method_fault(name: str, besides: Sequence[str] = ()) -> str:
    """Return what is expected instead of a method's name; empty if plans can be made by it.

    Names of ours are answered without a look at other packages. A planner of another package is loaded.

    Parameters
    ----------
    name : str
        Name of a method.
    besides : sequence of str
        Names that are valid here and are no planner of ours.
    """
    if name in METHODS or name in besides:
        return ""
    if name in BUILT_IN or not _entries(name):
        return "one of " + ", ".join([*sorted(METHODS), *besides, *installed_names()])
    try:
        installed_planner(name)
    except PlannerError as error:
        return f"a method that can be loaded: {error}"
    return ""


def installed_names() -> list[str]:
    """Return the names of other packages' planners, sorted. A name of ours is never theirs."""
    return sorted({entry.name for entry in _all_entries()} - BUILT_IN)


@functools.cache
def installed_planner(name: str) -> InstalledPlanner:
    """Load the planner of a name, once a process.

    Raises
    ------
    PlannerError
        If no package, or more than one, has a planner of this name; if it cannot be imported, or is not
        called with a problem and a stopping rule.
    """
    entries = [] if name in BUILT_IN else _entries(name)
    if len(entries) != 1:
        origins = "; ".join(map(_origin, entries)) or f"'{name}'"
        raise PlannerError(origins, f"{len(entries)} planners of one name", "one of each name")
    (entry,) = entries
    origin = _origin(entry)
    try:
        loaded = entry.load()
        planner = loaded() if isinstance(loaded, type) else loaded
    except FOREIGN_FAULTS as fault:
        raise PlannerError(origin, _told(fault), "a module that can be imported, with this name") from fault
    if not _takes_two_arguments(planner):
        found = f"{type(planner).__name__} {getattr(planner, '__name__', '')}".rstrip()
        raise PlannerError(origin, found, "what can be called with (problem, should_stop)")
    return InstalledPlanner(cast("PathPlanner", planner), origin)


@functools.cache
def _all_entries() -> tuple[EntryPoint, ...]:
    """Return the entry points of all packages, read once: looking through what is installed takes 10 ms."""
    return tuple(entry_points(group=GROUP))


def _entries(name: str) -> list[EntryPoint]:
    """Return the entry points of a name."""
    return [entry for entry in _all_entries() if entry.name == name]


def _origin(entry: EntryPoint) -> str:
    """Return the distribution of an entry point, and the entry point."""
    source = "no distribution" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    return f"'{entry.name}' of {source} ({entry.value})"


def _told(fault: BaseException) -> str:
    """Return the kind and the first line of a foreign fault."""
    lines = str(fault).splitlines()
    return f"{type(fault).__name__}: {lines[0]}" if lines else type(fault).__name__


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
