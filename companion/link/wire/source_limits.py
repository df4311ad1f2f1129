"""How much is taken from each source: a bucket that fills with time and empties with frames."""

from __future__ import annotations

from collections.abc import Collection

BURST_S = 2.0
SOURCES_MAX = 1_000  # more are forgotten, the oldest first: a flood of ids must not fill the memory


class SourceLimits:
    """Which frames of others than the own autopilot are taken.

    Parameters
    ----------
    rate_max_hz : float
        Frames a second from one system and component; bursts of two seconds' worth pass.
    systems : collection of int, optional
        System ids that are listened to at all; left out, every one.
    """

    def __init__(self, rate_max_hz: float, systems: Collection[int] | None = None) -> None:
        self._rate_hz = rate_max_hz
        self._systems = None if systems is None else frozenset(systems)
        self._buckets: dict[tuple[int, int], tuple[float, float]] = {}

    def refusal(self, system_id: int, component_id: int, stamp_s: float) -> str:
        """Why a frame is not taken, '' if it is."""
        if self._systems is not None and system_id not in self._systems:
            return "unlisted_system"
        key, full = (system_id, component_id), BURST_S * self._rate_hz
        left, since = self._buckets.pop(key, (full, stamp_s))
        left = min(full, left + max(0.0, stamp_s - since) * self._rate_hz)
        if len(self._buckets) >= SOURCES_MAX:
            del self._buckets[next(iter(self._buckets))]
        if left < 1.0:
            self._buckets[key] = left, stamp_s
            return "rate_limited"
        self._buckets[key] = left - 1.0, stamp_s
        return ""
