"""Estimates from recorded flights how well the aircraft's turns are coordinated."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from companion.frames import FloatArray
from companion.research.identification.noise_estimate import NORMAL_95, NoiseKey

NAME = "coordination"
TURNS_MIN = 5  # With fewer turns nothing is estimated.
RANGE = 0.5, 1.0  # That of the mission file's key.


def coordination_key(turns: Sequence[FloatArray]) -> NoiseKey:
    """Return the share of a coordinated turn's rate at which an aircraft turns, with a 95 % interval.

    It is the ratio of two sums over the turns. Its variance is that of a ratio estimator: turns count as
    independent (Cochran, *Sampling Techniques*, Wiley 1977, eq. 6.13).

    Parameters
    ----------
    turns : sequence of ndarray, shape (3,)
        Turns of all recordings, see :class:`~companion.research.identification.turn_samples.TurnListener`.
    """
    if len(turns) < TURNS_MIN:
        note = f"too little: {len(turns)} turns with 15 to 60° of bank; {TURNS_MIN} are needed"
        return NoiseKey(NAME, None, math.nan, math.nan, note)
    seconds, turned, squares = np.array(turns).T
    share = float(turned.sum() / squares.sum())
    residuals = turned - share * squares
    variance = float(residuals @ residuals) * len(turns) / (len(turns) - 1)
    half = NORMAL_95 * math.sqrt(variance) / float(squares.sum())
    note = f"{len(turns)} turns, {seconds.sum():.0f} s"
    value = float(np.clip(share, *RANGE))
    if value != share:
        note += f"; {share:.2f} was measured"
    return NoiseKey(NAME, value, share - half, share + half, note)
