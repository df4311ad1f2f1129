"""All tracked vehicles: what is believed, who is followed, and for how long."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.tracking.threat_assigner import ThreatAssigner, VehicleClass, VehicleClassSettings
from companion.tracking.track import Detection, Track, TrackSettings
from companion.types.events import Emitter, TrackReport
from companion.types.threat import DynamicThreat, TrackState

TWIN_DISTANCE = 13.28  # squared, of four degrees of freedom: 99 % of the pairs that are one
TWIN_HEIGHT_M = 100.0  # by which a barometer may be off from a receiver
_NEWCOMER = ""  # no identity is empty
_Danger = tuple[tuple[bool, float], tuple[bool, float]]  # whether stale, and metres; the same, and seconds


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """What is believed and how much is followed.

    Parameters
    ----------
    drop_after_s : float
        Age of the newest detection at which a track ends [s].
    stale_after_s : float
        Age from which a track gives way first when there are too many [s].
    num_tracks_max : int
        As many are followed at once.
    sender_share : float
        Share of them that one sender's vehicles keep when others' come.
    seniority : float
        A newcomer takes the place of one that is followed only if it is nearer by this factor, or could be
        at the aircraft sooner by it.
    future_tolerance_s : float
        How far ahead of the clock a detection may be dated [s].
    range_max_m : float
        Farthest believable distance from the frame's origin; the frame itself reaches no farther [m].
    altitude_max_m : float
        Largest believable magnitude of the altitude above mean sea level [m].
    speed_max_m_s : float
        Largest believable reported speed [m/s].
    twin_sightings : int
        So many times in a row two tracks of one aircraft must agree, to be one.
    position_std_m, position_std_min_m : float
        Accuracy taken where a detection states none, and the best that is believed [m].
    track : TrackSettings
        Gating and starting over of each track.
    classes : VehicleClassSettings
        What is assumed of vehicles that the mission file does not name.
    """

    drop_after_s: float = 60.0
    stale_after_s: float = 10.0
    num_tracks_max: int = 64
    sender_share: float = 0.5
    seniority: float = 0.8
    future_tolerance_s: float = 0.5
    range_max_m: float = 100_000.0
    altitude_max_m: float = 20_000.0
    speed_max_m_s: float = 400.0
    twin_sightings: int = 6
    position_std_m: float = 8.0
    position_std_min_m: float = 0.5
    track: TrackSettings = field(default_factory=TrackSettings)
    classes: VehicleClassSettings = field(default_factory=VehicleClassSettings)

    def __post_init__(self) -> None:
        if self.num_tracks_max < 1 or self.drop_after_s <= 0.0:
            raise ValueError("at least one track, for some time")
        if self.position_std_min_m <= 0.0:
            raise ValueError("no detection is exact")


class Tracker:
    """Follows every vehicle that is reported.

    Parameters
    ----------
    frame : LocalFrame
        The mission file's frame.
    dynamic_threats : sequence of DynamicThreat
        The threats the mission file names; unknown vehicles get the settings' classes.
    settings : TrackerSettings, optional
        What is believed, and how many vehicles are followed.
    seed : int
        Each identity draws from a generator of its own, made from this seed and its name, so that
        its estimates do not depend on whom else is seen.

    Attributes
    ----------
    counters : Counter of str
        Reports by what became of them: ``applied``, ``applied_late``, ``initiated``, ``restarted``;
        dropped ones as ``not_finite``, ``out_of_range``, ``future``, ``old``, ``too_late``,
        ``duplicate``, ``teleporting``, ``crowded``. Ended tracks as ``aged_out``, ``evicted`` and
        ``same_as_another``.
    """

    def __init__(
        self,
        frame: LocalFrame,
        dynamic_threats: Sequence[DynamicThreat] = (),
        settings: TrackerSettings | None = None,
        seed: int = 0,
    ) -> None:
        self._frame = frame
        self._settings = settings or TrackerSettings()
        self._seed = seed
        self._assigner = ThreatAssigner(dynamic_threats, self._settings.classes)
        self._tracks: dict[str, Track] = {}
        self._senders: dict[str, str] = {}
        self._also: dict[str, str] = {}  # other names of those that are followed
        self._seen_as_one: Counter[tuple[str, str]] = Counter()
        self._centre_m = self._velocity_m_s = (0.0, 0.0)
        self.counters: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._tracks)

    def note_ownship(
        self, east_m: float, north_m: float, velocity_m_s: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Tell where the aircraft is and goes: with too many vehicles, the dangerous are followed."""
        if all(map(math.isfinite, (east_m, north_m, *velocity_m_s))):
            self._centre_m, self._velocity_m_s = (east_m, north_m), velocity_m_s

    def observe(self, report: TrackReport, now_s: float) -> None:
        """Take in a report; what cannot be true is dropped and counted, never raised."""
        self._end_old(now_s)
        detection = self._believed(report, now_s)
        if isinstance(detection, str):
            self.counters[detection] += 1
            return
        identity = self._also.get(report.identity, report.identity)
        track = self._tracks.get(identity)
        if track is not None:
            outcome = track.observe(detection)
            self.counters[outcome] += 1
            if identity != report.identity and outcome == "teleporting":
                del self._also[report.identity]  # they have parted
            elif track.vehicle_class.flies_on:
                self._note_twin(identity, detection.stamp_s)
        elif self._has_room(report, detection, now_s):
            self._initiate(report, detection)

    def tracks(self, now_s: float) -> tuple[TrackState, ...]:
        """Return all vehicles as estimated at an instant, sorted by identity."""
        self._end_old(now_s)
        return tuple(self._tracks[identity].state(now_s) for identity in sorted(self._tracks))

    def track(self, identity: str, now_s: float) -> TrackState | None:
        """Return one vehicle as estimated at an instant; None of one that is not tracked. It ends none."""
        found = self._tracks.get(identity)
        return None if found is None else found.state(now_s)

    def received_s(self, now_s: float) -> dict[str, float]:
        """When each vehicle was seen last [s], by identity in their order; without estimating anything."""
        self._end_old(now_s)
        return {identity: self._tracks[identity].observed_s for identity in sorted(self._tracks)}

    def _believed(self, report: TrackReport, now_s: float) -> Detection | str:
        """Bring a report to the local frame, or say why it cannot be true."""
        settings = self._settings
        velocity, std = report.velocity_enu_m_s, report.position_std_m
        numbers = [report.stamp_s, report.latitude_deg, report.longitude_deg, report.altitude_amsl_m]
        numbers += [*(velocity or ()), *(() if std is None else (std,))]
        if not all(map(math.isfinite, numbers)):
            return "not_finite"
        if report.stamp_s > now_s + settings.future_tolerance_s:
            return "future"
        if now_s - report.stamp_s > settings.drop_after_s:
            return "old"
        if not self._is_in_range(report):
            return "out_of_range"
        place = self._frame.local_from_global(
            report.latitude_deg, report.longitude_deg, report.altitude_amsl_m
        )
        if not math.hypot(place[0], place[1]) <= settings.range_max_m:
            return "out_of_range"
        if std is None or std <= 0.0:
            std = settings.position_std_m
        return Detection(
            stamp_s=report.stamp_s,
            position_enu_m=place,
            position_std_m=min(max(std, settings.position_std_min_m), settings.range_max_m),
            velocity_enu_m_s=velocity,
            is_airborne=report.emitter is Emitter.AIR,
        )

    def _is_in_range(self, report: TrackReport) -> bool:
        on_globe = abs(report.latitude_deg) <= 90.0 and abs(report.longitude_deg) <= 180.0
        speed = math.hypot(*(report.velocity_enu_m_s or (0.0,)))
        return (
            on_globe
            and abs(report.altitude_amsl_m) <= self._settings.altitude_max_m
            and speed <= self._settings.speed_max_m_s
        )

    def _initiate(self, report: TrackReport, detection: Detection) -> None:
        identity = report.identity
        east, north, _ = detection.position_enu_m
        kind = self._assigner.assigned(
            identity, east, north, is_airborne=detection.is_airborne, system_id=report.system_id
        )
        name = hashlib.sha256(identity.encode()).digest()
        generator = np.random.default_rng([self._seed, int.from_bytes(name[:16], "big")])
        self._tracks[identity] = Track(identity, kind, detection, self._settings.track, generator)
        self._senders[identity] = report.sender
        self.counters["initiated"] += 1

    def _has_room(self, report: TrackReport, detection: Detection, now_s: float) -> bool:
        """Whether a new track fits.

        One sender's vehicles cannot crowd out those of another: up to its share a sender gets room from one
        that has more than that. Beyond, the least dangerous gives way to what is clearly more so. What the
        mission file names keeps its place, one vehicle for each name.
        """
        if len(self._tracks) < self._settings.num_tracks_max:
            return True
        sender = report.sender
        share = max(1, int(self._settings.sender_share * self._settings.num_tracks_max))
        held = Counter(self._senders.values())
        kept = self._claimants()
        danger = {name: self._danger(name, now_s) for name in self._tracks if name not in kept}
        crowding = {name: key for name, key in danger.items() if held[self._senders[name]] > share}
        if held[sender] >= share:
            danger = {name: key for name, key in danger.items() if self._senders[name] == sender}
        elif crowding:
            self._end(_least_dangerous(crowding), "evicted")
            return True
        east, north, _ = detection.position_enu_m
        kind = self._assigner.kind_of(
            report.identity, east, north, is_airborne=detection.is_airborne, system_id=report.system_id
        )
        near_m, ahead_s = self._approach(detection.horizontal_m, kind)
        ease = self._settings.seniority
        danger[_NEWCOMER] = (False, near_m / ease), (False, ahead_s / ease)
        least = _least_dangerous(danger)
        if least == _NEWCOMER:
            self.counters["crowded"] += 1
            return False
        self._end(least, "evicted")
        return True

    def _claimants(self) -> set[str]:
        """Identities that are kept: of each threat in the mission file the one followed longest."""
        longest: dict[int, str] = {}
        for identity, track in self._tracks.items():
            if track.vehicle_class.number is not None:
                longest.setdefault(track.vehicle_class.number, identity)
        return set(longest.values())

    def _danger(self, identity: str, now_s: float) -> _Danger:
        track = self._tracks[identity]
        is_stale = now_s - track.observed_s > self._settings.stale_after_s
        near_m, ahead_s = self._approach(track.place_m, track.vehicle_class)
        return (is_stale, near_m), (is_stale, ahead_s)

    def _approach(self, place_m: np.ndarray, kind: VehicleClass) -> tuple[float, float]:
        """How far ``place_m``, shape (2,), is [m], and when a vehicle there could harm the aircraft [s].

        The aircraft flies on as it does; what lies behind it cannot, as far as this tells.
        """
        east, north = float(place_m[0]) - self._centre_m[0], float(place_m[1]) - self._centre_m[1]
        distance = math.hypot(east, north)
        own = (self._velocity_m_s[0] * east + self._velocity_m_s[1] * north) / max(distance, 1.0)
        if own < 0.0:
            return distance, math.inf
        return distance, max(0.0, distance - kind.max_threat_radius_m) / max(own + kind.speed_m_s, 1.0)

    def _note_twin(self, identity: str, now_s: float) -> None:
        """An aircraft that tells of itself in two ways, by ADS-B and Remote ID say, is followed once.

        What is told in another way, and was at the same place as fast for so many sightings, is the same.
        """
        own = self._tracks[identity].state(now_s)
        for other, track in self._tracks.items():
            is_other_way = identity.partition(":")[0] != other.partition(":")[0]
            if not track.vehicle_class.flies_on or not is_other_way:
                continue
            pair = (min(identity, other), max(identity, other))
            self._seen_as_one[pair] = self._seen_as_one[pair] + 1 if _is_same(own, track.state(now_s)) else 0
            if self._seen_as_one[pair] >= self._settings.twin_sightings:
                del self._seen_as_one[pair]
                kept, ended = sorted((identity, other), key=lambda name: list(self._tracks).index(name))
                self._end(ended, "same_as_another")
                self._also[ended] = kept
                return

    def _end_old(self, now_s: float) -> None:
        limit = now_s - self._settings.drop_after_s
        for identity in [name for name, track in self._tracks.items() if track.observed_s < limit]:
            self._end(identity, "aged_out")

    def _end(self, identity: str, reason: str) -> None:
        self._assigner.release(identity)
        self._also = {name: kept for name, kept in self._also.items() if kept != identity}
        for pair in [pair for pair in self._seen_as_one if identity in pair]:
            del self._seen_as_one[pair]
        del self._tracks[identity], self._senders[identity]
        self.counters[reason] += 1


def _is_same(one: TrackState, other: TrackState) -> bool:
    """Whether two tracks may be of one aircraft: places, velocities and heights agree as far as known."""
    difference = _state_of(one) - _state_of(other)
    spread = np.asarray(one.covariance) + np.asarray(other.covariance)
    is_near = float(difference @ np.linalg.solve(spread, difference)) <= TWIN_DISTANCE
    return is_near and abs(one.position_enu_m[2] - other.position_enu_m[2]) <= TWIN_HEIGHT_M


def _state_of(track: TrackState) -> FloatArray:
    """East, east speed, north, north speed (4,)."""
    place, velocity = track.position_enu_m, track.velocity_enu_m_s
    return np.array([place[0], velocity[0], place[1], velocity[1]])


def _least_dangerous(danger: Mapping[str, _Danger]) -> str:
    """The vehicle that is least in both orders, by distance and by time: each keeps its first."""
    by_distance = sorted(danger, key=lambda identity: danger[identity][0])
    by_time = sorted(danger, key=lambda identity: (danger[identity][1], danger[identity][0]))
    place = {identity: index for index, identity in enumerate(by_distance)}
    order = {identity: (min(place[identity], index), index) for index, identity in enumerate(by_time)}
    return max(order, key=lambda identity: order[identity])
