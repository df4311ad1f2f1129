"""The charge or fuel left on board, and how fast it falls compared with the model of power."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from companion.types.events import BatteryReported

MAX_AGE_S = 30.0  # The messages are requested every 2 s; after this time without one nothing is known.
WINDOW_S = 60.0  # A minute averages gusts and the motor's changes, and is short against a flight.
SPAN_MIN_S = 30.0  # A rate over less than half the window is too inaccurate.
# A share is reported in whole percent: over five of them the rate is known to a fifth. An aircraft with
# twenty minutes of flight uses five percent in a minute, one with five hours in a quarter of an hour.
SHARE_DROP_MIN = 0.0499  # Five steps, less the rounding of their difference.
LONG_WINDOW_S = 900.0
ROWS_MAX = 2_000  # Two reports a second for the longest window; of more only the newest are kept.
# A share that rises by less follows the voltage when the motor slows down; by more, the battery was changed.
RISE_MAX = 0.05
EXPECTED_MIN_WH = 1e-3  # With less expected energy there is no ratio: the aircraft stands or glides.


@dataclass(frozen=True, slots=True)
class _Row:
    stamp_s: float
    used_wh: float
    expected_wh: float


class BatteryEstimator:
    """Follows the reports of one battery or tank.

    Parameters
    ----------
    capacity_wh : float
        Energy of a full battery or tank, above 0 [Wh].
    """

    def __init__(self, capacity_wh: float) -> None:
        self._capacity_wh = capacity_wh
        self._stamp_s = -math.inf
        self._remaining: tuple[float, float] | None = None  # Time and share.
        self._consumed: tuple[float, float] | None = None  # Time and energy [Wh].
        self._by_charge: deque[_Row] = deque(maxlen=ROWS_MAX)
        self._by_share: deque[_Row] = deque(maxlen=ROWS_MAX)
        self._expected_wh = 0.0
        self._expected: tuple[float, float] | None = None  # Time and power [W] from then on.

    def note_expected(self, now_s: float, power_w: float) -> None:
        """Take the power that the model expects from now on until the next call [W]."""
        if self._expected is not None:
            since_s, held_w = self._expected
            self._expected_wh += held_w * max(now_s - since_s, 0.0) / 3_600.0
        self._expected = (now_s, power_w)

    def observe(self, report: BatteryReported) -> None:
        """Take a report; one that is older than the last is ignored."""
        now_s, capacity_wh = report.stamp_s, self._capacity_wh
        if now_s < self._stamp_s:
            return
        self._stamp_s = now_s
        if self._expected is not None:
            self.note_expected(now_s, self._expected[1])
        if report.remaining is not None:
            self._remaining = (now_s, report.remaining)
            row = _Row(now_s, (1.0 - report.remaining) * capacity_wh, self._expected_wh)
            _append(self._by_share, row, RISE_MAX * capacity_wh)
        if report.consumed_wh is not None:
            self._consumed = (now_s, report.consumed_wh)
            _append(self._by_charge, _Row(now_s, report.consumed_wh, self._expected_wh), 0.0)

    def left_wh(self, now_s: float) -> float | None:
        """Return the energy left [Wh]; None without a fresh report.

        It is the reported share of the capacity. A monitor that reports no share has counted what was used
        since it began, which is taken off a full battery.
        """
        if self._remaining is not None and now_s - self._remaining[0] <= MAX_AGE_S:
            return self._remaining[1] * self._capacity_wh
        if self._consumed is not None and now_s - self._consumed[0] <= MAX_AGE_S:
            return max(0.0, self._capacity_wh - self._consumed[1])
        return None

    def power_w(self, now_s: float) -> float | None:
        """Return the measured power over about the last minute [W]; None if too little was reported."""
        window = self._window(now_s)
        if window is None:
            return None
        first, last = window
        return 3_600.0 * (last.used_wh - first.used_wh) / (last.stamp_s - first.stamp_s)

    def ratio(self, now_s: float) -> float | None:
        """Return how many times as fast as expected the energy falls; None if that is not known.

        Measured and expected energy are those of the same window of time, of about the last minute. If only
        shares are reported, it begins where the battery had at least five percent more.
        """
        return _ratio_of(self._window(now_s))

    def long_ratio(self, now_s: float) -> float | None:
        """Return the same as :meth:`ratio` since the take-off, at most over a quarter of an hour.

        Rising and sinking air changes the ratio of one minute by a tenth, and this one less.
        """
        if self._window(now_s) is None:
            return None
        rows = self._fresh_rows(now_s)
        num_on_ground = sum(row.expected_wh == rows[0].expected_wh for row in rows)
        return _ratio_of((rows[num_on_ground - 1], rows[-1]))

    def _fresh_rows(self, now_s: float) -> Sequence[_Row]:
        """Return the reports of what was consumed, or, if they are too old or none, those of the share."""
        for rows in (self._by_charge, self._by_share):
            if rows and now_s - rows[-1].stamp_s <= MAX_AGE_S:
                return rows
        return ()

    def _window(self, now_s: float) -> tuple[_Row, _Row] | None:
        """Return the first and the last report of the window; None if they are too old or too few."""
        rows = self._fresh_rows(now_s)
        if not rows:
            return None
        last = rows[-1]
        if rows is self._by_charge:
            enough = (row for row in rows if last.stamp_s - row.stamp_s <= WINDOW_S)
        else:
            least_wh = SHARE_DROP_MIN * self._capacity_wh
            enough = (row for row in reversed(rows) if last.used_wh - row.used_wh >= least_wh)
        first = next((row for row in enough if last.stamp_s - row.stamp_s >= SPAN_MIN_S), None)
        return None if first is None else (first, last)


def _ratio_of(window: tuple[_Row, _Row] | None) -> float | None:
    """Return measured over expected energy between two reports; None if almost none is expected."""
    if window is None:
        return None
    first, last = window
    expected_wh = last.expected_wh - first.expected_wh
    return (last.used_wh - first.used_wh) / expected_wh if expected_wh >= EXPECTED_MIN_WH else None


def _append(rows: deque[_Row], row: _Row, rise_max_wh: float) -> None:
    """Add a report and drop those that are too old; after a larger rise of what is left it begins anew."""
    if rows and row.used_wh < rows[-1].used_wh - rise_max_wh:
        rows.clear()
    rows.append(row)
    while rows[0].stamp_s < row.stamp_s - LONG_WINDOW_S:
        rows.popleft()
