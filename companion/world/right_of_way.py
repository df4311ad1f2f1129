"""The side on which an aircraft that flies on should be passed.

The rules of the air ask for a turn to the right where two meet head-on or on converging courses, and for
nobody to cross ahead of an aircraft that has the right of way [1]_. An unmanned aircraft gives way to all
others [2]_. Together:

- Head-on, overtaking, or where the other comes from the right: it is passed so that it stays on the left.
- Where it comes from the left: it is passed behind, so that it stays on the right.

Seen from the own aircraft, the line of sight to the other turns to the left in the first case, to the right
in the second. The side on which it would turn the other way is the aircraft's *wrong side*.

References
----------
.. [1] ICAO Annex 2, "Rules of the Air", 3.2.2; 14 CFR 91.113 (d) to (f).
.. [2] 14 CFR 107.37.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.frames import FloatArray
from companion.kernels.arrays import Pursuers
from companion.types.threat import TrackState


def wrong_side(track: TrackState, place_m: FloatArray, velocity_m_s: FloatArray) -> tuple[float, float]:
    """Return in which direction from an aircraft its wrong side lies.

    Parameters
    ----------
    track : TrackState
        The aircraft.
    place_m, velocity_m_s : ndarray, shape (2,)
        East and north of the own aircraft, and of the velocity with which it would fly to its goal if nobody
        were there [m], [m/s].

    Returns
    -------
    tuple of float
        East and north, of length 1 where the rule is clear, shorter between the rules, and zero where the
        two would stay well clear of each other, or where the other does not fly on.
    """
    velocity = np.asarray(track.velocity_enu_m_s[:2])
    away, closing = np.asarray(track.position_enu_m[:2]) - place_m, velocity - velocity_m_s
    speed = math.hypot(*closing)
    if not track.flies_on or track.keeps_route or speed == 0.0 or not velocity.any():
        return 0.0, 0.0
    wait_s = max(0.0, -float(away @ closing) / speed**2)
    miss_m = math.hypot(*(away + wait_s * closing))
    if miss_m > track.max_threat_radius_m:
        return 0.0, 0.0
    # The line of sight turns to the right where the own aircraft is on this side of the relative track.
    share = _stays_left(velocity, velocity_m_s) / speed
    return share * float(closing[1]), -share * float(closing[0])


def _stays_left(theirs: FloatArray, own: FloatArray) -> float:
    """Return 1 if the other is to stay on the left, -1 if on the right; less between the two rules.

    By ``theirs`` (2,) and ``own`` (2,) [m/s]: the rule changes at 45° to the own and to the opposite course.
    """
    across = own[0] * theirs[1] - own[1] * theirs[0]
    if across >= 0.0:
        return 1.0  # It flies to the left of the own course: it comes from the right.
    turned = math.atan2(across, float(own @ theirs))
    return math.cos(2.0 * turned)


def with_wrong_sides(
    pursuers: Pursuers, tracks: Sequence[TrackState], place_m: FloatArray, velocity_m_s: FloatArray
) -> Pursuers:
    """Return the pursuers with the wrong sides of those that fly on.

    Parameters
    ----------
    pursuers : Pursuers
        As built from the tracks.
    tracks : sequence of TrackState
        D of them.
    place_m, velocity_m_s : ndarray, shape (2,)
        As in :func:`wrong_side`.
    """
    model = pursuers.model.copy()
    for d, track in enumerate(tracks):
        model[d, 10:12] = wrong_side(track, place_m, velocity_m_s)
    return pursuers._replace(model=model)
