"""A flight's distances from its threats, and the times in their reach and sight.

The numbers follow from the paths alone: the true ones of a simulated flight, or those known on board. The
formulas are written for this purpose, and share nothing with the planner or the checker.

Both paths are linear between their rows, and distance and reach are exact for that. Sight is tested once
between two rows, at the middle of the part in reach. The time at which a shadow begins or ends is therefore
known to half the time between rows, and a shorter sight may be missed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.types.encounter import Closest, Encounter
from companion.types.threat import Obstacle, Radar, SightFloor

GAP_S = 5.0  # Between rows farther apart the position counts as unknown.
WAYPOINT_S = 1.0  # τ, the planner's time step (paper 2.2).
NUM_SECONDARY = 10  # The paper takes this many points between two waypoints (5.3).
THREATS_MAX = 20  # A recording's summary has at most this many tracks, the longest, and as many radars.
LINES_MAX = 100_000  # At most this many lines of sight per threat: two and a half hours of levels.
PAIRS_MAX = 20_000_000  # At most this many pairs of a line and a prism: about a minute of computation.
CHUNK_PAIRS = 100_000  # Pairs that are tested at once, which bounds the memory.

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class ThreatHistory:
    """A threat as it truly was, or as it was tracked.

    Parameters
    ----------
    name : str
        The threat's name.
    reach_m : float
        RD_max of a dynamic threat, or R_max of a radar [m].
    rows : ndarray, shape (M, 4)
        Time [s], east, north, up [m], in order of time.
    is_moving : bool
        Whether the threat is dynamic, not a radar.
    boundary_coefficient_per_m : float
        K_R of a radar's detection boundary h_B = K_R·L² [1/m]. With 0 there is no boundary: a flight in the
        plane, slightly below the radar, is seen.
    lowest_seen_m : SightFloor, optional
        What limits a radar's sight besides.
    """

    name: str
    reach_m: float
    rows: FloatArray
    is_moving: bool = True
    boundary_coefficient_per_m: float = 0.0
    lowest_seen_m: SightFloor | None = None


class Sight(Protocol):
    """The interface that tells which lines of sight are free."""

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return which straight lines between ``eyes`` and ``places`` (N, 3) [m] are free, (N,)."""


class Masks:
    """Obstacles as masks of sight: whole prisms, whatever their base.

    Parameters
    ----------
    obstacles : sequence of Obstacle
        The obstacles.
    ground : Sight, optional
        Ground that masks as well.
    """

    def __init__(self, obstacles: Sequence[Obstacle], ground: Sight | None = None) -> None:
        self._ground = ground
        polygons = [shapely.Polygon(obstacle.polygon_enu_m) for obstacle in obstacles]
        self._polygons = np.array(polygons, dtype=object)
        shapely.prepare(self._polygons)
        self._tree = shapely.STRtree(self._polygons)
        heights = [sorted((obstacle.base_m, obstacle.top_m)) for obstacle in obstacles]
        self._heights = np.array(heights, dtype=np.float64).reshape(-1, 2)

    def is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return which straight lines pass through no prism; along a side or a roof is not through it.

        Parameters
        ----------
        eyes, places : ndarray, shape (N, 3)
            The lines' ends, east, north, up [m].

        Returns
        -------
        ndarray, shape (N,)
            Whether each line is free.
        """
        free = np.ones(len(eyes), dtype=bool)
        if not len(eyes):
            return free
        if len(self._polygons):
            size = 1 + CHUNK_PAIRS // len(self._polygons)  # All prisms may be near one line.
            chunks = [slice(first, first + size) for first in range(0, len(eyes), size)]
            free = np.concatenate([self._is_free(eyes[chunk], places[chunk]) for chunk in chunks])
        if self._ground is not None:
            free[free] = self._ground.is_free(eyes[free], places[free])
        return free

    def __len__(self) -> int:
        return len(self._polygons)

    def _is_free(self, eyes: FloatArray, places: FloatArray) -> BoolArray:
        """Return whether each line from ``eyes`` (N, 3) to ``places`` (N, 3) [m] is free, (N,)."""
        free = np.ones(len(eyes), dtype=bool)
        lines = shapely.linestrings(np.stack([eyes[:, :2], places[:, :2]], axis=1))
        line, prism = self._tree.query(lines, predicate="intersects")
        eye, along = eyes[line], places[line] - eyes[line]
        low, high = _between(eye[:, 2], along[:, 2], self._heights[prism])
        is_level = low < high
        line, prism, eye, along = line[is_level], prism[is_level], eye[is_level, :2], along[is_level, :2]
        ends = [eye + share[is_level, None] * along for share in (low, high)]
        is_point = (ends[0] == ends[1]).all(axis=1)
        pieces = np.where(
            is_point, shapely.points(ends[0]), shapely.linestrings(np.stack(ends, axis=1))
        )  # A vertical piece is a point on the map.
        walls = self._polygons[prism]
        free[line[shapely.intersects(walls, pieces) & ~shapely.touches(walls, pieces)]] = False
        return free


def encounter_with(
    threat: ThreatHistory, flown: FloatArray, masks: Masks, lines_max: int = sys.maxsize
) -> Encounter:
    """Return the encounter of a flight with one threat.

    The level is membership (1) of the paper: ``μ = exp(−R⁴/R_max⁴)`` for ``R ≤ R_max`` above the detection
    boundary and in sight, else 0. R is the slant range. A dynamic threat has RD_max and no boundary (3.1,
    3.2). As for TTA (5.3), the level is taken at the waypoints and at ten points between each two. A flown
    path has no waypoints, so one is set every second from its first row, as the planner sets its nodes.

    Parameters
    ----------
    threat : Threatening
        The threat.
    flown : ndarray, shape (N, C)
        Time [s], east, north, up [m], in order of time; further columns are ignored.
    masks : Masks
        What blocks sight.
    lines_max : int
        Largest number of lines of sight. If there are more instants, only some are used; if there are more
        levels, none is computed.
    """
    own, other = _finite_rows(flown[:, :4]), _finite_rows(threat.rows)
    times = _shared_times(own, other)
    times = times[:: 1 + len(times) // lines_max]
    here, there = _places(own, times), _places(other, times)
    away = here - there
    middles = times[1:] - 0.5 * np.diff(times)
    is_known = _is_known(own, middles) & _is_known(other, middles)
    reached = _parts_in_reach(away, threat.reach_m) * is_known[:, None]
    inside = np.flatnonzero(reached[:, 1] > reached[:, 0])
    reached = reached[inside]
    intervals = times[inside, None] + reached * np.diff(times)[inside, None]
    middle = 0.5 * reached.sum(axis=1)[:, None]
    seen = _is_seen(
        threat, here[inside] + middle * np.diff(here, axis=0)[inside],
        there[inside] + middle * np.diff(there, axis=0)[inside], masks,
    )  # fmt: skip
    return Encounter(
        name=threat.name,
        reach_m=threat.reach_m,
        is_moving=threat.is_moving,
        times_s=times,
        distances_m=np.where(
            _is_known(own, times) & _is_known(other, times), np.linalg.norm(away, axis=1), np.nan
        ),
        levels=_levels(threat, own, other, masks, lines_max),
        in_reach_s=merged_intervals(intervals),
        in_sight_s=merged_intervals(intervals[seen]),
        closest=_closest(times, here, there, is_known),
    )


def radar_threats(radars: Sequence[Radar], flown: FloatArray) -> tuple[ThreatHistory, ...]:
    """Return radars as threats that do not move during a flight.

    Parameters
    ----------
    radars : sequence of Radar
        The radars.
    flown : ndarray, shape (N, C)
        Rows of the flight, each beginning with the time [s].
    """
    return tuple(
        ThreatHistory(
            radar.name, radar.max_threat_radius_m,
            np.column_stack([flown[:, 0], np.tile(radar.position_enu_m, (len(flown), 1))]),
            is_moving=False, boundary_coefficient_per_m=radar.boundary_coefficient_per_m,
            lowest_seen_m=radar.lowest_seen_m,
        )
        for radar in radars
    )  # fmt: skip


def known_encounters(
    flown: FloatArray,
    tracks: Iterable[tuple[str, Sequence[Sequence[float]]]],
    radars: Sequence[Radar],
    obstacles: Sequence[Obstacle],
    ground: Sight | None = None,
) -> tuple[Encounter, ...]:
    """Return the encounters as they were known on board.

    Parameters
    ----------
    flown : ndarray, shape (N, C)
        The aircraft's own estimate, as for :func:`encounter_with`.
    tracks : iterable of tuple of str and sequence
        Identity, and rows of time [s], east, north, up and reach [m]. The reach of a vehicle that is no
        threat is 0.
    radars : sequence of Radar
        The mission file's radars, whether or not they were sensed.
    obstacles : sequence of Obstacle
        What blocks sight.
    ground : Sight, optional
        Ground that blocks sight as well.
    """
    masks = Masks(obstacles, ground)
    tables = [(name, np.asarray(rows, dtype=np.float64).reshape(-1, 5)) for name, rows in tracks]
    moving = [ThreatHistory(name, float(rows[-1, 4]), rows[:, :4]) for name, rows in tables if len(rows)]
    longest = sorted((threat for threat in moving if threat.reach_m > 0.0), key=lambda t: -len(t.rows))
    threats = [*longest[:THREATS_MAX], *radar_threats(radars[:THREATS_MAX], flown)]
    lines_max = min(LINES_MAX, 1 + PAIRS_MAX // max(1, len(threats) * len(masks)))
    found = [encounter_with(threat, flown, masks, lines_max) for threat in threats]
    return tuple(entry for entry in found if entry.closest is not None)


def merged_intervals(*intervals: FloatArray) -> FloatArray:
    """Merge intervals of time that overlap or touch.

    Parameters
    ----------
    *intervals : ndarray, shape (K, 2)
        Start and end of each interval [s]; they may overlap.

    Returns
    -------
    ndarray, shape (J, 2)
        The same time as disjoint intervals, in order of time [s].
    """
    rows = np.vstack([np.empty((0, 2)), *intervals])
    rows = rows[np.argsort(rows[:, 0])]
    ends = np.maximum.accumulate(rows[:, 1])
    begins = np.append(True, rows[1:, 0] > ends[:-1] + 1e-9)[: len(rows)]
    first = np.flatnonzero(begins)
    return np.column_stack([rows[first, 0], ends[np.append(first[1:], len(rows))[: len(first)] - 1]])


def total_duration_s(intervals: FloatArray) -> float:
    """Return the total duration of disjoint intervals [s].

    Parameters
    ----------
    intervals : ndarray, shape (K, 2)
        Start and end of each [s].
    """
    return float((intervals[:, 1] - intervals[:, 0]).sum())


def total_threat(encounters: Sequence[Encounter]) -> float:
    """TTA or TDTA: the sum of the levels over waypoints, the points between them, and threats (paper 5.3)."""
    return float(sum(entry.levels.sum() for entry in encounters))


def aggregated_threat(encounters: Sequence[Encounter]) -> float:
    """ATP or ADTP: the waypoints' levels by IFWA with equal weights, ``1 − Π(1 − μ)^(1/N)`` (paper 5.3).

    If several threats see a waypoint, its μ combines theirs by IFWA as in 3.3: in order of falling μ, each is
    raised by the earlier ones, ``μ'_k = 1 − Π_{i ≤ k}(1 − μ_i)``, with weights 1/m.
    """
    if not encounters:
        return 0.0
    levels = -np.sort([-entry.levels[:: NUM_SECONDARY + 1] for entry in encounters], axis=0)
    raised = np.where(levels > 0.0, np.cumprod(1.0 - levels, axis=0), 1.0)
    with np.errstate(divide="ignore"):
        free = np.log(raised).sum(axis=0) / np.maximum((levels > 0.0).sum(axis=0), 1)
    return float(1.0 - np.exp(free.mean())) if len(free) else 0.0


def _between(begin: FloatArray, gain: FloatArray, bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return which part of each line from height ``begin`` (P,) by ``gain`` (P,) lies in ``bounds`` (P, 2).

    Returns the shares (P,) of the line at which the part starts and ends; the part is empty unless the first
    is smaller.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.sort((bounds - begin[:, None]) / gain[:, None], axis=1)
    is_inside = (bounds[:, 0] < begin) & (begin < bounds[:, 1])
    is_inside |= bounds[:, 0] == begin  # A prism on the ground also hides what is on the ground.
    low = np.where(gain != 0.0, np.clip(shares[:, 0], 0.0, 1.0), 0.0)
    return low, np.where(gain != 0.0, np.clip(shares[:, 1], 0.0, 1.0), is_inside)


def _finite_rows(rows: FloatArray) -> FloatArray:
    """Return the finite rows (M, 4) of ``rows`` (N, 4), in order of time."""
    found = rows[np.isfinite(rows).all(axis=1)]
    return found[np.argsort(found[:, 0], kind="stable")]


def _shared_times(own: FloatArray, other: FloatArray) -> FloatArray:
    """Return the stamps (T,) of ``own`` (N, 4) and ``other`` (M, 4) at which both exist [s]."""
    if not len(own) or not len(other):
        return np.empty(0)
    low, high = max(own[0, 0], other[0, 0]), min(own[-1, 0], other[-1, 0])
    times = np.union1d(own[:, 0], other[:, 0])
    found: FloatArray = times[(times >= low) & (times <= high)]
    return found


def _places(rows: FloatArray, times: FloatArray) -> FloatArray:
    """Return the positions (T, 3) on ``rows`` (N, 4) at ``times`` (T,)."""
    if not len(times):
        return np.empty((0, 3))
    return np.column_stack([np.interp(times, rows[:, 0], rows[:, axis]) for axis in (1, 2, 3)])


def _is_known(rows: FloatArray, times: FloatArray) -> BoolArray:
    """Return which of ``times`` (T,) are on ``rows`` (N, 4), or between two that are close enough; (T,)."""
    if not len(rows):
        return np.zeros(len(times), dtype=bool)
    stamps = rows[:, 0]
    after = np.minimum(np.searchsorted(stamps, times), len(stamps) - 1)
    is_near = stamps[after] - stamps[np.maximum(after - 1, 0)] <= GAP_S
    is_near |= stamps[after] == times
    found: BoolArray = (times >= stamps[0]) & (times <= stamps[-1]) & is_near
    return found


def _parts_in_reach(away: FloatArray, reach_m: float) -> FloatArray:
    """Return which part of each step of ``away`` (T, 3) is in reach: shares (T - 1, 2), equal if none."""
    begin, step = away[:-1], np.diff(away, axis=0)
    square, half = np.einsum("ij,ij->i", step, step), np.einsum("ij,ij->i", begin, step)
    rest = np.einsum("ij,ij->i", begin, begin) - reach_m**2
    root = np.sqrt(np.maximum(half**2 - square * rest, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.column_stack([(-half - root) / square, (-half + root) / square])
    parts[square == 0.0] = (0.0, 1.0)
    parts[(square == 0.0) & (rest > 0.0)] = 0.0
    found: FloatArray = np.clip(parts, 0.0, 1.0)
    return found


def _is_seen(threat: ThreatHistory, here: FloatArray, there: FloatArray, masks: Masks) -> BoolArray:
    """Return whether a threat at ``there`` (K, 3) sees the aircraft at ``here`` (K, 3), (K,)."""
    away = here - there
    flat = np.hypot(away[:, 0], away[:, 1])
    seen = np.ones(len(here), dtype=bool)
    if threat.boundary_coefficient_per_m > 0.0:
        seen = away[:, 2] >= threat.boundary_coefficient_per_m * flat**2
    if threat.lowest_seen_m is not None:
        seen &= here[:, 2] >= threat.lowest_seen_m(here[:, :2])
    seen[seen] = masks.is_free(there[seen], here[seen])
    return seen


def _levels(
    threat: ThreatHistory, own: FloatArray, other: FloatArray, masks: Masks, num_max: int
) -> FloatArray:
    """Return the membership (S,) along ``own`` (N, 4) of a threat on ``other`` (M, 4); empty if too many."""
    num_steps = int((own[-1, 0] - own[0, 0]) / WAYPOINT_S + 1e-9) if len(own) else num_max
    if num_steps * (NUM_SECONDARY + 1) >= num_max:
        return np.empty(0)
    times = own[0, 0] + np.arange(num_steps * (NUM_SECONDARY + 1) + 1) * (WAYPOINT_S / (NUM_SECONDARY + 1))
    levels = np.zeros(len(times))
    known = np.flatnonzero(_is_known(own, times) & _is_known(other, times))
    here, there = _places(own, times[known]), _places(other, times[known])
    ranges = np.linalg.norm(here - there, axis=1)
    near = ranges <= threat.reach_m
    here, there, ranges, known = here[near], there[near], ranges[near], known[near]
    seen = _is_seen(threat, here, there, masks)
    levels[known[seen]] = np.exp(-((ranges[seen] / threat.reach_m) ** 4))
    return levels


def _closest(times: FloatArray, here: FloatArray, there: FloatArray, is_known: BoolArray) -> Closest | None:
    """Return the closest approach of ``here`` and ``there`` (T, 3) at ``times`` (T,).

    Only the steps ``is_known`` (T - 1,) count.
    """
    steps = np.flatnonzero(is_known)
    if not len(steps):
        return None
    away = here - there
    begin, step = away[steps], np.diff(away, axis=0)[steps]
    square = np.einsum("ij,ij->i", step, step)
    share = np.clip(-np.einsum("ij,ij->i", begin, step) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    distances = np.linalg.norm(begin + share[:, None] * step, axis=1)
    best = int(np.argmin(distances))
    row, part = int(steps[best]), float(share[best])
    own, other = (rows[row] + part * (rows[row + 1] - rows[row]) for rows in (here, there))
    return Closest(
        float(times[row] + part * (times[row + 1] - times[row])),
        float(distances[best]),
        (float(own[0]), float(own[1]), float(own[2])),
        (float(other[0]), float(other[1]), float(other[2])),
    )
