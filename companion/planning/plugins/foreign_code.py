"""Code of other packages: found by entry points, loaded when it is named, its faults named with its package.

Foreign code may raise anything. It leaves this module as an error of ours, so that no fault of another
package ends a program that flies.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points

from companion.errors import PluginError


@functools.cache
def entries_of(group: str) -> tuple[EntryPoint, ...]:
    """Return a group's entry points of all packages, read once: looking through all packages takes 10 ms."""
    return tuple(entry_points(group=group))


def named(group: str, name: str) -> list[EntryPoint]:
    """Return the entry points of a name."""
    return [entry for entry in entries_of(group) if entry.name == name]


def the_entry(group: str, name: str, error: type[PluginError]) -> EntryPoint:
    """Return the only entry point of a name.

    Parameters
    ----------
    group : str
        The group of entry points.
    name : str
        Name of one of them.
    error : type
        Kind of the error that is raised.

    Raises
    ------
    PluginError
        If no package, or more than one, has this name.
    """
    entries = named(group, name)
    if len(entries) != 1:
        origins = "; ".join(map(origin_of, entries)) or f"'{name}'"
        raise error(origins, f"{len(entries)} {error.kind}s of one name", "one of each name")
    return entries[0]


def origin_of(entry: EntryPoint) -> str:
    """Return the distribution of an entry point, and the entry point."""
    source = "no distribution" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
    return f"'{entry.name}' of {source} ({entry.value})"


@contextlib.contextmanager
def blamed(origin: str, expected: str, error: type[PluginError]) -> Iterator[None]:
    """Turn whatever foreign code raises, also to end the program, into an error that names its package.

    Parameters
    ----------
    origin : str
        The distribution, its version and the entry point.
    expected : str
        What the code was expected to do.
    error : type
        Kind of the error that is raised.

    Raises
    ------
    PluginError
        If the code fails.
    """
    try:
        yield
    except (Exception, SystemExit) as fault:
        raise error(origin, _summary(fault), expected) from fault


def _summary(fault: BaseException) -> str:
    """Return the kind and the first line of a foreign fault."""
    try:
        lines = str(fault).splitlines()
    except TypeError:  # Its class has a __str__ that returns no text.
        lines = []
    return f"{type(fault).__name__}: {lines[0]}" if lines else type(fault).__name__
