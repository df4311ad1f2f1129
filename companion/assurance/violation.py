"""What the checker reports, and how a column of numbers is turned into it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

BoolArray = NDArray[np.bool_]

SOFT_RULES = frozenset({"threat", "quality"})


@dataclass(frozen=True, slots=True)
class Violation:
    """One rule broken at one row; rows of an edge or leg are that of its end."""

    rule: str
    row: int
    value: float
    limit: float
    detail: str

    def __str__(self) -> str:
        return f"row {self.row}: {self.detail}: {self.value:.6g}, limit {self.limit:.6g} ({self.rule})"

    @property
    def in_short(self) -> str:
        """What a pilot reads of it, as "12 m from tower"."""
        words, _, unit = self.detail.rstrip("]").partition(" [")
        value = f"{self.value:.0f} {unit}".rstrip()
        name = words.removeprefix("distance to ")
        return f"{words} {value}" if name == words else f"{value} from {name}"


def listed(
    rule: str,
    rows: NDArray[np.int64],
    broken: BoolArray,
    values: FloatArray,
    limit: float | FloatArray,
    detail: str,
) -> Iterator[Violation]:
    """One violation for every element that is broken.

    Parameters
    ----------
    rule : str
        Name of the rule.
    rows : ndarray, shape (N,)
        Row that each element is reported at.
    broken : ndarray, shape (N,)
        Whether the rule is broken there.
    values : ndarray, shape (N,)
        What was found, in the unit that ``detail`` names.
    limit : float or ndarray, shape (N,)
        What is allowed, in the same unit: one for all, or one for each.
    detail : str
        What the values are, with their unit.
    """
    limits = np.broadcast_to(limit, np.shape(values))
    for index in np.flatnonzero(broken):
        yield Violation(rule, int(rows[index]), float(values[index]), float(limits[index]), detail)


def outside(
    rule: str,
    rows: NDArray[np.int64],
    ready: BoolArray,
    values: FloatArray,
    limits: tuple[float, float],
    *,
    tolerance: float,
    detail: str,
) -> Iterator[Violation]:
    """One violation for every element below or above its limits, where it is ready to be judged.

    Parameters
    ----------
    rule : str
        Name of the rule.
    rows : ndarray, shape (N,)
        Row that each element is reported at.
    ready : ndarray, shape (N,)
        Whether the element is to be judged.
    values : ndarray, shape (N,)
        What was found, in the unit that ``detail`` names.
    limits : tuple of float
        Lowest and highest value allowed, in the same unit.
    tolerance : float
        By how much a value may pass them, in the same unit.
    detail : str
        What the values are, with their unit.
    """
    low, high = limits
    yield from listed(rule, rows, ready & ~(values >= low - tolerance), values, low, f"{detail}, lower")
    yield from listed(rule, rows, ready & ~(values <= high + tolerance), values, high, f"{detail}, upper")


def keeps_hard_constraints(violations: Sequence[Violation]) -> bool:
    """Whether only threat level or quality are past their limits."""
    return all(violation.rule in SOFT_RULES for violation in violations)
