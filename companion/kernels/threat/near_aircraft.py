"""A table of the aircraft that fly on and may endanger a place at a time, by cell.

Space is divided into squares and time into bins. Each cell lists the aircraft whose well clear volume, with
the margin about it, comes into its square in its bin. The last bin is for all later times, and squares at the
rim are for all places beyond. An aircraft that may leave its route may come anywhere.
"""

from __future__ import annotations

import math

import numpy as np

from companion.kernels.arrays import Int1D, NearAircraft, Pursuers
from companion.kernels.native.kernel import inlined, kernel
from companion.kernels.printed.reachability import PASSING_STD, SPREADS_S
from companion.kernels.printed.threat_tree import FLIES_ON

MARGIN_M, MARGIN_UP_M = 150.0, 15.0  # A path within this distance of a well clear volume costs more.
WRONG_SIDE_M = 500.0  # The margin is wider by this on the side on which the aircraft should not be passed.
SLACK_M = 1.0  # Boxes are this much wider than necessary.
CELL_M = 250.0  # Width of a square.
CELLS_MAX = 40  # Most squares each way; in larger worlds they are wider.
BIN_S = 5.0  # Length of a bin.
BINS_MAX = 80  # Most bins; the last one has all later times.


@inlined
def slot(value: float, num: int) -> int:
    """Return the slot of a value in units of the slots' width; values beyond the ends belong to those."""
    return int(min(max(value, 0.0), num - 1.0))


@inlined
def cell_at(near: NearAircraft, x: float, y: float, time: float) -> int:
    """Return the cell of a place at a time."""
    column, row = (
        slot((x - near.west) / near.width, near.columns),
        slot((y - near.south) / near.width, near.rows),
    )
    return (slot((time - near.first) / BIN_S, near.bins) * near.rows + row) * near.columns + column


@kernel
def box_in_bin(
    pursuers: Pursuers, near: NearAircraft, d: int, late: int
) -> tuple[float, float, float, float]:
    """West, east, south and north [m] of where aircraft ``d`` may endanger anybody in bin ``late``."""
    model, place, last = pursuers.model[d], pursuers.position[d], pursuers.count[d] - 1
    stays = place[last, 0] == place[last - 1, 0] and place[last, 1] == place[last - 1, 1]
    if model[7] == 0.0 or not stays:
        return -math.inf, math.inf, -math.inf, math.inf
    begins = near.first + late * BIN_S
    k, end = slot(begins - pursuers.time[d, 0], last + 1), last
    if late < near.bins - 1:
        end = slot(begins + BIN_S - pursuers.time[d, 0] + 1.0, last + 1)
    west, east, south, north = place[k, 0], place[k, 0], place[k, 1], place[k, 1]
    for i in range(k + 1, end + 1):
        west, east = min(west, place[i, 0]), max(east, place[i, 0])
        south, north = min(south, place[i, 1]), max(north, place[i, 1])
    reach = model[1] + PASSING_STD * math.hypot(model[2], model[4] * SPREADS_S) + MARGIN_M + SLACK_M
    if late == near.bins - 1 or begins + BIN_S >= model[8]:
        reach += model[9]
    return west - reach, east + reach, south - reach, north + reach


@kernel
def list_near(pursuers: Pursuers, near: NearAircraft, filled: Int1D) -> int:
    """Count the aircraft of each cell in ``near.ends``, or list them in ``near.listed``; return how many.

    They are counted while ``near.listed`` has no room; ``filled`` (C,) zeros are overwritten by the listing.
    """
    counts, total = near.listed.shape[0] == 0, 0
    for d in range(pursuers.count.shape[0]):
        if pursuers.model[d, 3] != FLIES_ON:
            continue
        for late in range(near.bins):
            west, east, south, north = box_in_bin(pursuers, near, d, late)
            first = slot((west - near.west) / near.width, near.columns)
            final = slot((east - near.west) / near.width, near.columns)
            for row in range(
                slot((south - near.south) / near.width, near.rows),
                slot((north - near.south) / near.width, near.rows) + 1,
            ):
                for column in range(first, final + 1):
                    cell = (late * near.rows + row) * near.columns + column
                    total += 1
                    if counts:
                        near.ends[cell + 1] += 1
                    else:
                        near.listed[near.ends[cell] + filled[cell]] = d
                        filled[cell] += 1
    return total


def near_aircraft(pursuers: Pursuers) -> Pursuers:
    """Pursuers with the lists of those that fly on."""
    flies_on = pursuers.model[:, 3] == FLIES_ON
    if not flies_on.any():
        return pursuers
    west, east, south, north = (float(value) for value in pursuers.bounds[:4])
    width = max(CELL_M, (east - west) / CELLS_MAX, (north - south) / CELLS_MAX)
    first = float(pursuers.time[flies_on, 0].min())
    rows = np.flatnonzero(flies_on)
    last_s = max(float(pursuers.time[d, pursuers.count[d] - 1]) for d in rows)
    columns, num_rows = math.ceil((east - west) / width), math.ceil((north - south) / width)
    bins = min(max(math.ceil((last_s - first) / BIN_S) + 1, 1), BINS_MAX)
    num = columns * num_rows * bins
    nowhere = np.empty(0, dtype=np.int64)
    near = NearAircraft(
        west, south, width, first, columns, num_rows, bins, np.zeros(num + 1, dtype=np.int64), nowhere
    )
    total = list_near(pursuers, near, nowhere)
    near = near._replace(ends=np.cumsum(near.ends), listed=np.empty(total, dtype=np.int64))
    list_near(pursuers, near, np.zeros(num, dtype=np.int64))
    return pursuers._replace(near=near)
