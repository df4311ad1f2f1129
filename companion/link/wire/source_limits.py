"""Rate limits per sender and for all senders together, which bound the work that other senders can cause."""

from __future__ import annotations

from collections.abc import Collection

from companion.token_bucket import TokenBucket, get_or_create

BURST_S = 2.0  # A burst may use the budget of this time at once.
SOURCES_MAX = (
    1_000  # The oldest of more sources are forgotten, so that a flood of ids cannot fill the memory.
)
KNOWN_AFTER_S = (
    10.0  # A source is known after this time. It then does not share the budget of unknown sources.
)
KNOWN_MAX = 16
FORGOTTEN_AFTER_S = 60.0  # A known source that is silent for this time may be replaced.
UNKNOWN_SOURCES_RATE_MAX_HZ = 500.0  # All unknown sources share this budget.
VEHICLE_RATE_MAX_HZ = 2_000.0  # A line at 921,600 baud carries this many messages of the smallest size.

Source = tuple[int, int]  # System id and component id.


class SourceLimits:
    """Decides by sender and rate which frames are accepted.

    Parameters
    ----------
    rate_max_hz : float
        Maximum rate of frames from one system and component [Hz]; bursts of two seconds' worth pass.
    systems : collection of int, optional
        System ids that are accepted; by default all.
    """

    def __init__(self, rate_max_hz: float, systems: Collection[int] | None = None) -> None:
        self._rate_hz = rate_max_hz
        self._systems = None if systems is None else frozenset(systems)
        self._buckets: dict[Source, TokenBucket] = {}
        self._known: dict[Source, tuple[float, float]] = {}  # Times of the first and the last frame [s].
        self._unknown_sources = TokenBucket(
            UNKNOWN_SOURCES_RATE_MAX_HZ, BURST_S * UNKNOWN_SOURCES_RATE_MAX_HZ
        )
        self._vehicle = TokenBucket(VEHICLE_RATE_MAX_HZ, BURST_S * VEHICLE_RATE_MAX_HZ)

    def refusal(self, system_id: int, component_id: int, stamp_s: float, *, is_vehicle: bool = False) -> str:
        """Return why a frame is refused, '' if it is accepted.

        Parameters
        ----------
        system_id, component_id : int
            Sender of the frame.
        stamp_s : float
            Time of arrival on the service's clock [s].
        is_vehicle : bool
            True for a frame of the vehicle's autopilot, which has its own budget.
        """
        if is_vehicle:
            return "" if self._vehicle.takes(stamp_s) else "vehicle_rate_limited"
        if self._systems is not None and system_id not in self._systems:
            return "unlisted_system"
        source = system_id, component_id
        bucket = get_or_create(self._buckets, source, self._bucket, SOURCES_MAX)
        if not bucket.takes(stamp_s):
            return "rate_limited"
        if not self._is_known(source, stamp_s) and not self._unknown_sources.takes(stamp_s):
            return "total_limited"
        return ""

    def _bucket(self) -> TokenBucket:
        return TokenBucket(self._rate_hz, BURST_S * self._rate_hz)

    def _is_known(self, source: Source, stamp_s: float) -> bool:
        """Return whether a source has sent for a while; 16 sources are remembered until they are silent."""
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
