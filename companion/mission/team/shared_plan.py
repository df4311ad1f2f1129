"""The plan that a member of a team tells the others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray

NUMBERS = 1 << 16  # Plan numbers are counted in 16 bits and begin again.
ROUNDED_S = 2e-5  # Rounding moves a time that counts as one of the clock's ticks by less than this.
ROUND_S, ROUND_M = 15.0, 30.0  # A lap is flown once it is this near to where it was this time before.
LAPS_M = 5.0  # Laps of the same circle differ by less than this.
LOOK_S = 1e-4  # Two places of a path this far apart in time differ by some millimetres, save at a jump.


def is_newer(number: int, than: int) -> bool:
    """Return whether a plan number was given later than another.

    Numbers begin again after 65,535, so the shorter way round decides (RFC 1982, *Serial Number Arithmetic*).
    """
    return 0 < (number - than) % NUMBERS < NUMBERS // 2


@dataclass(frozen=True, slots=True, eq=False)
class SharedPlan:
    """A timed path that ends in a circle, which is held for ever, and may begin in one.

    Between two rows the member flies straight at constant speed. From the time of the last row on it is
    anywhere in the disc of the circle. The last two rows may have the same time: then the member enters the
    circle at the last row but one, and the last row is the centre. If the path begins in a circle, the first
    row is its centre, and the member leaves it at the place and the time of the second row.

    Parameters
    ----------
    member : int
        MAVLink system id of the member.
    number : int
        Number of the plan, in 16 bits; a later plan of the same member has a newer number.
    rows : ndarray, shape (N, 4)
        UTC time [s], east, north, up [m]; times never fall.
    radius_m : float
        Radius of the circle about the last place [m].
    discs_m : ndarray, shape (2,)
        Radii of the circles at the beginning and at the end [m].
    box_m : tuple of float
        Least east, north, up and greatest east, north, up of the path and its circles [m].
    tolerance_m, tolerance_up_m : float
        The member promises to stay this close to the plan, horizontally and vertically [m].
    is_emergency : bool
        True if the member has to leave its committed plan.
    room : int
        How many other ways the member has, 0 to 255; who has less goes first.
    first_radius_m : float
        Radius of the circle about the first place; 0 if the path does not begin in a circle [m].
    is_request : bool
        True if the plan is never flown: it asks others to move the circles that are in its way.
    """

    member: int
    number: int
    rows: FloatArray
    radius_m: float
    tolerance_m: float
    tolerance_up_m: float
    is_emergency: bool = False
    room: int = 255
    first_radius_m: float = 0.0
    is_request: bool = False
    discs_m: FloatArray = field(init=False, repr=False)
    box_m: tuple[float, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rows = np.array(self.rows, dtype=np.float64, order="C", ndmin=2)
        if not len(rows) or rows.shape[1] != 4 or not np.isfinite(rows).all():
            raise ValueError("rows: expected time, east, north and up, all finite")
        if (np.diff(rows[:, 0]) < 0.0).any():
            raise ValueError("rows: expected times that never fall")
        discs = np.array([self.first_radius_m if len(rows) > 1 else 0.0, self.radius_m])
        for name, values in (("rows", rows), ("discs_m", discs)):
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        wide = np.array([discs.max(), discs.max(), 0.0])
        low, high = rows[:, 1:].min(axis=0) - wide, rows[:, 1:].max(axis=0) + wide
        object.__setattr__(self, "box_m", (*low.tolist(), *high.tolist()))

    @property
    def start_s(self) -> float:
        """UTC time of the first row [s]."""
        return float(self.rows[0, 0])

    @property
    def end_s(self) -> float:
        """UTC time from which on the member is in its last circle [s]."""
        return float(self.rows[-1, 0])

    @property
    def leaves_s(self) -> float:
        """UTC time at which the member leaves its first circle; minus infinity if there is none [s]."""
        return float(self.rows[1, 0]) if self.discs_m[0] > 0.0 else -math.inf

    @property
    def rank(self) -> tuple[bool, int, int]:
        """Place in the order of proposals; the lesser goes first."""
        return not self.is_emergency, self.room, self.member

    def place_at(self, time_s: float) -> tuple[float, float, float]:
        """Return east, north and up [m] at an instant; the centre while the member is in a circle."""
        rows = self.rows
        if time_s < self.leaves_s:
            return float(rows[0, 1]), float(rows[0, 2]), float(rows[0, 3])
        k = int(np.searchsorted(rows[:, 0], time_s, side="right"))
        if k == 0 or k == len(rows):
            east, north, up = rows[max(k - 1, 0), 1:]
        else:
            part = (time_s - rows[k - 1, 0]) / (rows[k, 0] - rows[k - 1, 0])
            east, north, up = rows[k - 1, 1:] + part * (rows[k, 1:] - rows[k - 1, 1:])
        return float(east), float(north), float(up)

    def distance_from(self, place_enu_m: tuple[float, float, float], time_s: float) -> tuple[float, float]:
        """Return how far a place is from the plan at an instant, horizontally and vertically [m].

        While the member is in a circle, the horizontal distance is that from its disc.
        """
        east, north, up = self.place_at(time_s)
        disc = self.disc_at(time_s)
        level = math.hypot(place_enu_m[0] - east, place_enu_m[1] - north)
        return max(level - disc, 0.0), abs(place_enu_m[2] - up)

    def disc_at(self, time_s: float) -> float:
        """Return the radius of the circle in which the member is at an instant; 0 on the way [m]."""
        if time_s >= self.end_s - ROUNDED_S:
            return self.radius_m
        return float(self.discs_m[0]) if time_s < self.leaves_s + ROUNDED_S else 0.0

    def document(self) -> dict[str, object]:
        """Return the places, each east, north, up, and the last circle's radius [m], for pages."""
        return {"plan_enu_m": np.round(self.rows[:, 1:], 1).tolist(), "circle_m": round(self.radius_m, 1)}

    def circles_at(self, time_s: float) -> bool:
        """Return whether the member is in the circle at the plan's end at a UTC time [s]."""
        return self.radius_m > 0.0 and time_s >= self.end_s

    def is_flown_at(self, place_enu_m: tuple[float, float, float], time_s: float) -> bool:
        """Return whether a place at an instant is within the plan's tolerance."""
        level, up = self.distance_from(place_enu_m, time_s)
        return level <= self.tolerance_m and up <= self.tolerance_up_m


def largest_distance(flown: SharedPlan, sent: SharedPlan) -> tuple[float, float]:
    """Return how far a plan is from another version of itself at most, horizontally and vertically [m].

    The difference of two places is linear in time between the rows of both, so its length is largest at a
    row. Times next to each row are looked at, because both may jump there.

    Parameters
    ----------
    flown : SharedPlan
        The plan as its member flies it.
    sent : SharedPlan
        The plan as the others read it. It leaves the first circle no sooner and enters the last no later.
    """
    times = np.concatenate([flown.rows[:, 0], sent.rows[:, 0]])
    times = np.concatenate([times - LOOK_S, times, times + LOOK_S])
    times = times[times >= flown.start_s]
    found = [sent.distance_from(flown.place_at(t), t) for t in times.tolist() if t < flown.end_s]
    apart = flown.rows[-1, 1:] - sent.rows[-1, 1:]  # of the centres
    found.append((math.hypot(apart[0], apart[1]) + flown.radius_m - sent.radius_m, abs(float(apart[2]))))
    found.append((float(flown.discs_m[0] - sent.discs_m[0]), 0.0))
    if sent.leaves_s < flown.leaves_s:  # The time on the way is too short to be rounded so that it does not.
        found.append((float(flown.discs_m[0] + np.hypot(*(flown.rows[0, 1:3] - sent.rows[1, 1:3]))), 0.0))
    return max(0.0, *(level for level, _ in found)), max(up for _, up in found)


def entering_circle(rows: FloatArray, radius_m: float) -> FloatArray:
    """Return a path that ends at the centre of a circle as one that ends where it enters the circle.

    An autopilot that is sent to a circle about a place turns into the circle before it reaches that place.
    The path has to be at the circle's height there: a step in height would have to be in the tolerance.

    Parameters
    ----------
    rows : ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    radius_m : float
        Radius of the circle about the last place [m].

    Returns
    -------
    ndarray, shape (M, 4)
        The path until it stays in the circle, and the centre at the same time.
    """
    centre = rows[-1]
    outside = np.hypot(*(rows[:, 1:3] - centre[1:3]).T) > radius_m
    if not outside.any():
        return np.vstack([rows[:1], [[rows[0, 0], *centre[1:]]]])
    k = int(np.flatnonzero(outside)[-1])
    begin, leg = rows[k], rows[k + 1] - rows[k]
    away = begin[1:3] - centre[1:3]
    a, b, c = leg[1:3] @ leg[1:3], away @ leg[1:3], away @ away - radius_m**2
    part = (-b - math.sqrt(max(b * b - a * c, 0.0))) / a
    entry = begin + min(max(part, 0.0), 1.0) * leg
    return np.vstack([rows[: k + 1], [entry], [[entry[0], *centre[1:]]]])


def circled(rows: FloatArray) -> tuple[FloatArray, float]:
    """Return the rows of a flight until it stays in a circle, and the radius of that circle.

    Parameters
    ----------
    rows : ndarray, shape (N, 4)
        Time [s], east, north, up [m], less than ``ROUND_S`` apart.

    Returns
    -------
    rows : ndarray, shape (M, 4)
        The flight until it stays in its circle, and then the circle's centre; without a circle all rows.
    radius_m : float
        Radius of the circle; 0 if it does not circle [m].
    """
    before = rows[rows[:, 0] <= rows[-1, 0] - ROUND_S]
    came_by = np.flatnonzero(np.linalg.norm(before[:, 1:] - rows[-1, 1:], axis=1) < ROUND_M)
    if not len(came_by):
        return rows, 0.0
    loop = rows[came_by[-1] :, 1:]
    centre = 0.5 * (loop.min(axis=0) + loop.max(axis=0))
    away = np.hypot(*(rows[:, 1:3] - centre[:2]).T)
    radius_m = float(away[came_by[-1] :].max()) + LAPS_M
    outside = np.flatnonzero(away > radius_m)
    enters = int(outside[-1]) + 1 if len(outside) else 0
    return np.vstack([rows[: enters + 1], [rows[enters, 0], *centre]]), radius_m


def simplified(rows: FloatArray, within_m: float, first: int = 0) -> FloatArray:
    """Return a path with fewer rows that is nowhere farther from the given one than a distance.

    Places of the same time are compared. Of all rows between two that are kept, the one that is farthest from
    the straight leg is kept, until none is too far (Douglas and Peucker 1973, with time as a coordinate;
    Meratnia and de By 2004).

    Parameters
    ----------
    rows : ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    within_m : float
        Greatest distance [m].
    first : int
        Row from which on rows may be left out.

    Returns
    -------
    ndarray, shape (M, 4)
        Some of the rows, the first and the last among them.
    """
    kept, waiting = {*range(first + 1), len(rows) - 1}, [(first, len(rows) - 1)]
    while waiting:
        begin, end = waiting.pop()
        if end - begin < 2:
            continue
        leg, after_s = rows[end] - rows[begin], rows[begin : end + 1, 0] - rows[begin, 0]
        parts = after_s / leg[0] if leg[0] else np.zeros_like(after_s)
        straight = rows[begin, 1:] + parts[:, None] * leg[1:]
        far = np.linalg.norm(rows[begin : end + 1, 1:] - straight, axis=1)[1:-1]
        if far.max() > within_m:
            middle = begin + 1 + int(far.argmax())
            kept.add(middle)
            waiting += [(begin, middle), (middle, end)]
    return rows[sorted(kept)]
