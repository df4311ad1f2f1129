"""Exceptions for a flight that begins where it may not be, for its return to bounds and for nothing else.

An aircraft that is out of its bounds, or too near to an obstacle, cannot keep the rules at once. While it
returns, it may be out of bounds by no more than a turn needs. From what it is too near to, it has to keep
half of its first distance. It may leave a fence that was drawn around it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from companion.assurance.violation import Violation
from companion.frames import FloatArray

KEPT_SHARE = 0.5  # The flight keeps this share of its first distance from an obstacle.
OVERSHOOT_RADII = 2.0  # The flight may go this many turn radii farther out of bounds while it turns back.
RETURN_MAX_M = 3_000.0  # The exceptions hold on this length at most.
NEAR_MAX_M = 550.0  # The limit of the length for a flight that is only too near to something.
OUT_MIN_M = 0.02  # Out of bounds by less counts as inside: rounding.


@dataclass(frozen=True, slots=True)
class ReturnToBounds:
    """The start of such a flight.

    Parameters
    ----------
    out_m : float
        Distance out of bounds, 0 inside [m].
    near_m : mapping of str to float
        Distance from each obstacle that is too near, by the violation's detail text [m].
    turn_radius_m : float
        Radius of the turn back [m].
    """

    out_m: float
    near_m: Mapping[str, float]
    turn_radius_m: float

    def is_forgiven(self, found: Violation) -> bool:
        """Return whether a violation by itself may be part of the return."""
        if found.rule == "bounds":
            most = self.out_m + OVERSHOOT_RADII * self.turn_radius_m
            return self.out_m > OUT_MIN_M and abs(found.value - found.limit) <= most
        near = self.near_m.get(found.detail) if found.rule == "clearance" else None
        return near is not None and (near <= 0.0 or found.value >= KEPT_SHARE * near)

    def remaining(self, found: Iterable[Violation], places: FloatArray) -> list[Violation]:
        """Return the violations that are not part of the return.

        Parameters
        ----------
        found : iterable of Violation
            All violations.
        places : ndarray, shape (N, 3)
            Positions of rows or waypoints; the flight begins at the first [m].
        """
        every = list(found)
        rows = {entry.row for entry in every if self.is_forgiven(entry)}
        end = 1
        while end in rows:
            end += 1
        steps = np.linalg.norm(np.diff(places[: end + 1], axis=0), axis=1)
        is_shut_out = self.out_m > OUT_MIN_M or min(self.near_m.values(), default=1.0) <= 0.0
        if float(steps.sum()) > (RETURN_MAX_M if is_shut_out else NEAR_MAX_M):
            return every
        return [entry for entry in every if entry.row >= end or not self.is_forgiven(entry)]
