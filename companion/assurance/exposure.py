"""The threat level of a path, computed anew from the sighted threats; no number of the planner is used.

Radars follow formula (1), with lines of sight against the prisms themselves. Moving threats are bounded by
what they can do: from where they were sighted, on the shortest path round corners, at full speed, and nearer
by twice the deviation of their position. Aircraft that only pass are nearer by that deviation. Several
threats combine by the A-IFS of paper 3.1 and 3.3, for an aircraft whose position is known (δ = 0). Plain
NumPy and shapely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.assurance.surroundings.sight_lines import SightLines
from companion.frames import FloatArray
from companion.types.path import Path
from companion.types.threat import Obstacle, Radar, ThreatPicture, TrackState

SPREADS_S = 30.0  # The position of an aircraft that passes becomes less certain up to this time ahead.
EYE_M = 2.0  # The eye of a ground vehicle is this high above the ground.
DEVIATIONS = 2.0  # A pursuer is assumed nearer by this many standard deviations of its position.
SPACING_M = 30.0  # Between rows farther apart, further points are examined.
CORNER_M = 1.0  # Paths of ground vehicles pass an obstacle's corner at this distance.


@dataclass(frozen=True, slots=True, kw_only=True)
class ExposureModel:
    """Parameters of the threat model.

    Parameters
    ----------
    airspeed_min_m_s, airspeed_max_m_s, penetration_speed_m_s : float
        v_min, v_max, v_p of the non-membership [m/s].
    weight_count, exponent : float
        ω_N and ω_C of (2).
    is_literal : bool
        Whether (2) is used as printed, without the shift.
    is_plane : bool
        Whether threats are assumed at the aircraft's height.
    """

    airspeed_min_m_s: float
    airspeed_max_m_s: float
    penetration_speed_m_s: float
    weight_count: float = 0.7
    exponent: float = 1.0
    is_literal: bool = False
    is_plane: bool = True


class Exposure:
    """Threat levels in one world.

    Parameters
    ----------
    walls : sequence of Obstacle
        What blocks sight, and what ground vehicles drive round.
    bounds : tuple of float
        East and north, each low and high [m]; nothing drives beyond them. Further numbers are ignored.
    model : ExposureModel
        Parameters of the threat model.
    ground : GroundHeights, optional
        Ground that blocks sight, too.
    """

    def __init__(
        self, walls: Sequence[Obstacle], bounds: Sequence[float], model: ExposureModel,
        ground: GroundHeights | None = None,
    ) -> None:  # fmt: skip
        self._sight = SightLines(walls, ground)
        self._bounds = bounds
        self._model = model

    def levels(self, path: Path, picture: ThreatPicture) -> FloatArray:
        """Return the threat level of each row, or of the worst point since the row before.

        Parameters
        ----------
        path : Path
            The path; only positions, times, courses and airspeeds are used.
        picture : ThreatPicture
            The sighted threats.

        Returns
        -------
        ndarray, shape (N,)
            Threat levels in [0, 1].
        """
        at = _Flight.along(path)
        exposures = [self._to_radar(at, radar) for radar in picture.radars]
        exposures += [
            self._to_passing(at, track) if track.flies_on else self._to_track(at, track)
            for track in picture.tracks
        ]
        if not exposures:
            return np.zeros(len(path))
        mu = np.array([exposure[0] for exposure in exposures])
        nu = np.array([exposure[1] for exposure in exposures])
        found = np.zeros(len(path))
        np.maximum.at(found, at.rows, _aggregated(mu, nu, self._model))
        return found

    def _to_radar(self, at: _Flight, radar: Radar) -> tuple[FloatArray, FloatArray]:
        """Return membership and non-membership (K,) of one radar."""
        place = np.tile(np.asarray(radar.position_enu_m), (len(at.rows), 1))
        if self._model.is_plane:
            place[:, 2] = at.places[:, 2]
        away = place - at.places
        flat = np.hypot(away[:, 0], away[:, 1])
        ranges = np.hypot(flat, away[:, 2])
        reach = radar.max_threat_radius_m
        seen = (ranges <= reach) & (-away[:, 2] >= radar.boundary_coefficient_per_m * flat**2)
        if radar.lowest_seen_m is not None:
            seen &= at.places[:, 2] >= radar.lowest_seen_m(at.places[:, :2])
        near = np.flatnonzero(seen)
        seen[near] = self._sight.is_free(place[near], at.places[near])
        return _pair(at, away, ranges, reach, seen, self._model)

    def _to_track(self, at: _Flight, track: TrackState) -> tuple[FloatArray, FloatArray]:
        """Return membership and non-membership (K,) of the worst that one moving threat can do."""
        posts, delays = self._posts(track)
        nearer = DEVIATIONS * _deviation(track, (0, 2))
        reach, speed = track.max_threat_radius_m, track.speed_max_m_s
        left = at.times - track.stamp_s - delays[:, None]  # (P, K) time left to drive on from each post [s]
        flat = np.linalg.norm(posts[:, None, :2] - at.places[None, :, :2], axis=2)
        post, row = np.nonzero((left >= 0.0) & (flat <= reach + nearer + speed * np.maximum(left, 0.0)))
        there, here = posts[post], at.places[row]
        if self._model.is_plane:
            there[:, 2] = here[:, 2]
        there = self._advanced(track, there, here, speed * left[post, row], nearer)
        ranges = np.linalg.norm(there - here, axis=1)
        eye = np.array([0.0, 0.0, 0.0 if self._model.is_plane or track.is_airborne else EYE_M])
        seen = ranges <= reach
        near = np.flatnonzero(seen)
        seen[near] = self._sight.is_free(there[near] + eye, here[near])
        mu, nu = _pair(at.at(row), there - here, ranges, reach, seen, self._model)
        order = np.argsort(mu - nu, kind="stable")  # The worst of each row comes last.
        worst_mu, worst_nu = np.zeros(len(at.rows)), np.zeros(len(at.rows))
        worst_mu[row[order]], worst_nu[row[order]] = mu[order], nu[order]
        return worst_mu, worst_nu

    def _to_passing(self, at: _Flight, track: TrackState) -> tuple[FloatArray, FloatArray]:
        """Return membership and non-membership (K,) of an aircraft that flies on as it does."""
        ahead = np.minimum(at.times - track.stamp_s, SPREADS_S)
        away = track.places_enu_m(at.times) - at.places
        is_level, away[:, 2] = np.abs(away[:, 2]) <= track.clear_up_m, 0.0
        place, velocity = _deviation(track, (0, 2)), _deviation(track, (1, 3))
        ranges = np.linalg.norm(away, axis=1)
        spread = np.hypot(place, velocity * ahead) + track.circles_m(at.times)
        nearer = np.maximum(ranges - spread, 0.0)
        seen = is_level & (nearer <= track.max_threat_radius_m)
        mu, _ = _pair(at, away, nearer, track.max_threat_radius_m, seen, self._model)
        return mu, np.zeros(len(mu))  # The own heading does not make such an aircraft less of a threat.

    def _advanced(
        self, track: TrackState, posts: FloatArray, places: FloatArray, far: FloatArray, nearer: float
    ) -> FloatArray:
        """Return where a threat (J, 3) is if it goes from ``posts`` (J, 3) towards ``places`` (J, 3) [m].

        ``far`` (J,) is the distance that it covers [m]. A ground vehicle stays if the line is not free.
        """
        toward = places - posts
        if not track.is_airborne:
            toward[:, 2] = 0.0
            free = self._sight.is_drivable(posts, places)
            far = np.where(free, far, 0.0)
        distance = np.maximum(np.linalg.norm(toward, axis=1), 1e-9)
        share = np.minimum((far + nearer) / distance, 1.0)
        advanced: FloatArray = posts + share[:, None] * toward
        return advanced

    def _posts(self, track: TrackState) -> tuple[FloatArray, FloatArray]:
        """Return a threat's position and the corners in its reach (P, 3) [m], and times to them (P,) [s]."""
        here = np.asarray(track.position_enu_m, dtype=np.float64)
        corners, between = self._corners
        if track.is_airborne or track.speed_max_m_s <= 0.0 or not len(corners):
            return here[None], np.zeros(1)
        posts = np.column_stack([corners, np.full(len(corners), here[2])])
        first = np.linalg.norm(corners - here[:2], axis=1)
        first[~self._sight.is_drivable(np.tile(here, (len(posts), 1)), posts)] = np.inf
        lengths = (first[:, None] + between).min(axis=0)
        is_reached = np.isfinite(lengths)
        delays = np.append(0.0, lengths[is_reached] / track.speed_max_m_s)
        return np.vstack([here[None], posts[is_reached]]), delays

    @cached_property
    def _corners(self) -> tuple[FloatArray, FloatArray]:
        """Corners of walls that stand on the ground (C, 2), and shortest paths between them (C, C) [m]."""
        rings = [
            np.asarray(shapely.buffer(wall, CORNER_M, join_style="mitre").exterior.coords)[:-1]
            for wall in self._sight.grounded
        ]
        corners = np.vstack([np.empty((0, 2)), *rings])
        west, east, south, north = self._bounds[:4]
        inside = (corners[:, 0] >= west) & (corners[:, 0] <= east)
        corners = corners[inside & (corners[:, 1] >= south) & (corners[:, 1] <= north)]
        num = len(corners)
        a, b = np.triu_indices(num, 1)
        spatial = np.column_stack([corners, np.zeros(num)])
        free = self._sight.is_drivable(spatial[a], spatial[b])
        lengths = np.full((num, num), np.inf)
        lengths[a, b] = lengths[b, a] = np.where(
            free, np.linalg.norm(corners[a] - corners[b], axis=1), np.inf
        )
        return corners, shortest_lengths(lengths)


@dataclass(frozen=True, slots=True)
class _Flight:
    """K points of a path, close together, and the row of the path that each belongs to.

    ``places`` (K, 3) [m], ``times`` (K,) [s], ``courses``, ``climbs`` (K,) [rad], ``speeds`` (K,) [m/s],
    ``rows`` (K,).
    """

    places: FloatArray
    times: FloatArray
    courses: FloatArray
    climbs: FloatArray
    speeds: FloatArray
    rows: NDArray[np.int64]

    def at(self, which: NDArray[np.int64]) -> _Flight:
        """Return some of the points, ``which`` (J,)."""
        columns = (self.places, self.times, self.courses, self.climbs, self.speeds)
        places, times, courses, climbs, speeds = (column[which] for column in columns)
        return _Flight(places, times, courses, climbs, speeds, self.rows[which])

    @classmethod
    def along(cls, path: Path) -> _Flight:
        """Return the path's rows, and points between rows that are far apart."""
        lengths = np.linalg.norm(np.diff(path.positions_enu_m, axis=0), axis=1)
        pieces = np.maximum(np.ceil(lengths / SPACING_M), 1.0).astype(int)
        ends = np.repeat(np.arange(1, len(path)), pieces)
        share = np.concatenate([np.arange(1, count + 1) / count for count in pieces]) - 1.0
        at = np.append(0.0, ends + share)
        number = np.arange(len(path))
        columns = [np.interp(at, number, column) for column in path.positions_enu_m.T]
        return cls(
            places=np.column_stack(columns),
            times=np.interp(at, number, path.times_s),
            courses=np.interp(at, number, np.unwrap(path.courses_rad)),
            climbs=np.interp(at, number, path.climb_angles_rad),
            speeds=np.interp(at, number, path.speeds_m_s),
            rows=np.append(0, ends),
        )


def shortest_lengths(lengths: FloatArray) -> FloatArray:
    """Return the shortest paths between all pairs of points, by Floyd and Warshall (CLRS, section 25.2).

    Parameters
    ----------
    lengths : ndarray, shape (N, N)
        Direct distances, infinite if there is no direct path [m].

    Returns
    -------
    ndarray, shape (N, N)
        Lengths of the shortest paths, infinite if there is none [m].
    """
    shortest = lengths.copy()
    np.fill_diagonal(shortest, 0.0)
    for over in range(len(shortest)):
        np.minimum(shortest, shortest[:, over, None] + shortest[None, over, :], out=shortest)
    return shortest


def _deviation(track: TrackState, rows: tuple[int, int]) -> float:
    """Return the largest standard deviation, in any direction, of two of a track's estimates."""
    covariance = np.asarray(track.covariance)[np.ix_(rows, rows)]
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))


def _pair(
    at: _Flight, away: FloatArray, ranges: FloatArray, reach: float, seen: NDArray[np.bool_],
    model: ExposureModel,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return membership (1) and non-membership (K,) of a threat ``away`` (K, 3) at ``ranges`` (K,) [m].

    Both are 0 if the aircraft is not ``seen`` (K,).
    """
    mu = np.where(seen, np.exp(-((ranges / reach) ** 4)), 0.0)
    course = np.column_stack(
        [np.sin(at.courses) * np.cos(at.climbs), np.cos(at.courses) * np.cos(at.climbs), np.sin(at.climbs)]
    )
    cosine = np.einsum("ij,ij->i", away, course) / np.maximum(ranges, 1e-9)
    turned = np.where(ranges > 0.0, 0.5 * (1.0 - cosine), 0.0)  # sin²(α/2)
    share = (at.speeds - model.airspeed_min_m_s) / (model.airspeed_max_m_s - model.airspeed_min_m_s)
    speed = np.where(
        at.speeds < model.penetration_speed_m_s, 0.0, np.sin(0.5 * math.pi * np.minimum(share, 1.0))
    )
    return mu, np.where(mu > 0.0, speed * turned, 0.0)


def _aggregated(mu: FloatArray, nu: FloatArray, model: ExposureModel) -> FloatArray:
    """Return threat levels (K,) from ``mu``, ``nu`` (T, K) of each threat: (2), then IFWA of paper 3.3."""
    count = (mu > 0.0).sum(axis=0)
    base = model.weight_count * count
    with np.errstate(divide="ignore"):
        whole = 1.0 + base if not model.is_literal else base
        certainty = np.where(count > 0, np.clip(1.0 - (1.0 / whole) ** model.exponent, 0.0, 1.0), 0.0)
    mu, nu = certainty * mu, certainty * nu
    nu = np.where((mu <= 0.0) | (mu >= 1.0), 0.0, nu)
    total = np.maximum(mu + nu, 1.0)
    order = np.argsort(-mu / total, axis=0, kind="stable")
    mu, nu = np.take_along_axis(mu / total, order, axis=0), np.take_along_axis(nu / total, order, axis=0)
    free = np.cumprod(1.0 - mu, axis=0)
    exposed = np.arange(len(mu))[:, None] < count
    product_mu = np.where(exposed, free, 1.0).prod(axis=0)
    product_nu = np.where(exposed, np.minimum(nu, free), 1.0).prod(axis=0)
    share = 1.0 / np.maximum(count, 1)
    level: FloatArray = np.where(count > 0, 1.0 - product_mu**share - product_nu**share, 0.0)
    return np.maximum(level, 0.0)
