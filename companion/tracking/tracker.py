"""All tracked vehicles: what is believed, who is followed, and for how long."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from companion.frames import LocalFrame
from companion.tracking.threat_assigner import ThreatAssigner, VehicleClassSettings
from companion.tracking.track import Detection, Track, TrackSettings
from companion.types.events import Emitter, TrackReport
from companion.types.threat import DynamicThreat, TrackState


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
    future_tolerance_s : float
        How far ahead of the clock a detection may be dated [s].
    range_max_m : float
        Farthest believable distance from the frame's origin; the frame itself reaches no farther [m].
    altitude_max_m : float
        Largest believable magnitude of the altitude above mean sea level [m].
    speed_max_m_s : float
        Largest believable reported speed [m/s].
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
    future_tolerance_s: float = 0.5
    range_max_m: float = 100_000.0
    altitude_max_m: float = 20_000.0
    speed_max_m_s: float = 400.0
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
        ``duplicate``, ``teleporting``, ``crowded``. Ended tracks as ``aged_out`` and ``evicted``.
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
        self._centre_m = (0.0, 0.0)
        self.counters: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._tracks)

    def note_ownship(self, east_m: float, north_m: float) -> None:
        """Tell where the aircraft is: with too many vehicles, those near it are followed."""
        if math.isfinite(east_m) and math.isfinite(north_m):
            self._centre_m = (east_m, north_m)

    def observe(self, report: TrackReport, now_s: float) -> None:
        """Take in a report; what cannot be true is dropped and counted, never raised."""
        self._end_old(now_s)
        detection = self._believed(report, now_s)
        if isinstance(detection, str):
            self.counters[detection] += 1
            return
        track = self._tracks.get(report.identity)
        if track is not None:
            self.counters[track.observe(detection)] += 1
        elif self._has_room(detection, now_s):
            self._initiate(report.identity, detection)

    def tracks(self, now_s: float) -> tuple[TrackState, ...]:
        """Return all vehicles as estimated at an instant, sorted by identity."""
        self._end_old(now_s)
        return tuple(self._tracks[identity].state(now_s) for identity in sorted(self._tracks))

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

    def _initiate(self, identity: str, detection: Detection) -> None:
        east, north, _ = detection.position_enu_m
        vehicle_class = self._assigner.assigned(identity, east, north, is_airborne=detection.is_airborne)
        name = hashlib.sha256(identity.encode()).digest()
        generator = np.random.default_rng([self._seed, int.from_bytes(name[:16], "big")])
        self._tracks[identity] = Track(identity, vehicle_class, detection, self._settings.track, generator)
        self.counters["initiated"] += 1

    def _has_room(self, detection: Detection, now_s: float) -> bool:
        """Whether a new track fits; the least interesting one makes room if it is less than this."""
        if len(self._tracks) < self._settings.num_tracks_max:
            return True

        centre_east, centre_north = self._centre_m

        def interest(stamp_s: float, horizontal_m: np.ndarray) -> tuple[bool, float]:
            """Sort key of a vehicle at ``horizontal_m``, shape (2,), east and north [m]; less is nearer."""
            is_stale = now_s - stamp_s > self._settings.stale_after_s
            return is_stale, math.hypot(horizontal_m[0] - centre_east, horizontal_m[1] - centre_north)

        ranked = [
            (interest(track.observed_s, track.place_m), identity) for identity, track in self._tracks.items()
        ]
        worst, identity = max(ranked)
        if worst <= interest(detection.stamp_s, detection.horizontal_m):
            self.counters["crowded"] += 1
            return False
        self._end(identity, "evicted")
        return True

    def _end_old(self, now_s: float) -> None:
        limit = now_s - self._settings.drop_after_s
        for identity in [name for name, track in self._tracks.items() if track.observed_s < limit]:
            self._end(identity, "aged_out")

    def _end(self, identity: str, reason: str) -> None:
        self._assigner.release(self._tracks.pop(identity).vehicle_class)
        self.counters[reason] += 1
