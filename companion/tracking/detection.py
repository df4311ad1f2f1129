"""Detections of one vehicle, and what successive ones say about each other.

A report can contradict those before it: a place that cannot have been reached, a velocity at which the
vehicle would be elsewhere, an earlier place that is sent again, a rate of climb that its altitudes
do not show. Recordings of ADS-B have all of these.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray

MOVES_M_S = 5.0  # What reports at least this speed cannot be at exactly the same place again.
AGE_STEP_S = 1.0  # ADSB_VEHICLE gives the age of a position in whole seconds.
SPEED_SPARE = 1.5  # A vehicle may have flown faster between two reports than in either; 1.4 was recorded.
STRAIGHT_S, ASIDE_COSINE = 6.0, 0.5  # Within this time hardly any aircraft turns by 60° and flies far.
# Altitudes of airliners change by up to 30 m/s and those of light aircraft by 15. A report that is refused
# wrongly is confirmed by the next two.
CLIMB_MAX_M_S = 60.0
HEIGHT_NOISE_M = 100.0  # A pressure altitude may differ from a geometric one by this much.
CLIMB_WINDOW_S = 12.0  # The rate of climb is taken from the altitudes of this time.
CLIMB_SPAN_MIN_S = 4.0  # Altitudes in steps of 25 ft give it to 2 m/s over this time.
CLIMB_CONTRADICTS_M_S = 20.0  # An aircraft that begins to climb or to descend differs by less.


@dataclass(frozen=True, slots=True)
class Detection:
    """A report in the local frame."""

    stamp_s: float
    position_enu_m: tuple[float, float, float]
    position_std_m: float
    velocity_enu_m_s: tuple[float, float, float] | None
    is_airborne: bool
    height_std_m: float | None = None
    velocity_std_m_s: float | None = None
    next_enu_m: tuple[float, float, float] | None = None

    @property
    def horizontal_m(self) -> FloatArray:
        """East and north, shape (2,) [m]."""
        return np.array(self.position_enu_m[:2])

    @property
    def velocity_m_s(self) -> FloatArray | None:
        """East and north of the reported velocity, shape (2,) [m/s]; None if it was not reported."""
        return None if self.velocity_enu_m_s is None else np.array(self.velocity_enu_m_s[:2])

    @property
    def speed_m_s(self) -> float | None:
        """Reported horizontal speed [m/s]; None if it was not reported."""
        return None if self.velocity_enu_m_s is None else math.hypot(*self.velocity_enu_m_s[:2])

    def distance_m(self, other: Detection) -> float:
        """Return the horizontal distance to another detection [m]."""
        return math.dist(self.position_enu_m[:2], other.position_enu_m[:2])

    def is_repeat_of(self, earlier: Detection) -> bool:
        """Return whether it is an earlier position that is sent again.

        It has exactly the same place, and either the same time, to the step in which ages are reported, or a
        speed at which the vehicle cannot be there still.
        """
        if self.position_enu_m[:2] != earlier.position_enu_m[:2]:
            return False
        is_same_time = abs(self.stamp_s - earlier.stamp_s) < AGE_STEP_S
        return is_same_time or (self.speed_m_s or 0.0) >= MOVES_M_S

    def is_height_within_reach(self, earlier: Detection) -> bool:
        """Return whether an aircraft can have climbed or descended so far since an earlier detection."""
        if not self.is_airborne or not earlier.is_airborne:
            return True
        elapsed_s = abs(self.stamp_s - earlier.stamp_s)
        changed_m = abs(self.position_enu_m[2] - earlier.position_enu_m[2])
        return changed_m <= CLIMB_MAX_M_S * elapsed_s + HEIGHT_NOISE_M

    def is_flown_from(self, earlier: Detection, noise_m: float) -> bool:
        """Return whether the vehicle can have come from an earlier detection at the speeds that it reported.

        It may have turned in between. If neither reports a speed, this is not known, and False.

        Parameters
        ----------
        earlier : Detection
            A detection before this one.
        noise_m : float
            Largest error of the distance between the two [m].
        """
        speeds_m_s = [speed for speed in (self.speed_m_s, earlier.speed_m_s) if speed is not None]
        elapsed_s = self.stamp_s - earlier.stamp_s
        if not speeds_m_s or elapsed_s <= 0.0:
            return False
        return self.distance_m(earlier) <= SPEED_SPARE * max(speeds_m_s) * elapsed_s + noise_m

    def without_wrong_velocity(self, earlier: Detection, noise_m: float) -> Detection:
        """Return it without its velocity if the vehicle has moved in another way since an earlier detection.

        It has come farther than the reported speeds allow, or, within a few seconds, in another direction.

        Positions are what an aircraft reports first of all. Its velocity is a message of its own, which may
        be missing, and some receivers then say 0. The parameters are those of :meth:`is_flown_from`.
        """
        if self.velocity_m_s is None or self.speed_m_s is None or self.stamp_s <= earlier.stamp_s:
            return self
        fastest = max(self.speed_m_s, earlier.speed_m_s or 0.0)
        elapsed_s = self.stamp_s - earlier.stamp_s
        # The age of each of the two may be wrong by a step.
        way_m = SPEED_SPARE * fastest * (elapsed_s + 2.0 * AGE_STEP_S) + 2.0 * noise_m
        moved_m = self.distance_m(earlier)
        is_too_far = moved_m > way_m
        along = float(self.velocity_m_s @ (self.horizontal_m - earlier.horizontal_m))
        is_aside = along < ASIDE_COSINE * self.speed_m_s * moved_m
        is_aside = is_aside and elapsed_s <= STRAIGHT_S and moved_m > 2.0 * noise_m
        return replace(self, velocity_enu_m_s=None) if is_too_far or is_aside else self

    def with_velocity_since(self, earlier: Detection) -> Detection:
        """Return it with the mean horizontal velocity since an earlier detection if it has no velocity."""
        elapsed_s = self.stamp_s - earlier.stamp_s
        if self.velocity_enu_m_s is not None or elapsed_s <= 0.0:
            return self
        east, north = (self.horizontal_m - earlier.horizontal_m) / elapsed_s
        return replace(self, velocity_enu_m_s=(float(east), float(north), 0.0))


class ClimbEstimate:
    """The rate of climb of one aircraft: as it reports it, unless its altitudes contradict.

    Attributes
    ----------
    rate_m_s : float
        The rate of climb [m/s]; 0 if nothing is known of it.
    """

    def __init__(self) -> None:
        self._heights: deque[tuple[float, float]] = deque(maxlen=16)  # Times [s] and heights [m].
        self.rate_m_s = 0.0

    def observe(self, stamp_s: float, up_m: float, reported_m_s: float | None) -> None:
        """Take an altitude [m] and the reported rate of climb [m/s], None if there is none."""
        self._heights.append((stamp_s, up_m))
        while stamp_s - self._heights[0][0] > CLIMB_WINDOW_S:
            self._heights.popleft()
        measured = self._measured_m_s()
        if reported_m_s is None or abs(reported_m_s) > CLIMB_MAX_M_S:
            self.rate_m_s = measured or 0.0
        elif measured is not None and abs(reported_m_s - measured) > CLIMB_CONTRADICTS_M_S:
            self.rate_m_s = measured
        else:
            self.rate_m_s = reported_m_s

    def _measured_m_s(self) -> float | None:
        """Return the median slope between altitudes of different times (Theil and Sen); None if too few."""
        slopes = [
            (later - earlier) / (then - before)
            for before, earlier in self._heights
            for then, later in self._heights
            if then - before >= CLIMB_SPAN_MIN_S
        ]
        return float(np.median(slopes)) if slopes else None
