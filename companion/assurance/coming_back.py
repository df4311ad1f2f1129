"""What is forgiven a flight that begins where it should not be: the way back from there, and nothing more.

An aircraft that is out of its bounds, or nearer to something than it should be, cannot keep the rules at
once. From its first place on, while it is there, it may be out of bounds by no more than a turn takes it, and
near to what it is near to already by no less than half of that; a fence that was put about it is left.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.assurance.violation import Violation
from companion.frames import FloatArray

HELD = 0.5  # of the distance at first is kept
OVERSHOOT_RADII = 2.0
WAY_MAX_M = 3_000.0
NEAR_MAX_M = 550.0  # where it is only too near to something
OUT_MIN_M = 0.02  # out of bounds by less is within


@dataclass(frozen=True, slots=True)
class ReturnToBounds:
    """Where a flight begins.

    Parameters
    ----------
    out_m : float
        How far out of bounds, 0 within.
    near_m : mapping of str to float
        How near it is to what it is too near to, by the violation's words [m].
    turn_radius_m : float
        Radius of the turn back.
    """

    out_m: float
    near_m: Mapping[str, float]
    turn_radius_m: float

    def is_forgiven(self, found: Violation) -> bool:
        """Whether a violation may be part of the way back, by itself."""
        if found.rule == "bounds":
            most = self.out_m + OVERSHOOT_RADII * self.turn_radius_m
            return self.out_m > OUT_MIN_M and abs(found.value - found.limit) <= most
        near = self.near_m.get(found.detail) if found.rule == "clearance" else None
        return near is not None and (near <= 0.0 or found.value >= HELD * near)

    def left_of(self, found: Iterable[Violation], places: FloatArray) -> list[Violation]:
        """The violations without those of the way back.

        Parameters
        ----------
        found : iterable of Violation
            All that were found.
        places : ndarray, shape (N, 3)
            Rows or waypoints, the first where the flight begins [m].
        """
        every = list(found)
        rows = {entry.row for entry in every if self.is_forgiven(entry)}
        end = 1
        while end in rows:
            end += 1
        steps = np.linalg.norm(np.diff(places[: end + 1], axis=0), axis=1)
        is_shut_out = self.out_m > OUT_MIN_M or min(self.near_m.values(), default=1.0) <= 0.0
        if float(steps.sum()) > (WAY_MAX_M if is_shut_out else NEAR_MAX_M):
            return every
        return [entry for entry in every if entry.row >= end or not self.is_forgiven(entry)]
