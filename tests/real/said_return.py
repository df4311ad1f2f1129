"""How far an aircraft that returns is from the way that the service last said a return would take."""

from collections import Counter

import numpy as np

from companion.recording.mcap_reader import messages_of

AHEAD_M = 150.0  # On the way that was said, the aircraft is looked for this far ahead of where it was.
PIECE_M = 2.0
END_M = 400.0  # So near to its end the way is not compared: on the circle there a landing begins.


def said_return(folder):
    """The way of a return that the page showed last before it began, shape (K, 2) [m]; None without one.

    While the aircraft returns, and in the modes of a pilot, the page shows none.
    """
    said = None
    for recording in sorted(folder.glob("recordings/*/flight.mcap")):
        for topic, message in messages_of(recording, Counter()):
            way = message["returns"]["way_enu_m"] if topic == "/standing" else []
            said = np.array(way)[:, :2] if len(way) > 1 else said
    return said


def farthest_from(said, flown):
    """The largest distance of a flown track from a way, up to the circle or landing at its end [m].

    Parameters
    ----------
    said : ndarray, shape (K, 2)
        East, north along the way [m].
    flown : ndarray, shape (N, 2)
        The same of the aircraft, from the begin of the return on.
    """
    lengths = np.concatenate([[0.0], np.linalg.norm(np.diff(said, axis=0), axis=1).cumsum()])
    along = np.arange(0.0, lengths[-1], PIECE_M)
    points = np.column_stack([np.interp(along, lengths, said[:, axis]) for axis in (0, 1)])
    compared = np.flatnonzero(np.linalg.norm(points - said[-1], axis=1) > END_M)
    row, farthest = 0, 0.0
    for place in flown:
        ahead = np.linalg.norm(points[row : row + round(AHEAD_M / PIECE_M)] - place, axis=1)
        row += int(ahead.argmin())
        if not len(compared) or row >= compared[-1]:
            break
        farthest = max(farthest, float(ahead.min()))
    return farthest
