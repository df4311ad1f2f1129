"""Independent check of paths and missions before they are flown.

The module shares no code with the planner and uses plain NumPy and shapely. A fault in a kernel or in the
search can therefore not hide itself here.

What the rows of a path determine
---------------------------------
Between two rows the aircraft flies a curve that the rows only sample: an arc, or an arc and a straight piece
if a turn begins or ends between them. Three rules follow:

- *Clearance* is measured from the chord, less the largest distance of the curve from the chord. For a curve
  of length ``L`` that turns one way by ``Δ``, nowhere tighter than ``r``, that distance is largest with the
  whole turn in the middle: ``L·Δ/4 − r·Δ²/8``. For an arc from end to end it is ``L·Δ/8``.
- *Turn radius* is the mean of the edge: length over course change. No path hides a turn by stating courses
  that it does not fly: chords leave the mean course no farther than with the whole turn at one end, at ``r``.
- *Straight flight* between turns is the sum of the edges without course change, and of the part of the two
  adjacent edges that a turn at the smallest radius does not need. At most one edge length of these parts
  counts: that is the uncertainty of sampling.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from companion.assurance import curves
from companion.assurance.check_limits import CheckLimits
from companion.assurance.curves import CORNER_SIDES, NUMBER_MAX
from companion.assurance.edges import (
    STRAIGHT_COURSE_RAD,
    Edges,
    acceleration_violations,
    bulges,
    edges_of,
    goal_violations,
    straight_violations,
    turn_violations,
)
from companion.assurance.exposure import Exposure
from companion.assurance.ground_speeds import GroundSpeeds, Wind, ground_speeds, slope_over_ground, tailwinds
from companion.assurance.return_to_bounds import OUT_MIN_M, OVERSHOOT_RADII, ReturnToBounds
from companion.assurance.surroundings.ground_heights import TOLERANCE_M, GroundHeights
from companion.assurance.surroundings.prisms import LENGTH_TOLERANCE_M, Prisms
from companion.assurance.violation import Violation, outside, violated
from companion.frames import FloatArray
from companion.types.path import Path
from companion.types.threat import Obstacle, ThreatPicture

BoolArray = NDArray[np.bool_]

POINT_TOLERANCE_M = 0.01  # Rounding of positions, against bounds and goals.
BULGE_TOLERANCE_M = 2.0  # An arc between two rows inside the bounds may pass the bounds by this much.
SPEED_TOLERANCE_M_S = 0.01  # Rounding of airspeeds.
CLIMB_TOLERANCE_RAD = math.radians(0.1)  # Rounding of climb angles.
RATIO_TOLERANCE = 0.02  # Relative tolerance of radii, and of lengths against speeds.
CORNER_TOLERANCE = 0.15  # Relative; waypoints on an arc lie closer together than its tangents meet.
CORNER_MIN_RAD = 0.05  # The arc of a smaller corner is not checked apart from its legs.
LOITER_SIDES = 72  # A loiter circle is checked as a polygon of this many sides.


class Checker:
    """All rules, applied to the obstacles of one world.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        Upright prisms. A polygon that crosses itself is replaced by its convex hull.
    limits : CheckLimits
        The limits of paths and missions.
    exposure : Exposure, optional
        Computes threat levels. If omitted, only the levels that a path states itself are checked.
    ground : GroundHeights, optional
        The ground, and the limits of height over it. An attribute, too; if omitted, there is none.

    Raises
    ------
    ValueError
        If an obstacle has a number that is not finite, or fewer than three corners.
    """

    def __init__(
        self, obstacles: Sequence[Obstacle], limits: CheckLimits, exposure: Exposure | None = None,
        ground: GroundHeights | None = None,
    ) -> None:  # fmt: skip
        self.limits = limits
        self.ground = ground
        self._exposure = exposure
        self._prisms = Prisms(obstacles)
        self._climbs = (-limits.descent_angle_max_rad, limits.climb_angle_max_rad)

    def check_path(
        self, path: Path, *, goal_enu_m: Sequence[float] | None = None,
        acceptance_radius_m: float | None = None, from_row: int = 0,
        wind_enu_m_s: tuple[float, float] = (0.0, 0.0), wind_std_m_s: float = 0.0,
        picture: ThreatPicture | None = None, may_come_back: bool = False,
    ) -> tuple[Violation, ...]:  # fmt: skip
        """Return every rule that a path breaks from a row on; nothing if it may be flown.

        Parameters
        ----------
        path : Path
            The path, as planned or as it is being flown.
        goal_enu_m : sequence of float, optional
            East, north, up of the point at which the path has to end [m].
        acceptance_radius_m : float, optional
            Allowed distance of the end from the goal; 0 if omitted [m].
        from_row : int
            Earlier rows have been flown and are not judged; they still count as the history of later ones.
        wind_enu_m_s : tuple of float
            Velocity of the air over the ground, east and north [m/s].
        wind_std_m_s : float
            Standard deviation of that velocity: times, turns and climbs may be off accordingly [m/s].
        picture : ThreatPicture, optional
            The sighted threats, from which the exposure of the path is computed here.
        may_come_back : bool
            Whether the path may begin where no path may be; see :mod:`companion.assurance.return_to_bounds`.
        """
        num = len(path.times_s)
        table = (path.courses_rad, path.climb_angles_rad, path.speeds_m_s, path.collision_free)
        shapes_fit = (
            all(np.shape(column) == (num,) for column in (*table, path.threat_levels))
            and np.shape(path.positions_enu_m) == (num, 3)
            and np.shape(path.position_covariances_m2) == (num, 3, 3)
        )
        if num < 2 or not shapes_fit:
            return (Violation("rows", 0, float(num), 2.0, "a path needs two rows and columns of one length"),)
        first = min(max(from_row, 0), num - 1)
        with np.errstate(all="ignore"):
            found = list(self._path_violations(path, first, Wind(*wind_enu_m_s, wind_std_m_s)))
            if may_come_back:
                deviation = float(curves.position_deviations(path.position_covariances_m2[:1])[0][0])
                places, spread = path.positions_enu_m, self.limits.deviations * deviation
                found = self._return_to_bounds(places[0], spread).remaining(found, places)
            found += self._exposure_violations(path, first, picture)
            if goal_enu_m is not None:
                found += goal_violations(path, goal_enu_m, acceptance_radius_m or 0.0)
        return tuple(violation for violation in found if violation.row >= first)

    def _path_violations(self, path: Path, first: int, wind: Wind) -> Iterator[Violation]:
        """Check all rows; edges that end at or before ``first`` are not judged."""
        deviations, well_formed = curves.position_deviations(path.position_covariances_m2)
        numbers = np.column_stack(
            [path.times_s, path.positions_enu_m, path.courses_rad, path.climb_angles_rad, path.speeds_m_s]
        )
        usable: BoolArray = np.all(np.abs(numbers) <= NUMBER_MAX, axis=1)
        for row in np.flatnonzero(~usable):
            yield Violation("finite", int(row), math.nan, NUMBER_MAX, "numbers that are not finite")
        for row in np.flatnonzero(~well_formed):
            yield Violation("covariance", int(row), math.nan, 0.0, "covariance is not positive semidefinite")
        edges = edges_of(path, usable)
        yield from self._row_violations(path, usable, first)
        ahead = edges.usable & (edges.rows > first)
        yield from self._edge_violations(path, edges, ahead, ground_speeds(path, edges, wind))
        limits = self.limits
        yield from acceleration_violations(path, edges, ahead, limits.acceleration_max_m_s2)
        yield from straight_violations(edges, limits.turn_radius_min_m, limits.straight_length_min_m, first)
        yield from self._bulge_violations(path, edges, ahead)
        which = np.flatnonzero(ahead & well_formed[:-1] & well_formed[1:])
        spread = self.limits.deviations * np.maximum(deviations[:-1], deviations[1:])
        yield from self._clearance_violations(
            path.positions_enu_m[which],
            path.positions_enu_m[which + 1],
            self.limits.margin_m + spread[which],
            bulges(edges, self.limits.turn_radius_min_m)[which],
            edges.rows[which],
        )

    def _exposure_violations(
        self, path: Path, first: int, picture: ThreatPicture | None
    ) -> Iterator[Violation]:
        """Check the threat levels of rows from ``first`` on, computed independently of the path."""
        limit = self.limits.threat_level_max
        is_finite = np.isfinite(path.times_s).all() and (np.abs(path.positions_enu_m) <= NUMBER_MAX).all()
        if self._exposure is None or picture is None or limit >= 1.0 or not is_finite:
            return
        levels = self._exposure.levels(path, picture)
        rows = np.arange(len(levels))
        above = (rows >= first) & ~(levels <= limit + 1e-9)
        yield from violated("threat", rows, above, levels, limit, "threat level, by the check's own count")

    def _row_violations(self, path: Path, usable: BoolArray, first: int) -> Iterator[Violation]:
        """Check bounds, speeds, climb angles of ``usable`` (N,) rows; threat levels, quality of all."""
        limits, ahead = self.limits, np.arange(len(usable)) >= first
        ready = usable & ahead
        yield from self._bounds_violations(path.positions_enu_m, ready, POINT_TOLERANCE_M)
        speed, climb, level = path.speeds_m_s, path.climb_angles_rad, path.threat_levels
        rows = np.arange(len(usable))
        airspeeds = (limits.airspeed_min_m_s, limits.airspeed_max_m_s)
        yield from outside(
            "speed", rows, ready, speed, airspeeds, tolerance=SPEED_TOLERANCE_M_S, detail="airspeed [m/s]"
        )
        stated = "stated climb angle [rad]"
        yield from outside(
            "climb", rows, ready, climb, self._climbs, tolerance=CLIMB_TOLERANCE_RAD, detail=stated
        )
        is_level = (level >= 0.0) & (level <= 1.0)
        too_high = ahead & ~(is_level & (level <= limits.threat_level_max + 1e-9))
        yield from violated("threat", rows, too_high, level, limits.threat_level_max, "threat level")
        free = path.collision_free
        is_share = (free >= 0.0) & (free <= 1.0)
        yield from violated("quality", rows, ahead & ~is_share, free, 1.0, "p_c is no probability")
        quality = float(np.prod(free[first:]))
        if not quality >= limits.quality_min:
            yield Violation("quality", len(rows) - 1, quality, limits.quality_min, "product of p_c")

    def _edge_violations(
        self, path: Path, edges: Edges, ahead: BoolArray, speeds: GroundSpeeds
    ) -> Iterator[Violation]:
        """Check times, speeds, courses against positions, radii and climb of edges ``ahead`` (N - 1,)."""
        limits, rows = self.limits, edges.rows
        backwards = ahead & ~(edges.steps_s > 0.0)
        yield from violated("time", rows, backwards, edges.steps_s, 0.0, "time does not go on [s]")
        timed = ahead & (edges.steps_s > 0.0)
        flown = 0.5 * (path.speeds_m_s[:-1] + path.speeds_m_s[1:]) * edges.steps_s
        farthest = flown * speeds.most
        too_far = timed & (edges.chords_m > farthest * (1.0 + RATIO_TOLERANCE) + LENGTH_TOLERANCE_M)
        yield from violated(
            "pace", rows, too_far, edges.chords_m, farthest, "farther than speed and time allow [m]"
        )
        # A curve's chord is not shorter than the chord of an arc of the smallest radius (Schur's theorem).
        nearest = flown * speeds.least
        arc = np.minimum(0.5 * nearest / limits.turn_radius_min_m, 0.5 * math.pi)
        least = nearest * np.sinc(arc / math.pi)
        too_near = timed & (edges.chords_m < least * (1.0 - RATIO_TOLERANCE) - LENGTH_TOLERANCE_M)
        yield from violated(
            "pace", rows, too_near, edges.chords_m, least, "nearer than speed and time bring it [m]"
        )
        banked = speeds.fastest_m_s**2 / limits.sideways_max_m_s2
        smallest = np.maximum(limits.turn_radius_min_m, banked * speeds.is_windy)
        yield from turn_violations(edges, ahead, smallest, RATIO_TOLERANCE)
        angles = np.arctan2(edges.rises_m, edges.lengths_m)
        airspeeds = 0.5 * (path.speeds_m_s[:-1] + path.speeds_m_s[1:])
        gained = speeds.fastest_m_s - speeds.level_m_s
        yield from self._climb_violations(angles, rows, ahead, airspeeds, gained)

    def _climb_violations(
        self, angles_rad: FloatArray, rows: NDArray[np.int64], flown: BoolArray,
        airspeeds_m_s: FloatArray | float, gained_m_s: FloatArray,
    ) -> Iterator[Violation]:  # fmt: skip
        """Check climb angles over the ground.

        ``angles_rad`` (N,) belong to ``rows`` (N,), of which those ``flown`` (N,) are judged.
        ``airspeeds_m_s`` (N,) may be one number for all; ``gained_m_s`` (N,) is the ground speed that the
        wind adds.
        """
        low, high = self._climbs
        for most, sign, name in ((high, 1.0, "upper"), (-low, -1.0, "lower")):
            limit = slope_over_ground(most, airspeeds_m_s, gained_m_s)
            steep = flown & ~(sign * angles_rad <= limit + CLIMB_TOLERANCE_RAD)
            detail = f"climb angle between rows [rad], {name}"
            yield from violated("climb", rows, steep, angles_rad, sign * limit, detail)

    def _bulge_violations(self, path: Path, edges: Edges, ahead: BoolArray) -> Iterator[Violation]:
        """Check the bounds at the middles of the arcs of edges ``ahead`` (N - 1,)."""
        turns = edges.turns_rad
        sagitta = 0.5 * edges.flat_chords_m * np.tan(0.25 * turns)
        course = path.courses_rad[:-1] + 0.5 * turns
        middles = 0.5 * (path.positions_enu_m[:-1] + path.positions_enu_m[1:])
        # A turn to the right bulges to the left of its chord.
        middles[:, 0] -= sagitta * np.cos(course)
        middles[:, 1] += sagitta * np.sin(course)
        turning = np.append(False, ahead & (np.abs(turns) > STRAIGHT_COURSE_RAD))
        points = np.vstack([middles[:1], middles])
        yield from self._bounds_violations(points, turning, BULGE_TOLERANCE_M)

    def _bounds_violations(
        self, points: FloatArray, ready: BoolArray, tolerance_m: float, row: int | None = None
    ) -> Iterator[Violation]:
        """Check that ``points`` (N, 3) [m] are in bounds if ``ready`` (N,); ``row`` names all."""
        widen = (tolerance_m, tolerance_m, POINT_TOLERANCE_M + self.limits.altitude_tolerance_m)
        rows = np.arange(len(points)) if row is None else np.full(len(points), row)
        for axis, name in enumerate(("east", "north", "up")):
            low, high = self.limits.bounds[2 * axis : 2 * axis + 2]
            yield from outside(
                "bounds", rows, ready, points[:, axis], (low, high),
                tolerance=widen[axis], detail=f"{name} of the bounds [m]",
            )  # fmt: skip

    def _clearance_violations(
        self, starts: FloatArray, ends: FloatArray, margins: FloatArray, bulges: FloatArray,
        rows: NDArray[np.int64], *, track_height_m: float | None = None, over_ground: bool = True,
    ) -> Iterator[Violation]:  # fmt: skip
        """Check segments for prisms and ground: distance less bulge, against the margin.

        ``starts``, ``ends`` (N, 3), ``margins``, ``bulges`` (N,) [m]; ``rows`` (N,) are the reported rows.
        A track keeps the margins and ``track_height_m`` over ground. All else keeps the limits of height over
        ground. Without ``over_ground`` the ground is left out.
        """
        if over_ground and self.ground is not None and len(starts):
            least = np.full(len(starts), self.ground.height_min_m - TOLERANCE_M)
            above, tolerance_m = 0.0, self.limits.altitude_tolerance_m
            if track_height_m is not None:
                least, above, tolerance_m = margins + track_height_m, track_height_m, math.inf
            for entry in self.ground.violations(starts, ends, least, rows, tolerance_m):
                yield replace(entry, value=entry.value - above, limit=entry.limit - above)
        for segment, name, clear in self._prisms.near(starts, ends, margins, bulges):
            yield Violation(
                "clearance", int(rows[segment]), clear, float(margins[segment]), f"distance to {name} [m]"
            )

    def check_legs(
        self, positions_enu_m: FloatArray, *, ends_in_loiter: bool, loiter_radius_m: float | None,
        loiter_centre_enu_m: FloatArray | None = None, may_come_back: bool = False,
        wind_enu_m_s: tuple[float, float] = (0.0, 0.0), airspeed_m_s: float | None = None,
        follows_ground: bool = False,
    ) -> tuple[Violation, ...]:  # fmt: skip
        """Return every rule that a mission's waypoints break, flown as straight legs with fly-by corners.

        Parameters
        ----------
        positions_enu_m : ndarray, shape (K, 3)
            Waypoints in order; the aircraft comes from the first [m].
        ends_in_loiter : bool
            Whether the last waypoint is a loiter; the rule ``ending`` is broken if not.
        loiter_radius_m : float or None
            Radius of that loiter; the sign (direction) does not matter [m].
        loiter_centre_enu_m : ndarray, shape (3,), optional
            Centre of the loiter, if that differs from the last waypoint [m].
        may_come_back : bool
            Same as in :meth:`check_path`.
        wind_enu_m_s : tuple of float
            Velocity of the air over the ground; a tailwind makes climbs flatter [m/s].
        airspeed_m_s : float, optional
            Lowest airspeed on the legs; the aircraft's lowest airspeed if omitted [m/s].
        follows_ground : bool
            Whether the autopilot keeps heights over ground on the legs. Height over ground and climb are then
            not those of straight legs; ``ground.track_violations`` has to check them.
        """
        points = np.asarray(positions_enu_m, dtype=np.float64)
        if points.ndim != 2 or points.shape[1:] != (3,) or len(points) < 2:
            return (Violation("rows", 0, float(len(points)), 2.0, "a mission needs two waypoints"),)
        usable = (np.abs(points) <= NUMBER_MAX).all(axis=1)
        if not usable.all():
            return tuple(
                Violation("finite", int(row), math.nan, NUMBER_MAX, "numbers that are not finite")
                for row in np.flatnonzero(~usable)
            )
        with np.errstate(all="ignore"):
            found = list(self._leg_violations(points, wind_enu_m_s, airspeed_m_s, follows_ground))
            if may_come_back:
                found = self._return_to_bounds(points[0], 0.0).remaining(found, points)
            centre = points[-1] if loiter_centre_enu_m is None else np.asarray(loiter_centre_enu_m)
            found += self._ending_violations(points, centre, ends_in_loiter, loiter_radius_m)
        return tuple(found)

    def check_track(
        self, positions_enu_m: FloatArray, margin_m: float, *, may_come_back: bool = False,
        keeps_height: bool = False,
    ) -> tuple[Violation, ...]:  # fmt: skip
        """Check clearance and bounds of a track that begins at the aircraft's position.

        If the aircraft begins too near to an obstacle, it has to move away from it. If it begins out of
        bounds, it may go no farther out.

        Parameters
        ----------
        positions_enu_m : ndarray, shape (K, 3)
            Positions close together, the first is the aircraft's own [m].
        margin_m : float
            Distance to keep from obstacles [m].
        may_come_back : bool
            Whether the track may turn back out of bounds, and leave a fence that contains the aircraft.
        keeps_height : bool
            Whether a flight at ``height_min_m`` over ground has only ``clearance_min_m`` of clearance.
        """
        lowest_m = 0.0 if self.ground is None else self.ground.height_min_m
        height_m = lowest_m - 2.0 * self.limits.margin_m if keeps_height else 0.0
        points = np.asarray(positions_enu_m, dtype=np.float64)
        if len(points) < 2 or not (np.abs(points) <= NUMBER_MAX).all():
            return (Violation("finite", 0, math.nan, NUMBER_MAX, "no track of finite numbers"),)
        here, margin, none = curves.short_segment(points[0]), np.array([margin_m]), np.zeros(1)
        near = partial(self._clearance_violations, track_height_m=height_m)
        at_first = [entry.value for entry in near(*here, margin, none, none.astype(int))]
        margins = curves.margins_along(points, min(at_first, default=margin_m), margin_m)
        low, high = np.array(self.limits.bounds).reshape(3, 2).T
        out = max(0.0, float((low - points[0]).max()), float((points[0] - high).max()))
        if may_come_back and out > OUT_MIN_M:
            out += OVERSHOOT_RADII * self.limits.turn_radius_min_m
        found = list(self._bounds_violations(points, np.full(len(points), True), BULGE_TOLERANCE_M + out))
        rows, none = np.arange(1, len(points)), np.zeros(len(points) - 1)
        found += near(points[:-1], points[1:], margins, none, rows)
        if may_come_back:
            found = self._return_to_bounds(points[0], 0.0).remaining(found, points)
        return tuple(found)

    def _return_to_bounds(self, place: FloatArray, spread_m: float) -> ReturnToBounds:
        """Return the exceptions for a flight that begins at ``place`` (3,) [m]."""
        low, high = np.array(self.limits.bounds).reshape(3, 2).T
        widened = np.array([0.0, 0.0, self.limits.altitude_tolerance_m])
        out = float(np.maximum(low - widened - place, place - high - widened).max())
        if self.ground is not None and np.isfinite(out):
            over = float(place[2] - self.ground.up_m(place[None])[0])
            out = max(out, over - self.ground.height_max_m - self.limits.altitude_tolerance_m)
        if not np.isfinite(out):
            return ReturnToBounds(0.0, {}, 0.0)
        margin = np.array([self.limits.margin_m + spread_m])
        near = self._clearance_violations(
            *curves.short_segment(place), margin, np.zeros(1), np.zeros(1, dtype=np.int64)
        )
        return ReturnToBounds(
            max(out, 0.0), {entry.detail: entry.value for entry in near}, self.limits.turn_radius_min_m
        )

    def _leg_violations(
        self, points: FloatArray, wind_enu_m_s: tuple[float, float], airspeed_m_s: float | None,
        follows_ground: bool,
    ) -> Iterator[Violation]:  # fmt: skip
        """Check bounds, clearance, climb and corners of the legs between ``points`` (K, 3) [m]."""
        yield from self._bounds_violations(points, np.full(len(points), True), POINT_TOLERANCE_M)
        rows = np.arange(1, len(points))
        none = np.zeros(len(rows))
        margins, over = none + self.limits.margin_m, not follows_ground
        yield from self._clearance_violations(points[:-1], points[1:], margins, none, rows, over_ground=over)
        away = np.diff(points, axis=0)
        lengths = np.hypot(away[:, 0], away[:, 1])
        moving = lengths > POINT_TOLERANCE_M
        angles = np.arctan2(away[:, 2], lengths)
        flown = moving | (np.abs(away[:, 2]) > POINT_TOLERANCE_M)
        airspeed = self.limits.airspeed_min_m_s if airspeed_m_s is None else airspeed_m_s
        gained = tailwinds(away, airspeed, wind_enu_m_s)
        yield from self._climb_violations(angles, rows, flown & over, airspeed, gained)
        kept = np.flatnonzero(np.append(True, moving))  # A repeated waypoint is no corner.
        if len(kept) >= 3:
            yield from self._corner_violations(points[kept], kept, over)

    def _corner_violations(
        self, points: FloatArray, rows: NDArray[np.int64], over_ground: bool
    ) -> Iterator[Violation]:
        """Check that the turns at ``points`` (K, 3) [m] of ``rows`` (K,) fit on their legs and are clear."""
        away = np.diff(points[:, :2], axis=0)
        lengths = np.hypot(away[:, 0], away[:, 1])
        courses = np.arctan2(away[:, 0], away[:, 1])
        turns = curves.wrapped(np.diff(courses))
        reach = self.limits.turn_radius_min_m * np.tan(0.5 * np.abs(turns))
        needed = np.append(reach, 0.0) + np.append(0.0, reach)
        short = needed > lengths * (1.0 + CORNER_TOLERANCE) + POINT_TOLERANCE_M
        yield from violated(
            "corner", rows[1:], short, lengths, needed, "leg too short for the turns at its ends [m]"
        )
        for corner in np.flatnonzero(np.abs(turns) > CORNER_MIN_RAD):
            cut = float(min(reach[corner], lengths[corner], lengths[corner + 1]))
            arc, sagitta = curves.fly_by(
                points[corner : corner + 3], float(courses[corner]), float(turns[corner]), cut
            )
            none = np.zeros(CORNER_SIDES)
            yield from self._clearance_violations(
                arc[:-1], arc[1:], none + self.limits.margin_m, none + sagitta,
                np.full(CORNER_SIDES, rows[corner + 1]), over_ground=over_ground,
            )  # fmt: skip

    def _ending_violations(
        self, points: FloatArray, centre: FloatArray, ends_in_loiter: bool, loiter_radius_m: float | None
    ) -> Iterator[Violation]:
        """Check that a loiter about ``centre`` (3,) after ``points`` (K, 3) is flyable and clear."""
        last, smallest = len(points) - 1, self.limits.turn_radius_min_m
        if not ends_in_loiter:
            yield Violation("ending", last, 0.0, 1.0, "the mission does not end in a loiter")
            return
        radius = math.nan if loiter_radius_m is None else abs(loiter_radius_m)
        if not smallest * (1.0 - RATIO_TOLERANCE) <= radius <= NUMBER_MAX:
            yield Violation("ending", last, radius, smallest, "loiter radius [m]")
        if radius <= NUMBER_MAX:
            yield from self.circle_violations(centre, radius, last)

    def circle_violations(self, centre_enu_m: FloatArray, radius_m: float, row: int) -> Iterator[Violation]:
        """Check clearance and bounds of a circle at one height: at most one violation of each.

        Parameters
        ----------
        centre_enu_m : ndarray, shape (3,)
            Centre of the circle [m].
        radius_m : float
            Radius of the circle [m].
        row : int
            The row that violations name.
        """
        angles = np.linspace(0.0, 2.0 * math.pi, LOITER_SIDES + 1)
        sides = np.column_stack([np.sin(angles), np.cos(angles), np.zeros(len(angles))])
        ring, bulge = centre_enu_m + radius_m * sides, radius_m * (1.0 - math.cos(math.pi / LOITER_SIDES))
        none, rows = np.zeros(LOITER_SIDES), np.full(LOITER_SIDES, row)
        near = self._clearance_violations(
            ring[:-1], ring[1:], none + self.limits.margin_m, none + bulge, rows
        )
        yield from sorted(near, key=lambda violation: violation.value)[:1]
        out = self._bounds_violations(ring, np.full(len(ring), True), POINT_TOLERANCE_M, row=row)
        yield from itertools.islice(out, 1)
