"""The checker's results, and helpers that make them from columns of numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

BoolArray = NDArray[np.bool_]

SOFT_RULES = frozenset({"threat", "quality"})  # An emergency plan may break these rules.


@dataclass(frozen=True, slots=True)
class Violation:
    """A rule that is broken at a row; an edge or a leg counts as the row of its end."""

    rule: str
    row: int
    value: float
    limit: float
    detail: str

    def __str__(self) -> str:
        return f"row {self.row}: {self.detail}: {self.value:.6g}, limit {self.limit:.6g} ({self.rule})"

    @property
    def in_short(self) -> str:
        """The text for the pilot, such as "12 m from tower"."""
        words, _, unit = self.detail.rstrip("]").partition(" [")
        value = f"{self.value:.0f} {unit}".rstrip()
        name = words.removeprefix("distance to ")
        return f"{words} {value}" if name == words else f"{value} from {name}"


def violated(
    rule: str,
    rows: NDArray[np.int64],
    broken: BoolArray,
    values: FloatArray,
    limit: float | FloatArray,
    detail: str,
) -> Iterator[Violation]:
    """Yield one violation for every element that breaks a rule.

    Parameters
    ----------
    rule : str
        Name of the rule.
    rows : ndarray, shape (N,)
        The row under which each element is reported.
    broken : ndarray, shape (N,)
        Whether each element breaks the rule.
    values : ndarray, shape (N,)
        The values, in the unit that ``detail`` names.
    limit : float or ndarray, shape (N,)
        The limit in the same unit: one for all, or one for each.
    detail : str
        Description of the values, with their unit.
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
    """Yield one violation for every judged element below or above its limits.

    Parameters
    ----------
    rule : str
        Name of the rule.
    rows : ndarray, shape (N,)
        The row under which each element is reported.
    ready : ndarray, shape (N,)
        Whether each element is judged.
    values : ndarray, shape (N,)
        The values, in the unit that ``detail`` names.
    limits : tuple of float
        Lowest and highest allowed value, in the same unit.
    tolerance : float
        A value may pass the limits by this much, in the same unit.
    detail : str
        Description of the values, with their unit.
    """
    low, high = limits
    yield from violated(rule, rows, ready & ~(values >= low - tolerance), values, low, f"{detail}, lower")
    yield from violated(rule, rows, ready & ~(values <= high + tolerance), values, high, f"{detail}, upper")


def keeps_hard_constraints(violations: Sequence[Violation]) -> bool:
    """Return whether the violations break only the limits of threat level or quality."""
    return all(violation.rule in SOFT_RULES for violation in violations)
