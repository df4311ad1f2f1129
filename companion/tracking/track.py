"""One vehicle's track: gating, starting over, and telling a parked vehicle from a moving one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from companion.frames import FloatArray
from companion.tracking.particle_filter import Fate, FilterSettings, ParticleFilter
from companion.tracking.threat_assigner import Kind
from companion.types.threat import TrackState

SPEED_COLUMNS = np.array([1, 3])
MEMORY = 16  # sightings remembered to know a copy by


def chi_square_quantile(probability: float) -> float:
    """Quantile of chi-square with two degrees of freedom, where it is ``-2·ln(1 - p)``."""
    return -2.0 * math.log1p(-probability)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A report in the local frame."""

    stamp_s: float
    position_enu_m: tuple[float, float, float]
    position_std_m: float
    velocity_enu_m_s: tuple[float, float, float] | None
    is_airborne: bool

    @property
    def horizontal_m(self) -> FloatArray:
        """East and north (2,) [m]."""
        return np.array(self.position_enu_m[:2])

    @property
    def velocity_m_s(self) -> FloatArray | None:
        """East and north (2,) of the reported velocity, if there is one [m/s]."""
        return None if self.velocity_enu_m_s is None else np.array(self.velocity_enu_m_s[:2])


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """When a sighting belongs to a track, and when a vehicle moves.

    Parameters
    ----------
    gate_probability : float
        Share of true sightings that passes the gate.
    gated_before_restart : int
        So many sightings in a row outside the gate, each within reach of the one before, and the
        track starts over from them: it is the track that is wrong.
    reach_speed_min_m_s : float
        No vehicle is held to be slower than this when it is asked whether it can have come so far: a
        mission file may be wrong by more than a gate allows [m/s].
    manoeuvre_share_per_s : float
        Acceleration noise as a share of the kind's speed: what is fast changes its velocity by more. A
        vehicle that comes about at 25 m/s, sighted once a second to 8 m and 1 m/s, was followed to
        10 m with 0.5 (NEES 4.7, ideally 4), to 14 m with 0.12 (NEES 20).
    acceleration_std_min_m_s2, acceleration_std_max_m_s2 : float
        Between which the noise stays.
    moving_probability : float
        Confidence with which a vehicle that should be parked must have both speed and distance from
        its place, to count as moving.
    leaving_probability : float
        Confidence with which distance alone is enough.
    moving_sightings : int
        In how many sightings in a row.
    copy_window_s : float
        A sighting of the very same place this close in time is a copy [s].
    echo_window_s : float
        The same, of a vehicle that moves and so cannot be there again [s].
    filter : FilterSettings
        Of the particle filter; its acceleration noise gives way to the kind's.
    """

    gate_probability: float = 0.9999
    gated_before_restart: int = 3
    reach_speed_min_m_s: float = 40.0
    manoeuvre_share_per_s: float = 0.5
    acceleration_std_min_m_s2: float = 3.0
    acceleration_std_max_m_s2: float = 12.0
    moving_probability: float = 0.9999
    leaving_probability: float = 0.999999
    moving_sightings: int = 3
    copy_window_s: float = 0.05
    echo_window_s: float = 3.0
    filter: FilterSettings = field(default_factory=FilterSettings)

    def __post_init__(self) -> None:
        probabilities = (self.gate_probability, self.moving_probability, self.leaving_probability)
        if not (min(probabilities) > 0.0 and max(probabilities) < 1.0):
            raise ValueError("probabilities lie between 0 and 1")
        if min(self.gated_before_restart, self.moving_sightings) < 1:
            raise ValueError("one sighting is the least that can decide")
        if not 0.0 <= self.acceleration_std_min_m_s2 <= self.acceleration_std_max_m_s2:
            raise ValueError("the least acceleration noise lies below the largest")

    def acceleration_std(self, speed_m_s: float) -> float:
        """Acceleration noise of a vehicle of such a speed [m/s²]."""
        share = self.manoeuvre_share_per_s * speed_m_s
        return min(max(share, self.acceleration_std_min_m_s2), self.acceleration_std_max_m_s2)


class Track:
    """A particle filter with what belongs round it.

    Parameters
    ----------
    identity : str
        Whose.
    kind : Kind
        What it can do.
    first : Sighting
        Where it begins.
    generator : numpy.random.Generator
        This identity's own.
    """

    def __init__(
        self,
        identity: str,
        kind: Kind,
        first: Sighting,
        settings: TrackSettings,
        generator: np.random.Generator,
    ) -> None:
        self.identity = identity
        self.kind = kind
        self._settings = settings
        self._generator = generator
        self._seen: deque[tuple[float, tuple[float, float]]] = deque(maxlen=MEMORY)
        self._filter_settings = replace(
            settings.filter, acceleration_std_m_s2=settings.acceleration_std(kind.speed_m_s)
        )
        self._moving_run = 0
        self._place_m, self._place_variance, self._num_at_place = first.horizontal_m, 0.0, 0
        self._start(first, kind.speed_m_s)

    def _start(self, sighting: Sighting, speed_max_m_s: float) -> None:
        """Begin from a sighting, forgetting what was estimated."""
        self._filter = ParticleFilter(
            stamp_s=sighting.stamp_s,
            position_m=sighting.horizontal_m,
            position_std_m=sighting.position_std_m,
            velocity_m_s=sighting.velocity_m_s,
            speed_max_m_s=speed_max_m_s,
            settings=self._filter_settings,
            generator=self._generator,
        )
        self._gated: list[Sighting] = []
        self._latest = sighting
        self._accept(sighting)

    @property
    def is_parked(self) -> bool:
        """Whether it should stand still by the mission file, and was not seen to move."""
        return self.kind.stands and self._moving_run < self._settings.moving_sightings

    def observe(self, sighting: Sighting) -> str:
        """Take in a sighting; return what became of it.

        Returns
        -------
        str
            ``applied``, ``applied_late`` or ``restarted``; or why it was dropped: ``duplicate``,
            ``too_late``, ``teleporting``.
        """
        if self._is_copy(sighting):
            return "duplicate"
        if sighting.stamp_s < self._filter.stamp_s - self._settings.filter.late_max_s:
            return Fate.TOO_LATE.value
        distance = self._filter.squared_distance(
            sighting.stamp_s, sighting.horizontal_m, sighting.position_std_m
        )
        is_outside = distance > chi_square_quantile(self._settings.gate_probability)
        # After a gap the spread alone would let a vehicle have come from anywhere.
        if is_outside or not self._is_within_reach(self._latest, sighting):
            return self._gate_out(sighting)
        fate = self._filter.observe(
            sighting.stamp_s, sighting.horizontal_m, sighting.position_std_m, sighting.velocity_m_s
        )
        self._gated.clear()
        self._accept(sighting)
        return fate.value

    def state(self, now_s: float) -> TrackState:
        """Return the estimate at an instant; between sightings it moves on and its spread grows."""
        instant = max(now_s, self._filter.stamp_s)
        mean, covariance = self._filter.moments(instant)
        velocity_up = 0.0
        if self.is_parked:
            mean = self._filter.mean * np.array([1.0, 0.0, 1.0, 0.0])
        elif self._is_airborne and self._latest.velocity_enu_m_s is not None:
            velocity_up = self._latest.velocity_enu_m_s[2]
        speed = math.hypot(mean[1], mean[3])
        return TrackState(
            stamp_s=instant,
            identity=self.identity,
            position_enu_m=(float(mean[0]), float(mean[2]), self._latest.position_enu_m[2]),
            velocity_enu_m_s=(float(mean[1]), float(mean[3]), velocity_up),
            covariance=covariance,
            speed_max_m_s=0.0 if self.is_parked else max(self.kind.speed_m_s, speed),
            max_threat_radius_m=self.kind.max_threat_radius_m,
            turn_radius_m=self.kind.turn_radius_m,
            is_airborne=self._is_airborne,
            observed_s=self.observed_s,
        )

    @property
    def observed_s(self) -> float:
        """When the newest accepted sighting was true."""
        return self._latest.stamp_s

    @property
    def place_m(self) -> FloatArray:
        """East and north (2,) at the newest accepted sighting [m]."""
        return self._latest.horizontal_m

    @property
    def _is_airborne(self) -> bool:
        return self._latest.is_airborne

    def _accept(self, sighting: Sighting) -> None:
        self._seen.append((sighting.stamp_s, sighting.position_enu_m[:2]))
        if sighting.stamp_s >= self._latest.stamp_s:
            self._latest = sighting
        if self.kind.stands:
            self._watch_parked(sighting)

    def _is_copy(self, sighting: Sighting) -> bool:
        """Whether the very same place was reported at this time, or too lately for a mover."""
        ages = [
            abs(sighting.stamp_s - stamp)
            for stamp, place in self._seen
            if place == sighting.position_enu_m[:2]
        ]
        if not ages:
            return False
        window = self._settings.copy_window_s
        if not self.is_parked and self._speed_is_significant():
            window = self._settings.echo_window_s
        return min(ages) <= window

    def _gate_out(self, sighting: Sighting) -> str:
        """Count a sighting outside the gate; start over when enough of them agree."""
        if self._gated and not self._is_within_reach(self._gated[-1], sighting):
            self._gated.clear()
        self._gated.append(sighting)
        if len(self._gated) < self._settings.gated_before_restart:
            return "teleporting"
        self._moving_run = self._settings.moving_sightings  # it is elsewhere, so it moves
        first = self._gated[0]
        went = float(np.linalg.norm(sighting.horizontal_m - first.horizontal_m))
        took = max(abs(sighting.stamp_s - first.stamp_s), 1.0)
        self._start(sighting, max(self.kind.speed_m_s, went / took))
        return "restarted"

    def _is_within_reach(self, earlier: Sighting, later: Sighting) -> bool:
        speed = max(2.0 * self.kind.speed_m_s, self._settings.reach_speed_min_m_s)
        if later.velocity_enu_m_s is not None:
            speed = max(speed, math.hypot(*later.velocity_enu_m_s[:2]))
        spread = math.hypot(earlier.position_std_m, later.position_std_m)
        reach = speed * abs(later.stamp_s - earlier.stamp_s) + spread * math.sqrt(
            chi_square_quantile(self._settings.gate_probability)
        )
        return bool(np.linalg.norm(later.horizontal_m - earlier.horizontal_m) <= reach)

    def _speed_is_significant(self) -> bool:
        """Whether the estimated velocity differs from zero beyond its own spread."""
        velocity = self._filter.mean[SPEED_COLUMNS]
        spread = self._filter.covariance[np.ix_(SPEED_COLUMNS, SPEED_COLUMNS)]
        distance = float(velocity @ np.linalg.solve(spread, velocity))
        return distance > chi_square_quantile(self._settings.moving_probability)

    def _watch_parked(self, sighting: Sighting) -> None:
        """Count sightings in a row in which it moves; learn its place from the others.

        Speed alone is a poor witness: over hours its noise passes any threshold, and without a
        reported velocity it is so uncertain that a slow start never does. A vehicle that drives
        leaves its place.
        """
        position = self._filter.mean[::2]
        spread = self._filter.covariance[::2, ::2] + self._place_variance * np.eye(2)
        away = position - self._place_m
        distance = float(away @ np.linalg.solve(spread, away))
        seems_away = distance > chi_square_quantile(self._settings.moving_probability)
        is_away = distance > chi_square_quantile(self._settings.leaving_probability)
        if is_away or (seems_away and self._speed_is_significant()):
            self._moving_run += 1
            return
        self._moving_run = 0
        self._num_at_place += 1
        share = 1.0 / self._num_at_place
        self._place_m = (1.0 - share) * self._place_m + share * sighting.horizontal_m
        kept = (1.0 - share) ** 2 * self._place_variance
        self._place_variance = kept + share**2 * sighting.position_std_m**2
