"""How much is taken from each source, and from all together: the work that strangers cause has a bound."""

from __future__ import annotations

from collections.abc import Collection

from companion.token_bucket import TokenBucket, kept_for

BURST_S = 2.0
SOURCES_MAX = 1_000  # more are forgotten, the oldest first: a flood of ids must not fill the memory
KNOWN_AFTER_S = 10.0  # a source heard for so long keeps its own share when strangers crowd in
KNOWN_MAX = 16
FORGOTTEN_AFTER_S = 60.0
STRANGERS_RATE_MAX_HZ = 500.0  # of all sources that are not known, together
VEHICLE_RATE_MAX_HZ = 2_000.0  # a line at 921,600 baud carries so many of the smallest messages

Source = tuple[int, int]  # system, component


class SourceLimits:
    """Which frames are taken, by who sent them and how much of it came.

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
        self._buckets: dict[Source, TokenBucket] = {}
        self._known: dict[Source, tuple[float, float]] = {}  # first and last heard [s], of sixteen at most
        self._strangers = TokenBucket(STRANGERS_RATE_MAX_HZ, BURST_S * STRANGERS_RATE_MAX_HZ)
        self._vehicle = TokenBucket(VEHICLE_RATE_MAX_HZ, BURST_S * VEHICLE_RATE_MAX_HZ)

    def refusal(self, system_id: int, component_id: int, stamp_s: float, *, is_vehicle: bool = False) -> str:
        """Why a frame is not taken, '' if it is.

        Parameters
        ----------
        system_id, component_id : int
            Who sent it.
        stamp_s : float
            When it came, by the clock [s].
        is_vehicle : bool
            Whether it is the own autopilot's, which has a budget of its own.
        """
        if is_vehicle:
            return "" if self._vehicle.takes(stamp_s) else "vehicle_rate_limited"
        if self._systems is not None and system_id not in self._systems:
            return "unlisted_system"
        source = system_id, component_id
        bucket = kept_for(self._buckets, source, self._bucket, SOURCES_MAX)
        if not bucket.takes(stamp_s):
            return "rate_limited"
        if not self._is_known(source, stamp_s) and not self._strangers.takes(stamp_s):
            return "total_limited"
        return ""

    def _bucket(self) -> TokenBucket:
        return TokenBucket(self._rate_hz, BURST_S * self._rate_hz)

    def _is_known(self, source: Source, stamp_s: float) -> bool:
        """Whether a source has been heard for a while; sixteen are remembered until they fall silent."""
        first_s, last_s = self._known.get(source, (stamp_s, stamp_s))
        if stamp_s - last_s > FORGOTTEN_AFTER_S:
            first_s = stamp_s
        if source in self._known or self._has_room(stamp_s):
            self._known[source] = first_s, stamp_s
        return stamp_s - first_s >= KNOWN_AFTER_S

    def _has_room(self, stamp_s: float) -> bool:
        if len(self._known) < KNOWN_MAX:
            return True
        oldest, (_, last_s) = min(self._known.items(), key=lambda entry: entry[1][1])
        if stamp_s - last_s <= FORGOTTEN_AFTER_S:
            return False
        del self._known[oldest]
        return True
