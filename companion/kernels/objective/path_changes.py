"""Changes of a path that lower J: short cuts, detours and other ways past goals, drawn and tried in turn."""

from __future__ import annotations

import math

from companion.kernels.arrays import Float1D, Float2D
from companion.kernels.native.kernel import kernel, local_floats
from companion.kernels.objective.row_costs import Objective, rows_cost
from companion.kernels.search.growth import next_stage
from companion.kernels.search.path_edit import fill_detour, fill_short_cut
from companion.kernels.workspace import PathRows

# Columns of a draw. WIDTH is the share of the path's rows that a short cut replaces at most; DETOUR for a
# detour, which may replace all; GOAL for another way past a goal. The others are uniform in [0, 1): they give
# the first row, the number of rows, and for a detour how near to the start it begins, the row that it leads
# past, how far away, whether above or below, and to which of the two sides. What they are for another way
# past a goal is told in :func:`passed_elsewhere`.
DRAWS = 8
WIDTH, FIRST, NUM, EARLY, PAST, FAR, VERTICAL, SIDE = range(DRAWS)
DETOUR, GOAL = -1.0, -2.0
PASSING_ROWS = 60  # Another way past a goal begins at most this many rows before it, and ends as many after.
OTHER_COURSE_RAD = 0.5 * math.pi  # It passes the goal on a course that differs by at most this much.
ROWS_MIN = 4  # A path with fewer rows is not changed.
ASIDE = 0.5  # A detour is no wider than this share of its length: 27° to one side.
LEAST_GAIN_S = 1e-9  # A change that lowers J by less than this is none.


@kernel
def next_gain(
    rows: PathRows, n: int, draws: Float2D, goals: Float2D, objective: Objective, out: PathRows
) -> tuple[int, int]:
    """Try changes of a path of ``n`` rows in turn until one lowers J; the changed path goes to ``out``.

    Returns the number of the draw and of the path's rows; the number of all draws and 0 if none does.
    ``draws`` (K, 8), ``goals`` (G, 4) x y z radius [m] of the goals to pass on the way, in order.
    """
    for k in range(draws.shape[0]):
        if draws[k, WIDTH] == GOAL:
            goal = goals[int(draws[k, PAST] * goals.shape[0])]
            first, m = passed_elsewhere(rows, n, draws[k], goal, objective, out)
        else:
            first, m = changed(rows, n, draws[k], objective, out)
        if m > 0 and passes(out, m, goals):
            before_s = rows_cost(rows, first + 1, n, objective)
            if before_s - rows_cost(out, first + 1, m, objective) > LEAST_GAIN_S:
                return k, m
    return draws.shape[0], 0


@kernel
def changed(rows: PathRows, n: int, draw: Float1D, objective: Objective, out: PathRows) -> tuple[int, int]:
    """Change a path of at least :data:`ROWS_MIN` rows by one draw (8,).

    Returns the last row that stays as it is, and the new number of rows; 0 of them if the change cannot be
    flown or is not clear.
    """
    limits, obstacles, is_detour = objective.limits, objective.obstacles, draw[WIDTH] < 0.0
    widest = n if is_detour else max(4, int(n * draw[WIDTH]))
    i = int(draw[FIRST] * (n - 3))
    j = min(n - 1, i + 3 + int(draw[NUM] * widest))
    if not is_detour:
        m, _ = fill_short_cut(rows, n, i, j, limits, obstacles, out)
        return i, m
    i = int(i * draw[EARLY] * draw[EARLY])  # Others are met soon, so most detours begin near the start.
    via, begin = local_floats(6), rows.states[i]
    via[:] = rows.states[i + 1 + int(draw[PAST] * (j - i - 1))]
    far = math.sqrt(draw[FAR]) * math.hypot(via[0] - begin[0], via[1] - begin[1])
    if limits.dimension == 3 and draw[VERTICAL] < 0.5:
        via[2] += far * (math.tan(limits.climb_max) if draw[SIDE] < 0.5 else -math.tan(limits.descent_max))
    else:
        right = ASIDE * far * (1.0 if draw[SIDE] < 0.5 else -1.0)
        via[0], via[1] = via[0] + right * math.sin(via[3]), via[1] - right * math.cos(via[3])
    via[4] = 0.0
    return i, fill_detour(rows, n, i, via, j, limits, obstacles, out)


@kernel
def passed_elsewhere(
    rows: PathRows, n: int, draw: Float1D, goal: Float1D, objective: Objective, out: PathRows
) -> tuple[int, int]:
    """Change where and on which course a path passes a goal, by one draw (8,).

    ``goal`` (4,) x y z radius [m]. NUM and EARLY give the first and the last row, FAR and VERTICAL the place
    in the goal's circle, and SIDE the course. Returns as :func:`changed`.
    """
    at, nearest = 0, math.inf
    for k in range(n):
        apart = math.hypot(rows.states[k, 0] - goal[0], rows.states[k, 1] - goal[1])
        if apart < nearest:
            at, nearest = k, apart
    i = max(0, at - 1 - int(draw[NUM] * PASSING_ROWS))
    j = min(n - 1, at + 1 + int(draw[EARLY] * PASSING_ROWS))
    via, away, to = local_floats(6), goal[3] * math.sqrt(draw[FAR]), 2.0 * math.pi * draw[VERTICAL]
    via[:] = rows.states[at]
    via[0], via[1], via[4] = goal[0] + away * math.cos(to), goal[1] + away * math.sin(to), 0.0
    via[3] += (2.0 * draw[SIDE] - 1.0) * OTHER_COURSE_RAD
    return i, fill_detour(rows, n, i, via, j, objective.limits, objective.obstacles, out)


@kernel
def passes(rows: PathRows, n: int, goals: Float2D) -> bool:
    """Return whether a path of ``n`` rows passes all ``goals`` (G, 4) x y z radius [m], in order."""
    stage = 0
    for k in range(n):
        then = -1
        while then != stage:
            then = stage
            stage = next_stage(stage, rows.states[k, 0], rows.states[k, 1], rows.states[k, 2], goals)
    return stage == goals.shape[0]
