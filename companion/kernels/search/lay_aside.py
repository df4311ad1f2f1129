"""Room: how far the rows of a path are from everything, and paths laid where there is more of it."""

from __future__ import annotations

import math

from companion.kernels.aircraft.motion import turn_radius
from companion.kernels.arrays import Float1D, Float2D, Int1D, Limits, Obstacles
from companion.kernels.geometry.prism_distance import clearance
from companion.kernels.native.kernel import kernel, local_floats
from companion.kernels.native.struct import Struct
from companion.kernels.search.path_edit import (
    JOINED,
    is_clear,
    is_flyable,
    join,
    join_accelerated,
    radius_between,
)
from companion.kernels.workspace import PathRows

ASIDE_M = 1.0  # by which the slope of the distance is told
SAME_SPEED_M_S = 0.01  # rows may be close, and the next one as fast as the check allows
FLAT = 0.1  # a slope of the distance below which no way leads aside: over or below something


class Aside(Struct):
    """How paths are laid aside.

    ``leads`` (L,) rows before the one that is moved, and as many after it, between which they are; ``turns``
    (T,) of its direction [rad]; ``most`` room that counts [m]; ``worth`` metres of way, of a metre of room
    of one row; ``least`` of that, over all rows, that is worth it at all [m].
    """

    leads: Int1D
    turns: Float1D
    most: float
    worth: float
    least: float


@kernel
def fill_rooms(states: Float2D, obstacles: Obstacles, most: float, rooms: Float2D) -> None:
    """Distance of each row of ``states`` (N, ≥ 3) [m] to the nearest prism, and where to there is more.

    ``rooms`` (N, 3) receives the distance, up to ``most`` [m], and the unit vector east and north away from
    the prism; zeros where nothing is nearer than ``most``, or no way in the plane leads away.
    """
    for k in range(states.shape[0]):
        x, y, z = states[k, 0], states[k, 1], states[k, 2]
        rooms[k, 0] = clearance(x, y, z, obstacles, most)
        rooms[k, 1] = rooms[k, 2] = 0.0
        if rooms[k, 0] >= most:
            continue
        far = most + 2.0 * ASIDE_M
        east = clearance(x + ASIDE_M, y, z, obstacles, far) - clearance(x - ASIDE_M, y, z, obstacles, far)
        north = clearance(x, y + ASIDE_M, z, obstacles, far) - clearance(x, y - ASIDE_M, z, obstacles, far)
        slope = math.hypot(east, north)
        if slope > FLAT * 2.0 * ASIDE_M:
            rooms[k, 1], rooms[k, 2] = east / slope, north / slope


@kernel
def lack_of_room(states: Float2D, first: int, last: int, obstacles: Obstacles, most: float) -> float:
    """How much nearer than ``most`` to something rows ``first`` to ``last`` of ``states`` (N, ≥ 3) are [m].

    The sum over all of them.
    """
    lack = 0.0
    for k in range(first, last + 1):
        lack += most - clearance(states[k, 0], states[k, 1], states[k, 2], obstacles, most)
    return lack


@kernel
def lay_aside(
    rows: PathRows, k: int, aside: Float1D, search: Aside, limits: Limits, obstacles: Obstacles,
    trial: PathRows, best: PathRows,
) -> tuple[int, int, int, int]:  # fmt: skip
    """A path laid over row ``k`` moved by ``aside`` (2,) [m], between a row before and one after it.

    Of all that are tried the one that is worth most, where the room that it lacks less is worth more than the
    way that it is longer. ``trial`` and ``best`` are used up; ``best`` receives the path. Returns its number
    of rows, 0 where none is worth it, the row at which it leaves the old one, the one there at which it is
    back, and the one that this has become.
    """
    n = len(rows.times)
    most_worth, found = 0.0, (0, 0, 0, 0)
    via = local_floats(6)
    via[:] = rows.states[k]
    via[0], via[1] = via[0] + aside[0], via[1] + aside[1]
    for a in range(len(search.leads)):
        first = max(k - search.leads[a], 0)
        if a > 0 and first == max(k - search.leads[a - 1], 0):
            break
        _copy(rows, 0, first + 1, trial, 0)
        straight_in = _straight_in(trial.states[first], via, limits)
        for t in range(len(search.turns) + 2):
            turned = t - len(search.turns)
            via[3] = rows.states[k, 3] + search.turns[t] if turned < 0 else straight_in[turned]
            status, m = _led_to(trial, first + 1, via, limits.v_cruise, limits)
            if status != JOINED or not is_flyable(trial, m, first + 1, limits):
                continue
            for b in range(len(search.leads)):
                last = min(k + search.leads[b], n - 1)
                if b > 0 and last == min(k + search.leads[b - 1], n - 1):
                    break
                worth, end = _led_back(rows, first, last, m, search, limits, obstacles, trial)
                if worth > most_worth and _is_fit(
                    trial, first, m, end, end + n - 1 - last, obstacles, limits
                ):
                    most_worth, found = worth, (end + n - 1 - last, first, last, end - 1)
                    _copy(trial, 0, end + n - 1 - last, best, 0)
    return found


@kernel
def _led_back(
    rows: PathRows, first: int, last: int, m: int, search: Aside, limits: Limits, obstacles: Obstacles,
    trial: PathRows,
) -> tuple[float, int]:  # fmt: skip
    """What it is worth to leave a path at row ``first`` and to be back at row ``last``, in metres of way.

    ``trial`` has its first ``m`` rows, and receives the others. With it the row after that at which it is
    back. 0 where it cannot be flown.
    """
    n = len(rows.times)
    status, end = _led_to(trial, m, rows.states[last], rows.states[last, 5], limits)
    if status != JOINED or end + n - 1 - last > len(trial.times):
        return 0.0, end
    if abs(trial.states[end - 1, 5] - rows.states[last, 5]) > SAME_SPEED_M_S:
        return 0.0, end
    later = trial.times[end - 1] - rows.times[last]
    _copy(rows, last + 1, n, trial, end)
    for k in range(end, end + n - 1 - last):
        trial.times[k] += later
    gained = lack_of_room(rows.states, first + 1, last, obstacles, search.most)
    gained -= lack_of_room(trial.states, first + 1, end - 1, obstacles, search.most)
    return (search.worth * gained - later * limits.v_cruise if gained >= search.least else 0.0), end


@kernel
def _straight_in(start: Float1D, via: Float1D, limits: Limits) -> tuple[float, float]:
    """Directions in which a place is come to by one turn to the left, or to the right, and straight flight.

    From the state ``start`` (6,) to the place of ``via`` (6,) [rad]; its own where that is inside the turn's
    circle.
    """
    v, rho = start[5], turn_radius(start[5], limits)
    if abs(v - limits.v_cruise) > SAME_SPEED_M_S:
        rho = radius_between(v, limits.v_cruise, limits)
    left, right = via[3], via[3]
    for side in (1.0, -1.0):
        x = via[0] - start[0] + side * rho * math.sin(start[3])
        y = via[1] - start[1] - side * rho * math.cos(start[3])
        away = math.hypot(x, y)
        if away > rho:
            direction = math.atan2(y, x) + side * math.asin(rho / away)
            left, right = (direction, right) if side > 0.0 else (left, direction)
    return left, right


@kernel
def _led_to(trial: PathRows, n: int, pose: Float1D, target: float, limits: Limits) -> tuple[int, int]:
    """Append an edge to a ``pose`` (6,), on which the airspeed goes to the ``target`` [m/s]."""
    if abs(trial.states[n - 1, 5] - target) <= SAME_SPEED_M_S:
        return join(trial, n, pose, limits)
    return join_accelerated(trial, n, pose, target, limits)


@kernel
def _is_fit(
    trial: PathRows, first: int, m: int, end: int, total: int, obstacles: Obstacles, limits: Limits
) -> bool:
    """Whether a path of ``total`` rows is flyable from row ``m`` on, and clear where it was laid anew."""
    return is_flyable(trial, total, m, limits) and is_clear(trial, first + 1, end, obstacles, limits)


@kernel
def _copy(rows: PathRows, first: int, end: int, to: PathRows, at: int) -> None:
    """Copy rows ``first`` to ``end - 1`` to row ``at`` and on."""
    n = end - first
    to.states[at : at + n], to.rates[at : at + n] = rows.states[first:end], rows.rates[first:end]
    to.times[at : at + n] = rows.times[first:end]
