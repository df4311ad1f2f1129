"""How far an aircraft that returns is beside the legs of the list that its autopilot holds."""

import itertools
import math

import numpy as np

from companion.types.mission import Command

LANDINGS = (Command.NAV_LAND, Command.NAV_LOITER_TO_ALT)  # Legs of the operator's landing.


def farthest_beside_legs(path, currents, places, commands):
    """The largest distance beside a leg, of positions abeam it [m]; None without any leg.

    The way to the first item is left out, since it begins wherever the aircraft is, and so are landings.

    Parameters
    ----------
    path : ndarray, shape (N, 4)
        Time [s], east, north, up [m].
    currents : list of (float, int)
        From when on which item was flown to [s], from the return on.
    places : list of tuple of float, or None
        Where each item of the list is [m]; None for items without a place.
    commands : list of int
        The items' commands.
    """
    farthest = None
    for (from_s, item), (to_s, _) in itertools.pairwise(currents[1:]):
        before = next((places[n] for n in range(item - 1, -1, -1) if places[n] is not None), None)
        if before is None or places[item] is None or commands[item] in LANDINGS:
            continue
        begin, end = np.array(before[:2]), np.array(places[item][:2])
        length = math.dist(begin, end)
        rows = path[(path[:, 0] > from_s) & (path[:, 0] < to_s), 1:3] - begin
        if length < 1.0 or not len(rows):
            continue
        along = (end - begin) / length
        abeam = (rows @ along > 0.0) & (rows @ along < length)
        beside = np.abs(rows[:, 0] * along[1] - rows[:, 1] * along[0])[abeam]
        if len(beside):
            farthest = max(farthest or 0.0, float(beside.max()))
    return farthest
