"""Paths as rows of poses (:class:`~companion.kernels.workspace.PathRows`): joining them by Dubins edges,
checking and costing them.
"""  # noqa: D205

from __future__ import annotations

import math

from companion.kernels.aircraft import dubins
from companion.kernels.aircraft.motion import (
    OK,
    STRAIGHT_RATE,
    slowness,
    state_status,
    straight_after,
    turn_radius,
    wrapped,
)
from companion.kernels.arrays import Float1D, Limits, Obstacles, Scene
from companion.kernels.geometry.prism_distance import segment_clear
from companion.kernels.native.kernel import kernel, local_floats
from companion.kernels.printed.reachability import dt_positions
from companion.kernels.search.costs import threats_at, turn_cost
from companion.kernels.threat.fuzzy_threat import line_threat
from companion.kernels.workspace import MAX_PATH, PathRows, Workspace

JOINED, NOT_FLYABLE, TOO_LONG = 0, 1, 2
ONE_TURN_M = 0.1  # Two turns to the same side with less straight flight between them are one turn.
HEIGHT_TOLERANCE_M = 1e-3
UNSURE = 0.25  # An edge between this share of the least turn and the whole is neither straight nor a turn.
SPEED_GAP_M_S = 0.5  # The speeds at the ends of an edge between two poses may differ by this much.
SPEED_SPARE_M_S = 0.1  # A short cut may begin faster than the row that it leads to by this much.
SPEED_TOLERANCE_M_S = 1e-3  # A speed may exceed what an edge can gain by this much.
# Tolerance of the turn rate limit, for edges that are sampled across the end of a turn.
TURN_TOLERANCE = 1e-3


@kernel
def keeps_turns_apart(kind: int, segments: Float1D, limits: Limits) -> bool:
    """Return whether two turns of a Dubins word have ``straight_min`` between them, or are one turn.

    ``segments`` (3,) t, p, q of the word in radii.
    """
    least = STRAIGHT_RATE * limits.tau
    if segments[0] < least or segments[2] < least:
        return segments[1] < least or dubins.turn_of(kind, 1) == 0.0 or max(segments[0], segments[2]) < least
    if dubins.turn_of(kind, 1) != 0.0:
        return False
    straight = segments[1] * limits.r_min
    same = dubins.turn_of(kind, 0) == dubins.turn_of(kind, 2)
    return straight >= limits.straight_min or (same and straight < ONE_TURN_M)


@kernel
def ramp(top: float, start: float, end: float, most: float, steps: int, angles: Float1D, ds: float) -> float:
    """Climb angles from ``start`` over ``top`` to ``end``, each at most ``most`` from the next [rad].

    They go to ``angles`` (steps + 1,). Returns the height they gain over steps of ``ds`` on the ground [m]:
    an edge climbs at the mean of its ends' angles.
    """
    gained = 0.0
    angles[0] = start
    for k in range(1, steps + 1):
        up = min(top, start + most * k, end + most * (steps - k))
        angles[k] = max(up, start - most * k, end - most * (steps - k)) if k < steps else end
        gained += ds * math.tan(0.5 * (angles[k] + angles[k - 1]))
    return gained


@kernel
def climb_profile(
    rise: float, start: float, end: float, ds: float, steps: int, v: float, limits: Limits, angles: Float1D
) -> bool:
    """Find climb angles that gain ``rise`` metres within climb angle and pitch rate; return False if none do.

    They go to ``angles`` (steps + 1,) [rad]; ``ds`` is a step's length on the ground, ``v`` the airspeed.
    """
    most = limits.pitch_rate_max * ds / v
    if abs(end - start) > most * steps:
        return False
    low, high = -limits.descent_max, limits.climb_max
    below = ramp(low, start, end, most, steps, angles, ds) - rise
    above = ramp(high, start, end, most, steps, angles, ds) - rise
    if below > HEIGHT_TOLERANCE_M or above < -HEIGHT_TOLERANCE_M:
        return False
    for _ in range(40):  # false position, Illinois variant: the gain rises with the top
        middle = high if above == below else high - above * (high - low) / (above - below)
        at = ramp(middle, start, end, most, steps, angles, ds) - rise
        if abs(at) <= HEIGHT_TOLERANCE_M:
            return True
        if at > 0.0:
            high, above, below = middle, at, 0.5 * below
        else:
            low, below, above = middle, at, 0.5 * above
    return False


@kernel
def air_time(rows: PathRows, k: int, limits: Limits) -> float:
    """Return the duration of the edge to row ``k`` in still air [s], which turns and climbs need."""
    return (rows.times[k] - rows.times[k - 1]) / slowness(rows.states[k - 1], rows.states[k], limits)


@kernel
def fill_air_times(rows: PathRows, n: int, limits: Limits, steps: Float1D) -> None:
    """:func:`air_time` of the edges that end in rows 1 to ``n - 1``, into ``steps`` (N,) [s]."""
    for k in range(1, n):
        steps[k] = air_time(rows, k, limits)


@kernel
def retime(rows: PathRows, steps: Float1D, limits: Limits) -> None:
    """Time stamps from the first row's on, of edges that take ``steps`` (N,) in still air [s], in place."""
    for k in range(1, len(steps)):
        taken = steps[k] * slowness(rows.states[k - 1], rows.states[k], limits)
        rows.times[k] = rows.times[k - 1] + taken


@kernel
def join(rows: PathRows, n: int, goal: Float1D, limits: Limits) -> tuple[int, int]:
    """Append a Dubins edge from row ``n - 1`` to the pose ``goal`` (6,), sampled about every le.

    The climb angle goes from the start's to the goal's over whatever :func:`climb_profile` finds for
    the height between, the airspeed by an even acceleration. Returns the status and the new number of rows.
    """
    states, times, rates = rows.states, rows.times, rows.rates
    start = states[n - 1]
    segments, pose = local_floats(3), local_floats(3)
    slow, fast = min(start[5], goal[5]), max(start[5], goal[5])
    # The turn rate is constant up to the slower end.
    rho = turn_radius(fast, limits) * (0.5 * (slow + fast) / slow)
    kind = dubins.shortest(start[0], start[1], start[3], goal[0], goal[1], goal[3], rho, segments)
    length = rho * (segments[0] + segments[1] + segments[2])
    if length < 1.0 or fast - slow > SPEED_GAP_M_S or not keeps_turns_apart(kind, segments, limits):
        return NOT_FLYABLE, n
    gained = (goal[5] * goal[5] - start[5] * start[5]) / length
    if abs(gained) > 2.0 * limits.a_max:
        return NOT_FLYABLE, n
    steepest = max(limits.climb_max, limits.descent_max)
    if abs(goal[2] - start[2]) > math.tan(steepest) * length:
        return NOT_FLYABLE, n
    is_level = goal[2] == start[2] and goal[4] == 0.0 and start[4] == 0.0
    le = slow * limits.tau * (1.0 if is_level else math.cos(steepest))
    steps = max(1, int(math.ceil(length / le - 1e-6)))
    if steps >= min(states.shape[0] - n + 1, MAX_PATH):
        return TOO_LONG, n
    ds, z, angles = length / steps, start[2], local_floats(MAX_PATH)
    angles[: steps + 1] = 0.0
    if limits.dimension == 3 and not climb_profile(
        goal[2] - start[2], start[4], goal[4], ds, steps, fast, limits, angles
    ):
        return NOT_FLYABLE, n
    for k in range(1, steps + 1):
        dubins.sample(start[0], start[1], start[3], kind, segments, rho, ds * k, pose)
        mean = 0.5 * (angles[k] + angles[k - 1])
        row, before = states[n], states[n - 1]
        v = math.sqrt(start[5] * start[5] + gained * ds * k) if k < steps else goal[5]
        dt = ds / (0.5 * (before[5] + v) * math.cos(mean))
        z += ds * math.tan(mean)
        row[0], row[1], row[2] = pose[0], pose[1], z if k < steps else goal[2]
        row[3], row[4], row[5] = wrapped(pose[2]), angles[k], v
        times[n] = times[n - 1] + dt * slowness(before, row, limits)
        rates[n, 0] = wrapped(row[3] - before[3]) / dt
        rates[n, 1] = (row[4] - before[4]) / dt
        n += 1
    return JOINED, n


@kernel
def is_flyable(rows: PathRows, n: int, first: int, limits: Limits) -> bool:
    """Return whether rows ``first`` to ``n`` keep bounds, radius, climb angles and straight lengths.

    The rule is followed from row 0, where no turn has been flown yet.
    """
    return is_flyable_after(0, limits.straight_min, rows, n, first, limits)


@kernel
def is_flyable_after(turn: int, straight: float, rows: PathRows, n: int, first: int, limits: Limits) -> bool:
    """:func:`is_flyable` with the turn and straight length flown before row 0."""
    states, rates = rows.states, rows.rates
    for k in range(1, n):
        w = rates[k, 0]
        length = air_time(rows, k, limits) * 0.5 * (states[k, 5] + states[k - 1, 5])
        if k >= first:
            if not keeps_limits(rows, k, limits):
                return False
            if breaks_turn_rule(turn, straight, w, limits):
                return False
        turn, straight = straight_after(turn, straight, w, length)
    return True


@kernel
def keeps_limits(rows: PathRows, k: int, limits: Limits) -> bool:
    """Return whether row ``k`` and its edge keep bounds, acceleration, radius, climb and pitch rate."""
    states, rates = rows.states, rows.rates
    dt, w = air_time(rows, k, limits), rates[k, 0]
    if state_status(states[k], limits) != OK:
        return False
    slow, fast = min(states[k, 5], states[k - 1, 5]), max(states[k, 5], states[k - 1, 5])
    if abs(w) > slow * math.cos(states[k - 1, 4]) / turn_radius(fast, limits) * (1.0 + TURN_TOLERANCE) + 1e-9:
        return False
    if states[k, 5] - states[k - 1, 5] > limits.a_max * dt + SPEED_TOLERANCE_M_S:
        return False
    if abs(rates[k, 1]) > limits.pitch_rate_max * (1.0 + TURN_TOLERANCE):
        return False
    if states[k, 4] > limits.climb_max + 1e-6 or states[k, 4] < -limits.descent_max - 1e-6:
        return False
    return not UNSURE * STRAIGHT_RATE < abs(w) * dt <= STRAIGHT_RATE


@kernel
def breaks_turn_rule(turn: int, straight: float, w: float, limits: Limits) -> bool:
    """Return whether an edge of turn rate ``w`` begins a turn too soon after another."""
    sign = 1 if w > STRAIGHT_RATE else (-1 if w < -STRAIGHT_RATE else 0)
    return sign != 0 and sign != turn and (turn != 0 or straight < limits.straight_min - 1e-6)


@kernel
def is_clear(rows: PathRows, first: int, n: int, obstacles: Obstacles, limits: Limits) -> bool:
    """Return whether the edges that end in rows ``first`` to ``n - 1`` keep the margin from obstacles."""
    for k in range(first, n):
        p, q = rows.states[k - 1], rows.states[k]
        chord = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
        sagitta = 0.125 * chord * abs(rows.rates[k, 0]) * air_time(rows, k, limits)
        if not segment_clear(p[0], p[1], p[2], q[0], q[1], q[2], obstacles, limits.margin + sagitta):
            return False
    return True


@kernel
def path_cost(rows: PathRows, first: int, n: int, delta: float, scene: Scene, work: Workspace) -> float:
    """Sum of (9) over the edges that end in rows ``first`` to ``n - 1``; infinite above the level limit."""
    search, points = scene.search, work.points
    points[:] = 0.0
    threats = threats_at(scene, points, work.edge.threat)
    total = 0.0
    for k in range(first, n):
        p, q = rows.states[k - 1], rows.states[k]
        dt_positions(
            scene.pursuers,
            q[0],
            q[1],
            q[2],
            rows.times[k],
            search.k_pursuer,
            scene.walls,
            points,
            work.growth.reach,
        )
        chord = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
        level = line_threat(p, q[0], q[1], q[2], q[5], delta, search.secondary, threats)
        if level > search.level_max:
            total = math.inf
        total += (
            search.cost_distance * chord / search.unit
            + search.cost_turn * turn_cost(p, q[0], q[1], q[2])
            + search.cost_threat * level
        )
    return total


@kernel
def splice(
    rows: PathRows, n: int, i: int, via: Float1D, use_via: bool, j: int, limits: Limits, out: PathRows
) -> tuple[int, int, int]:
    """Copy a path with rows ``i`` to ``j`` replaced by Dubins edges, over the pose ``via`` (6,) if asked.

    Returns the status, the new number of rows and the row that ``j`` has become. Rows after it keep
    their shape and move in time.
    """
    out.states[: i + 1], out.times[: i + 1] = rows.states[: i + 1], rows.times[: i + 1]
    out.rates[: i + 1] = rows.rates[: i + 1]
    m = i + 1
    if use_via:
        status, m = join(out, m, via, limits)
        if status != JOINED:
            return status, m, m
    status, m = join(out, m, rows.states[j], limits)
    if status != JOINED:
        return status, m, m
    at = m - 1
    if m + n - 1 - j > out.states.shape[0]:
        return TOO_LONG, m, at
    for k in range(j + 1, n):
        out.states[m], out.rates[m] = rows.states[k], rows.rates[k]
        out.times[m] = out.times[m - 1] + rows.times[k] - rows.times[k - 1]
        m += 1
    return JOINED, m, at


@kernel
def fill_short_cut(
    rows: PathRows, n: int, i: int, j: int, limits: Limits, obstacles: Obstacles, out: PathRows
) -> tuple[int, int]:
    """Replace rows ``i`` to ``j`` by a Dubins edge in ``out``, if that is sooner, flyable and clear.

    Returns the new number of rows, or 0 if it is not, and the row that ``j`` has become.
    """
    if rows.states[i, 5] > rows.states[j, 5] + SPEED_SPARE_M_S:  # The edge would be too fast up to its end.
        return 0, 0
    status, m, at = splice(rows, n, i, rows.states[i], False, j, limits, out)
    if status != JOINED or out.times[at] >= rows.times[j] or not is_flyable(out, m, i + 1, limits):
        return 0, 0
    if not is_clear(out, i + 1, at + 1, obstacles, limits):
        return 0, 0
    return m, at


@kernel
def fill_detour(
    rows: PathRows, n: int, i: int, via: Float1D, j: int, limits: Limits, obstacles: Obstacles, out: PathRows
) -> int:
    """Replace rows ``i`` to ``j`` by Dubins edges over the pose ``via`` (6,) in ``out``, if that is possible.

    Returns the new number of rows, or 0 if the edges cannot be flown or are not clear.
    """
    if abs(rows.states[i, 5] - rows.states[j, 5]) > SPEED_SPARE_M_S:
        return 0
    status, m, at = splice(rows, n, i, via, True, j, limits, out)
    if status != JOINED or not is_flyable(out, m, i + 1, limits):
        return 0
    return m if is_clear(out, i + 1, at + 1, obstacles, limits) else 0
