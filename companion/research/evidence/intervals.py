"""95 % intervals of means, medians, shares, paired differences and risk ratios.

References
----------
.. [1] Efron, Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 13 (percentile intervals).
.. [2] Wilson, "Probable Inference, the Law of Succession, and Statistical Inference", JASA 22, 1927.
.. [3] Agresti, Min, "Simple Improved Confidence Intervals for Comparing Matched Proportions",
   Statistics in Medicine 24, 2005: half a pair is added to each of the four cells.
.. [4] Clopper, Pearson, "The Use of Confidence or Fiducial Limits", Biometrika 26, 1934.

Notes
-----
With few values percentile intervals are too narrow: with ten values about 90 % of them contain the true
mean, with three 75 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from companion.frames import FloatArray

RESAMPLES = 2_000
SEED = 1
LEVEL = 0.95
_Z = 1.959963984540054  # 97.5 % quantile of the normal distribution.
_Z_POWER = 0.8416212335729143  # 80 % quantile of the same.


class Interval(NamedTuple):
    """An estimate and the ends of its 95 % interval."""

    value: float
    low: float
    high: float

    @property
    def excludes_zero(self) -> bool:
        """Whether zero is outside the interval."""
        return self.low > 0.0 or self.high < 0.0


def bootstrap(values: FloatArray, statistic: Callable[..., Any] = np.mean) -> Interval:
    """Percentile interval of a statistic, from 2,000 seeded resamples.

    Parameters
    ----------
    values : ndarray, shape (N,)
        At least one value.
    statistic : callable
        Mean or median, with an ``axis``.
    """
    if len(values) == 0:
        raise ValueError("an interval of no values")
    chosen = np.random.default_rng(SEED).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.quantile(statistic(values[chosen], axis=1), [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0])
    return Interval(float(statistic(values)), float(low), float(high))


def wilson(successes: int, runs: int) -> Interval:
    """Share of successes with Wilson's interval; between 0 and 1 where there are no runs."""
    if runs == 0:
        return Interval(math.nan, 0.0, 1.0)
    share, z2 = successes / runs, _Z**2
    middle = (share + z2 / (2.0 * runs)) / (1.0 + z2 / runs)
    half = _Z / (1.0 + z2 / runs) * math.sqrt(share * (1.0 - share) / runs + z2 / (4.0 * runs**2))
    low = 0.0 if successes == 0 else middle - half  # The formula misses 0 by rounding.
    return Interval(share, low, 1.0 if successes == runs else middle + half)


def paired_shares(first: FloatArray, second: FloatArray) -> Interval:
    """Difference of two shares on the same seeds, first less second, with Agresti and Min's interval.

    Parameters
    ----------
    first, second : ndarray, shape (N,)
        1 or 0 for each seed.
    """
    only_first, only_second = float((first > second).sum()), float((second > first).sum())
    runs = len(first) + 2.0
    middle = (only_first - only_second) / runs
    variance = (only_first + only_second + 1.0 - (only_first - only_second) ** 2 / runs) / runs**2
    half = _Z * math.sqrt(variance)
    value = (only_first - only_second) / len(first) if len(first) else math.nan
    return Interval(value, max(-1.0, middle - half), min(1.0, middle + half))


def runs_to_decide(differences: FloatArray) -> int | None:
    """Number of runs that show such a difference in 80 of 100 campaigns; None if there is no difference.

    ``n = ((z_0.975 + z_0.8) s / d)²`` of the paired differences' mean d and standard deviation s.

    Parameters
    ----------
    differences : ndarray, shape (N,)
        Paired differences of at least two runs.
    """
    mean = float(np.mean(differences))
    if mean == 0.0:
        return None
    return math.ceil(((_Z + _Z_POWER) * float(np.std(differences, ddof=1)) / mean) ** 2)


def risk_ratio(happened: FloatArray, would_happen: FloatArray) -> Interval:
    """Number of events with a service over that without it, on the same encounters.

    The interval is the percentile one of 2,000 seeded resamples of the pairs. A resample without any event
    in ``would_happen`` has an infinite ratio. Where nothing ``happened``, the upper end is instead the exact
    limit of Clopper and Pearson for no event in N, ``1 - 0.025^(1/N)``, over the share that ``would_happen``,
    which is then taken as known [4]_.

    Parameters
    ----------
    happened, would_happen : ndarray, shape (N,)
        1 or 0 for each encounter, with the service and without it.
    """
    runs, expected = len(happened), float(np.sum(would_happen))
    if expected == 0.0:
        return Interval(math.nan, 0.0, math.inf)
    value = float(np.sum(happened)) / expected
    if value == 0.0:
        return Interval(0.0, 0.0, (1.0 - (0.5 - LEVEL / 2.0) ** (1.0 / runs)) * runs / expected)
    cells = np.bincount((2 * (happened > 0.0) + (would_happen > 0.0)).astype(int), minlength=4)
    counts = np.random.default_rng(SEED).multinomial(runs, cells / runs, size=RESAMPLES)
    events, others = counts[:, 2] + counts[:, 3], counts[:, 1] + counts[:, 3]
    ratios = np.full(RESAMPLES, math.inf)
    np.divide(events, others, out=ratios, where=others > 0)
    ends = [0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0]
    low, high = np.quantile(ratios, ends, method="closest_observation")
    return Interval(value, float(low), float(high))
