"""The track of one vehicle: gating, restart, and the distinction of parked and moving vehicles."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from companion.frames import FloatArray
from companion.tracking.detection import ClimbEstimate, Detection
from companion.tracking.particle_filter import FilterSettings, ParticleFilter, UpdateResult
from companion.tracking.threat_assigner import VehicleClass
from companion.tracking.turn_estimate import TurnEstimate
from companion.types.threat import HEIGHT_STD_M, TrackState

SPEED_COLUMNS = np.array([1, 3])
NEXT_MAX_S = 600.0  # A next point that is farther away in time is not used: the route to it is not known.
MEMORY = 16  # Number of detections with which new ones are compared to find copies.


def chi_square_quantile(probability: float) -> float:
    """Return the quantile of chi-square with two degrees of freedom, ``-2·ln(1 - p)``."""
    return -2.0 * math.log1p(-probability)


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """Thresholds of gating, restart and motion.

    Parameters
    ----------
    gate_probability : float
        Share of true detections that pass the gate.
    gated_before_restart : int
        Number of successive detections outside the gate, each within reach of the one before, after which the
        track starts again from them: then the track is wrong.
    reach_speed_min_m_s : float
        Lowest speed limit for the distance between two detections. The mission file may be wrong by more than
        a gate allows [m/s].
    manoeuvre_share_per_s : float
        Acceleration noise as a share of the class's speed: fast vehicles change their velocity more. A
        vehicle that turns round at 25 m/s, seen once per second with 8 m and 1 m/s, was tracked within 10 m
        with 0.5 (NEES 4.7, ideally 4), and within 14 m with 0.12 (NEES 20).
    acceleration_std_min_m_s2, acceleration_std_max_m_s2 : float
        Bounds of the acceleration noise [m/s²].
    steady_acceleration_std_m_s2 : float
        Acceleration noise of aircraft that fly on, as in a nearly constant velocity model [m/s²].
    moving_probability : float
        Confidence that speed and distance from its place must both have for a vehicle that should be parked
        to count as moving.
    leaving_probability : float
        Confidence at which the distance alone suffices.
    moving_detections : int
        Number of successive detections that must show motion for the vehicle to count as moving.
    copy_window_s : float
        A detection of exactly the same position within this time is a copy [s].
    echo_window_s : float
        The same window for a moving vehicle, which cannot be at the same position again [s].
    filter : FilterSettings
        Settings of the particle filter; the class's acceleration noise replaces its own.
    """

    gate_probability: float = 0.9999
    gated_before_restart: int = 3
    reach_speed_min_m_s: float = 40.0
    manoeuvre_share_per_s: float = 0.5
    acceleration_std_min_m_s2: float = 3.0
    acceleration_std_max_m_s2: float = 12.0
    steady_acceleration_std_m_s2: float = 2.0
    moving_probability: float = 0.9999
    leaving_probability: float = 0.999999
    moving_detections: int = 3
    copy_window_s: float = 0.05
    echo_window_s: float = 3.0
    filter: FilterSettings = field(default_factory=FilterSettings)

    def __post_init__(self) -> None:
        probabilities = (self.gate_probability, self.moving_probability, self.leaving_probability)
        if not (min(probabilities) > 0.0 and max(probabilities) < 1.0):
            raise ValueError("probabilities lie between 0 and 1")
        if min(self.gated_before_restart, self.moving_detections) < 1:
            raise ValueError("one detection is the least that can decide")
        if not 0.0 <= self.acceleration_std_min_m_s2 <= self.acceleration_std_max_m_s2:
            raise ValueError("the least acceleration noise lies below the largest")

    def acceleration_std(self, kind: VehicleClass) -> float:
        """Return the acceleration noise of a vehicle class [m/s²]."""
        if kind.flies_on:
            return self.steady_acceleration_std_m_s2
        share = self.manoeuvre_share_per_s * kind.speed_m_s
        return min(max(share, self.acceleration_std_min_m_s2), self.acceleration_std_max_m_s2)


def route_by(
    now_s: float, place_enu_m: tuple[float, float, float], speed_m_s: float,
    next_enu_m: tuple[float, float, float],
) -> FloatArray | None:  # fmt: skip
    """Return the route of an aircraft that says where it flies next.

    It flies there straight, and on in the same direction and level.

    Parameters
    ----------
    now_s : float
        Clock reading at ``place_enu_m`` [s].
    place_enu_m, next_enu_m : tuple of float
        Where it is, and where it flies next: east, north, up [m].
    speed_m_s : float
        Ground speed of the aircraft [m/s].

    Returns
    -------
    ndarray, shape (3, 4), or None
        The route, as :class:`~companion.types.threat.TrackState` has it; None for an aircraft that is there
        within a second, or that hardly moves.
    """
    here, there = np.array(place_enu_m), np.array(next_enu_m)
    needed_s = math.dist(here[:2], there[:2]) / max(speed_m_s, 1e-3)
    if not 1.0 < needed_s < NEXT_MAX_S:
        return None
    on = there + np.append(there[:2] - here[:2], 0.0) / needed_s
    return np.column_stack([now_s + np.array([0.0, needed_s, needed_s + 1.0]), [here, there, on]])


class Track:
    """A particle filter with gating and restart.

    Parameters
    ----------
    identity : str
        Identity under which the vehicle is reported.
    vehicle_class : VehicleClass
        Capabilities of the vehicle: speed, turns, threat radius.
    first : Detection
        First detection of the track.
    settings : TrackSettings
        Thresholds, and settings of the particle filter.
    generator : numpy.random.Generator
        Source of random numbers for this identity only.
    """

    def __init__(
        self,
        identity: str,
        vehicle_class: VehicleClass,
        first: Detection,
        settings: TrackSettings,
        generator: np.random.Generator,
    ) -> None:
        self.identity = identity
        self.vehicle_class = vehicle_class
        self._settings = settings
        self._generator = generator
        self._seen: deque[tuple[float, tuple[float, float]]] = deque(maxlen=MEMORY)
        self._filter_settings = replace(
            settings.filter, acceleration_std_m_s2=settings.acceleration_std(vehicle_class)
        )
        self._turn, self._climb = TurnEstimate(), ClimbEstimate()
        self._moving_run = 0
        self._place_m, self._place_variance, self._num_at_place = first.horizontal_m, 0.0, 0
        self._start(first, vehicle_class.speed_m_s)

    def _start(self, detection: Detection, speed_max_m_s: float) -> None:
        """Start from a detection, without earlier estimates."""
        self._filter = ParticleFilter(
            stamp_s=detection.stamp_s,
            position_m=detection.horizontal_m,
            position_std_m=detection.position_std_m,
            velocity_m_s=detection.velocity_m_s,
            speed_max_m_s=speed_max_m_s,
            settings=self._filter_settings,
            generator=self._generator,
        )
        self._gated: list[Detection] = []
        self._latest = detection
        self._accept(detection)

    @property
    def is_parked(self) -> bool:
        """Whether the mission file says that the vehicle does not move, and it was not seen moving."""
        return self.vehicle_class.is_stationary and self._moving_run < self._settings.moving_detections

    def observe(self, detection: Detection) -> str:
        """Update the track with a detection.

        Returns
        -------
        str
            ``applied``, ``applied_late`` or ``restarted``; or the reason for dropping it: ``duplicate``,
            ``too_late``, ``teleporting``.
        """
        if self._is_copy(detection):
            return "duplicate"
        reported = detection
        if self.vehicle_class.flies_on:
            noise_m = self._noise_m(self._last_detection, detection)
            detection = detection.without_wrong_velocity(self._last_detection, noise_m)
        if detection.stamp_s < self._filter.stamp_s - self._settings.filter.late_max_s:
            return UpdateResult.TOO_LATE.value
        distance = self._filter.squared_distance(
            detection.stamp_s, detection.horizontal_m, detection.position_std_m
        )
        is_outside = distance > chi_square_quantile(self._settings.gate_probability)
        # After a gap the spread alone would accept a detection from anywhere.
        if not self._is_within_reach(self._latest, detection):
            return self._gate_out(detection)
        if is_outside:
            return self._manoeuvred(detection, reported) or self._gate_out(detection)
        result = self._filter.observe(
            detection.stamp_s, detection.horizontal_m, detection.position_std_m, detection.velocity_m_s,
            detection.velocity_std_m_s,
        )  # fmt: skip
        self._gated.clear()
        self._accept(detection)
        return result.value

    def state(self, now_s: float) -> TrackState:
        """Return the estimate at an instant; between detections it is extrapolated and its spread grows."""
        instant = max(now_s, self._filter.stamp_s)
        mean, covariance = self._filter.moments(instant)
        velocity_up = 0.0
        if self.is_parked:
            mean = self._filter.mean * np.array([1.0, 0.0, 1.0, 0.0])
        elif self._latest.is_airborne:
            velocity_up = self._climb.rate_m_s
        up = self._latest.position_enu_m[2] + velocity_up * (instant - self._latest.stamp_s)
        speed = math.hypot(mean[1], mean[3])
        route = None
        if self.vehicle_class.flies_on and self._latest.next_enu_m is not None:
            route = route_by(instant, (float(mean[0]), float(mean[2]), up), speed, self._latest.next_enu_m)
        return TrackState(
            stamp_s=instant,
            identity=self.identity,
            position_enu_m=(float(mean[0]), float(mean[2]), up),
            velocity_enu_m_s=(float(mean[1]), float(mean[3]), velocity_up),
            covariance=covariance,
            speed_max_m_s=0.0 if self.is_parked else max(self.vehicle_class.speed_m_s, speed),
            max_threat_radius_m=self.vehicle_class.max_threat_radius_m,
            turn_radius_m=self.vehicle_class.turn_radius_m,
            is_airborne=self._latest.is_airborne,
            observed_s=self.observed_s,
            flies_on=self.vehicle_class.flies_on,
            turn_rate_rad_s=self._turn.rate_rad_s,
            height_std_m=self._latest.height_std_m or HEIGHT_STD_M,
            route=route,
        )

    @property
    def _last_detection(self) -> Detection:
        """The newest detection, believed or not."""
        return self._gated[-1] if self._gated else self._latest

    @property
    def observed_s(self) -> float:
        """Time of the newest accepted detection [s]."""
        return self._latest.stamp_s

    @property
    def place_m(self) -> FloatArray:
        """East and north, shape (2,), of the newest accepted detection [m]."""
        return self._latest.horizontal_m

    def _accept(self, detection: Detection) -> None:
        self._seen.append((detection.stamp_s, detection.position_enu_m[:2]))
        if detection.stamp_s >= self._latest.stamp_s:
            self._latest = detection
            reported = detection.velocity_enu_m_s
            self._climb.observe(
                detection.stamp_s, detection.position_enu_m[2], None if reported is None else reported[2]
            )
        if self.vehicle_class.flies_on and detection.velocity_m_s is not None:
            self._turn.observe(detection.stamp_s, detection.velocity_m_s)
        if self.vehicle_class.is_stationary:
            self._watch_parked(detection)

    def _is_copy(self, detection: Detection) -> bool:
        """Return whether this position was reported at this time, or too recently for a moving vehicle.

        A refused report that is sent again confirms nothing, either.
        """
        if self.vehicle_class.flies_on and detection.is_repeat_of(self._last_detection):
            return True
        ages = [
            abs(detection.stamp_s - stamp)
            for stamp, place in self._seen
            if place == detection.position_enu_m[:2]
        ]
        if not ages:
            return False
        window = self._settings.copy_window_s
        if not self.is_parked and self._speed_is_significant():
            window = self._settings.echo_window_s
        return min(ages) <= window

    def _gate_out(self, detection: Detection) -> str:
        """Count a detection outside the gate; restart if enough of them agree."""
        if self._gated and not self._is_within_reach(self._gated[-1], detection):
            self._gated.clear()
        self._gated.append(detection)
        if len(self._gated) < self._settings.gated_before_restart:
            return "teleporting"
        self._moving_run = self._settings.moving_detections  # It is at another place, so it moves.
        first = self._gated[0]
        took = max(abs(detection.stamp_s - first.stamp_s), 1.0)
        if self.vehicle_class.flies_on:
            detection = detection.with_velocity_since(first)
        self._climb = ClimbEstimate()
        self._start(detection, max(self.vehicle_class.speed_m_s, detection.distance_m(first) / took))
        return "restarted"

    def _manoeuvred(self, detection: Detection, reported: Detection) -> str | None:
        """Start again from a detection that the filter did not expect, if the aircraft can have flown there.

        The filter expects nearly constant velocity, and an aircraft that is seen every 15 s may have turned
        right round. How far it can have flown follows from the speed in what was ``reported``, even if that
        velocity is not believed.
        """
        if not self.vehicle_class.flies_on:
            return None
        if not reported.is_flown_from(self._latest, self._noise_m(self._latest, detection)):
            return None
        self._start(detection.with_velocity_since(self._latest), self.vehicle_class.speed_m_s)
        return "restarted"

    def _noise_m(self, earlier: Detection, later: Detection) -> float:
        """Return the largest error of the distance between two detections [m]."""
        position_std = math.hypot(earlier.position_std_m, later.position_std_m)
        return position_std * math.sqrt(chi_square_quantile(self._settings.gate_probability))

    def _is_within_reach(self, earlier: Detection, later: Detection) -> bool:
        speed = max(2.0 * self.vehicle_class.speed_m_s, self._settings.reach_speed_min_m_s)
        speed = max(speed, later.speed_m_s or 0.0)
        reach = speed * abs(later.stamp_s - earlier.stamp_s) + self._noise_m(earlier, later)
        return later.distance_m(earlier) <= reach and later.is_height_within_reach(earlier)

    def _speed_is_significant(self) -> bool:
        """Return whether the estimated velocity is significantly different from zero."""
        velocity = self._filter.mean[SPEED_COLUMNS]
        covariance = self._filter.covariance[np.ix_(SPEED_COLUMNS, SPEED_COLUMNS)]
        distance = float(velocity @ np.linalg.solve(covariance, velocity))
        return distance > chi_square_quantile(self._settings.moving_probability)

    def _watch_parked(self, detection: Detection) -> None:
        """Count successive detections that show motion; learn the vehicle's place from the others.

        The speed alone is not reliable. Over hours its noise exceeds any threshold, and without a reported
        velocity it is too uncertain to show a slow start. A vehicle that drives leaves its place.
        """
        position = self._filter.mean[::2]
        innovation_covariance = self._filter.covariance[::2, ::2] + self._place_variance * np.eye(2)
        away = position - self._place_m
        distance = float(away @ np.linalg.solve(innovation_covariance, away))
        seems_away = distance > chi_square_quantile(self._settings.moving_probability)
        is_away = distance > chi_square_quantile(self._settings.leaving_probability)
        if is_away or (seems_away and self._speed_is_significant()):
            self._moving_run += 1
            return
        self._moving_run = 0
        self._num_at_place += 1
        share = 1.0 / self._num_at_place
        self._place_m = (1.0 - share) * self._place_m + share * detection.horizontal_m
        kept = (1.0 - share) ** 2 * self._place_variance
        self._place_variance = kept + share**2 * detection.position_std_m**2
