"""Tracker of all vehicles: which reports are accepted, which vehicles are tracked, and for how long."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.tracking.detection import Detection
from companion.tracking.threat_assigner import ThreatAssigner, VehicleClass, VehicleClassSettings
from companion.tracking.track import Track, TrackSettings
from companion.types.events import Emitter, TrackReport
from companion.types.threat import REPORTED_SPEED_MAX_M_S, DynamicThreat, TrackState

TWIN_DISTANCE = 13.28  # Squared distance that 99 % of true pairs do not exceed, with four degrees of freedom.
TWIN_HEIGHT_M = 100.0  # A barometer may differ from a GPS receiver by this much.
_NEWCOMER = ""  # No identity is empty.
IsKnown = Callable[[str, tuple[float, float, float], float], bool]
# Staleness and distance [m]; staleness and time to the aircraft [s].
_Danger = tuple[tuple[bool, float], tuple[bool, float]]


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Limits on the reports that are accepted and on the number of tracked vehicles.

    Parameters
    ----------
    drop_after_s : float
        Age of the newest detection at which a track ends [s].
    stale_after_s : float
        Age from which a track is replaced first if there are too many [s].
    num_tracks_max : int
        Maximum number of tracks.
    sender_share : float
        Share of the tracks that one sender's vehicles keep when others arrive.
    seniority : float
        A new vehicle replaces a tracked one only if its distance or its time to the aircraft is smaller by
        this factor.
    future_tolerance_s : float
        Largest time by which a detection may be ahead of the clock [s].
    range_max_m : float
        Largest plausible distance from the frame's origin, which is also the limit of the frame [m].
    altitude_max_m : float
        Largest plausible magnitude of the altitude above mean sea level [m].
    speed_max_m_s : float
        Largest plausible reported speed [m/s].
    twin_sightings : int
        Number of successive sightings at which two tracks must agree to be merged.
    position_std_m, position_std_min_m : float
        Standard deviation of a detection that states none, and the smallest one that is accepted [m].
    height_std_min_m, velocity_std_min_m_s : float
        The smallest standard deviations of height [m] and velocity [m/s] that are accepted.
    track : TrackSettings
        Settings of each track.
    classes : VehicleClassSettings
        Assumptions about vehicles that the mission file does not name.
    """

    drop_after_s: float = 60.0
    stale_after_s: float = 10.0
    num_tracks_max: int = 64
    sender_share: float = 0.5
    seniority: float = 0.8
    future_tolerance_s: float = 0.5
    range_max_m: float = 100_000.0
    altitude_max_m: float = 20_000.0
    speed_max_m_s: float = REPORTED_SPEED_MAX_M_S
    twin_sightings: int = 6
    position_std_m: float = 8.0
    position_std_min_m: float = 0.5
    height_std_min_m: float = 1.0
    velocity_std_min_m_s: float = 0.3
    track: TrackSettings = field(default_factory=TrackSettings)
    classes: VehicleClassSettings = field(default_factory=VehicleClassSettings)

    def __post_init__(self) -> None:
        if self.num_tracks_max < 1 or self.drop_after_s <= 0.0:
            raise ValueError("at least one track, for some time")
        if self.position_std_min_m <= 0.0:
            raise ValueError("no detection is exact")


class Tracker:
    """Tracks every vehicle that is reported.

    Parameters
    ----------
    frame : LocalFrame
        Frame of the mission file.
    dynamic_threats : sequence of DynamicThreat
        Threats of the mission file; unknown vehicles get the classes of the settings.
    settings : TrackerSettings, optional
        Limits on the reports that are accepted and on the number of tracked vehicles.
    seed : int
        Each identity has its own random generator, made from this seed and the identity, so that its
        estimates do not depend on other vehicles.

    Attributes
    ----------
    counters : Counter of str
        Reports by result: ``applied``, ``applied_late``, ``initiated``, ``restarted``; dropped reports as
        ``not_finite``, ``out_of_range``, ``future``, ``old``, ``too_late``, ``duplicate``, ``teleporting``,
        ``crowded``. Ended tracks as ``aged_out``, ``evicted``, ``same_as_another`` and ``announced``.
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
        self._merged: dict[str, str] = {}  # Identity of the track of each merged identity.
        self._seen_as_one: Counter[tuple[str, str]] = Counter()
        self._centre_m = self._velocity_m_s = (0.0, 0.0)
        self.counters: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._tracks)

    def note_ownship(
        self, east_m: float, north_m: float, velocity_m_s: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        """Set the aircraft's position and velocity: of too many vehicles the most dangerous are tracked."""
        if all(map(math.isfinite, (east_m, north_m, *velocity_m_s))):
            self._centre_m, self._velocity_m_s = (east_m, north_m), velocity_m_s

    def observe(self, report: TrackReport, now_s: float, is_known: IsKnown | None = None) -> bool:
        """Take a report; impossible reports are dropped and counted, and never raise.

        Parameters
        ----------
        report : TrackReport
            The report.
        now_s : float
            The clock's reading [s].
        is_known : callable, optional
            Returns whether more is known of a vehicle than its reports say, by its identity, its position [m]
            and when that was true [s]. Such a vehicle is not tracked.

        Returns
        -------
        bool
            Whether the vehicle is not known otherwise.
        """
        self._end_old(now_s)
        detection = self._detection(report, now_s)
        if isinstance(detection, str):
            self.counters[detection] += 1
            return True
        if is_known is not None and is_known(report.identity, detection.position_enu_m, detection.stamp_s):
            if report.identity in self._tracks:
                self._end(report.identity, "announced")
            return False
        identity = self._merged.get(report.identity, report.identity)
        track = self._tracks.get(identity)
        if track is not None:
            outcome = track.observe(detection)
            self.counters[outcome] += 1
            if identity != report.identity and outcome == "teleporting":
                del self._merged[report.identity]  # The two vehicles have separated.
            elif track.vehicle_class.flies_on:
                self._note_twin(identity, detection.stamp_s)
        elif self._has_room(report, detection, now_s):
            self._initiate(report, detection)
        return True

    def tracks(self, now_s: float) -> tuple[TrackState, ...]:
        """Return all vehicles as estimated at an instant, sorted by identity."""
        self._end_old(now_s)
        return tuple(self._tracks[identity].state(now_s) for identity in sorted(self._tracks))

    def track(self, identity: str, now_s: float) -> TrackState | None:
        """Return the estimate of one vehicle; None if it is not tracked. Old tracks are not ended."""
        found = self._tracks.get(identity)
        return None if found is None else found.state(now_s)

    def received_s(self, now_s: float) -> dict[str, float]:
        """Return the time of each vehicle's last sighting [s], by identity in sorted order."""
        self._end_old(now_s)
        return {identity: self._tracks[identity].observed_s for identity in sorted(self._tracks)}

    def _detection(self, report: TrackReport, now_s: float) -> Detection | str:
        """Convert a report to the local frame, or return why it is refused."""
        settings = self._settings
        velocity, std = report.velocity_enu_m_s, report.position_std_m
        numbers = [report.stamp_s, report.latitude_deg, report.longitude_deg, report.altitude_amsl_m]
        stds = (std, report.altitude_std_m, report.velocity_std_m_s)
        numbers += [*(velocity or ()), *(report.next_point or ()), *(one for one in stds if one is not None)]
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
            height_std_m=_at_least(report.altitude_std_m, settings.height_std_min_m),
            velocity_std_m_s=_at_least(report.velocity_std_m_s, settings.velocity_std_min_m_s),
            next_enu_m=self._next_point(report),
        )

    def _next_point(self, report: TrackReport) -> tuple[float, float, float] | None:
        """Return where the vehicle says that it flies next [m]; None if that is not plausible."""
        if report.next_point is None:
            return None
        latitude, longitude, altitude = report.next_point
        if abs(latitude) > 90.0 or abs(longitude) > 180.0 or abs(altitude) > self._settings.altitude_max_m:
            return None
        east, north, up = self._frame.local_from_global(latitude, longitude, altitude)
        return (east, north, up) if math.hypot(east, north) <= self._settings.range_max_m else None

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
        """Return whether a new track fits; ends another track for it if necessary.

        One sender's vehicles cannot displace those of another: a sender below its share gets room from one
        above it. Otherwise the least dangerous vehicle gives way to a clearly more dangerous one. Vehicles
        assigned to threats of the mission file are kept, one for each threat.
        """
        if len(self._tracks) < self._settings.num_tracks_max:
            return True
        sender = report.sender
        share = max(1, int(self._settings.sender_share * self._settings.num_tracks_max))
        held = Counter(self._senders.values())
        kept = self._kept_identities()
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

    def _kept_identities(self) -> set[str]:
        """Return the identities that are kept: for each threat of the mission file the oldest track."""
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
        """Return distance [m] and time to the threat [s] of a vehicle at ``place_m``, shape (2,).

        The aircraft is assumed to keep its velocity; a vehicle behind it never becomes a threat.
        """
        east, north = float(place_m[0]) - self._centre_m[0], float(place_m[1]) - self._centre_m[1]
        distance = math.hypot(east, north)
        own = (self._velocity_m_s[0] * east + self._velocity_m_s[1] * north) / max(distance, 1.0)
        if own < 0.0:
            return distance, math.inf
        return distance, max(0.0, distance - kind.max_threat_radius_m) / max(own + kind.speed_m_s, 1.0)

    def _note_twin(self, identity: str, now_s: float) -> None:
        """Merge the tracks of an aircraft that reports itself in two ways, such as ADS-B and Remote ID.

        Two tracks of different kinds of identity that agree at enough successive sightings are one aircraft.
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
                self._merged[ended] = kept
                return

    def _end_old(self, now_s: float) -> None:
        limit = now_s - self._settings.drop_after_s
        for identity in [name for name, track in self._tracks.items() if track.observed_s < limit]:
            self._end(identity, "aged_out")

    def _end(self, identity: str, reason: str) -> None:
        self._assigner.release(identity)
        self._merged = {name: kept for name, kept in self._merged.items() if kept != identity}
        for pair in [pair for pair in self._seen_as_one if identity in pair]:
            del self._seen_as_one[pair]
        del self._tracks[identity], self._senders[identity]
        self.counters[reason] += 1


def _at_least(std: float | None, least: float) -> float | None:
    """Return a reported standard deviation, at least ``least``; None if none was reported."""
    return None if std is None or std <= 0.0 else max(std, least)


def _is_same(one: TrackState, other: TrackState) -> bool:
    """Return whether two tracks may be one aircraft: position, velocity and height agree."""
    difference = _state_of(one) - _state_of(other)
    spread = np.asarray(one.covariance) + np.asarray(other.covariance)
    is_near = float(difference @ np.linalg.solve(spread, difference)) <= TWIN_DISTANCE
    return is_near and abs(one.position_enu_m[2] - other.position_enu_m[2]) <= TWIN_HEIGHT_M


def _state_of(track: TrackState) -> FloatArray:
    """Return east, east speed, north, north speed (4,)."""
    place, velocity = track.position_enu_m, track.velocity_enu_m_s
    return np.array([place[0], velocity[0], place[1], velocity[1]])


def _least_dangerous(danger: Mapping[str, _Danger]) -> str:
    """Return the vehicle that is least dangerous by both distance and time."""
    by_distance = sorted(danger, key=lambda identity: danger[identity][0])
    by_time = sorted(danger, key=lambda identity: (danger[identity][1], danger[identity][0]))
    place = {identity: index for index, identity in enumerate(by_distance)}
    order = {identity: (min(place[identity], index), index) for index, identity in enumerate(by_time)}
    return max(order, key=lambda identity: order[identity])
