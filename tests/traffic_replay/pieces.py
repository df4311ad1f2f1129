"""Pieces of recorded tracks, as long as a flight, and where they are placed about it."""

import math
from dataclasses import dataclass, replace

import numpy as np

from tests.traffic_replay.oracle import (
    AGE,
    CLIMB,
    COURSE,
    EAST,
    NORTH,
    SPEED,
    TIME,
    UP,
    WELL_CLEAR_M,
    WELL_CLEAR_UP_M,
    impossible_rows,
    leaps,
)

EARTH_M = 6_371_000.0
REPORTS_MIN = 4  # Pieces with fewer reports of a place are left out.
FIRST_S, LAST_S = 20.0, 100.0  # Between these times of the flight an aircraft is placed beside it.
FAR_M = (3_000.0, 12_000.0)


@dataclass(frozen=True)
class Piece:
    """Reports of one aircraft over as long as a flight takes.

    ``rows`` (N, 8) has the time since the piece began [s], age of the place [s], east, north, altitude [m],
    speed [m/s], course [rad] and climb [m/s]; NaN where a value is missing. Row by row it is ``reports``.
    """

    name: str
    address: int
    reports: tuple
    rows: np.ndarray

    @property
    def fixes(self):
        """Rows with a place and an altitude."""
        return np.flatnonzero(np.isfinite(self.rows[:, [EAST, NORTH, UP]]).all(axis=1))


def pieces_of(name, tracks, length_s, skip_s=0.0):
    """Cut the tracks of a recording into pieces that have enough reports; each track from ``skip_s`` on."""
    found = []
    for address, reports in tracks.items():
        stamps = np.array([report.stamp_s for report in reports])
        begin = int(np.searchsorted(stamps, stamps[0] + skip_s))
        while begin < len(reports):
            end = int(np.searchsorted(stamps, stamps[begin] + length_s))
            piece = _piece(f"{name} {address:06x} {stamps[begin]:.0f}", address, reports[begin:end])
            if piece is not None:
                found.append(piece)
            begin = end
    return found


def _piece(name, address, reports):
    placed = [report for report in reports if None not in (report.latitude_deg, report.longitude_deg)]
    if len(placed) < REPORTS_MIN:
        return None
    latitude, longitude = placed[len(placed) // 2].latitude_deg, placed[len(placed) // 2].longitude_deg
    east_m = math.radians(1.0) * EARTH_M * math.cos(math.radians(latitude))
    rows = np.full((len(reports), 8), np.nan)
    for row, report in zip(rows, reports, strict=True):
        row[TIME], row[AGE] = report.stamp_s - reports[0].stamp_s, report.age_s
        if report.latitude_deg is not None and report.longitude_deg is not None:
            away = (report.longitude_deg - longitude + 180.0) % 360.0 - 180.0
            row[EAST] = away * east_m
            row[NORTH] = (report.latitude_deg - latitude) * math.radians(1.0) * EARTH_M
        height = report.pressure_altitude_m
        height = report.geometric_altitude_m if height is None else height
        values = (height, report.ground_speed_m_s, report.course_deg, report.climb_m_s)
        for column, value in zip((UP, SPEED, COURSE, CLIMB), values, strict=True):
            row[column] = math.nan if value is None else value
    rows[:, COURSE] = np.radians(rows[:, COURSE])
    piece = Piece(name, address, tuple(reports), rows)
    return piece if len(piece.fixes) >= REPORTS_MIN else None


HOW = ("through", "beside", "far", "as high as recorded", "leap")


def leap_fixes(piece):
    """Rows of a piece, in the middle of a flight, in which the aircraft leaps or reports what is absurd."""
    rows = np.intersect1d(piece.fixes, leaps(piece.rows)).astype(int)
    then = piece.rows[rows, TIME] - piece.rows[rows, AGE]
    return rows[(then >= FIRST_S) & (then <= LAST_S)]


def _true_fixes(piece):
    return np.setdiff1d(piece.fixes, impossible_rows(piece.rows)).astype(int)


def placed(piece, how, path, frame, draw):
    """Move a piece to a flight ``path`` (N, 4): time [s], east, north, up [m].

    ``through`` leads it through the well clear volume, ``beside`` up to twice as far away, ``far`` some
    kilometres away, each at a height like that of the flight. ``as high as recorded`` leaves its altitude.
    ``leap`` puts a report of a place to which the aircraft cannot have come where the flight is. None if the
    piece has no report of the kind.
    """
    fixes = leap_fixes(piece) if how == "leap" else _true_fixes(piece)
    if not len(fixes):
        return None
    then = piece.rows[fixes, TIME] - piece.rows[fixes, AGE]
    # What leaps was somewhere else before, so that the piece stays where it is in time.
    meets_s = float(draw.choice(then)) if how == "leap" else draw.uniform(FIRST_S, LAST_S)
    row = fixes[np.abs(then - meets_s).argmin()]
    # The whole piece is moved in time so that this report is true when the two are to meet.
    shift_s = meets_s - float(piece.rows[row, TIME] - piece.rows[row, AGE])
    own = np.array([np.interp(meets_s, path[:, 0], path[:, axis]) for axis in (1, 2, 3)])
    miss_m = {
        "through": draw.uniform(0.0, 0.7 * WELL_CLEAR_M),
        "beside": draw.uniform(0.0, 2.0 * WELL_CLEAR_M),
        "far": draw.uniform(*FAR_M),
        "as high as recorded": draw.uniform(0.0, 0.7 * WELL_CLEAR_M),
        "leap": draw.uniform(0.0, 0.5 * WELL_CLEAR_M),
    }[how]
    above_m = draw.uniform(-1.0, 1.0) * WELL_CLEAR_UP_M * {"beside": 2.0, "far": 4.0}.get(how, 0.6)
    angle = draw.uniform(-math.pi, math.pi)
    wanted = own + np.array([miss_m * math.cos(angle), miss_m * math.sin(angle), above_m])
    move = wanted - piece.rows[row, EAST : UP + 1]
    if how == "as high as recorded":
        move[2] = -frame.altitude_amsl_m
    rows = piece.rows.copy()
    rows[:, TIME] += shift_s
    rows[:, EAST : UP + 1] += move
    heard = np.flatnonzero(rows[:, TIME] >= 0.0)
    reports = tuple(_moved(piece.reports[number], rows[number], frame) for number in heard)
    return replace(piece, rows=rows[heard], reports=reports)


def _moved(report, row, frame):
    """The report that says what a moved row says; all that is not moved stays as it was received."""
    place = {}
    if np.isfinite(row[[EAST, NORTH]]).all():
        latitude, longitude, _ = frame.global_from_local(float(row[EAST]), float(row[NORTH]), 0.0)
        place = {"latitude_deg": latitude, "longitude_deg": longitude}
    height = float(row[UP]) + frame.altitude_amsl_m
    if report.pressure_altitude_m is not None:
        place["pressure_altitude_m"] = height
    elif report.geometric_altitude_m is not None:
        place["geometric_altitude_m"] = height
    return replace(report, **place)
