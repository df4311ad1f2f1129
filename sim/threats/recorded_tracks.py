"""Tracks of real aircraft, from tables in which ADS-B receivers record what they hear.

Two forms are read, each with a header line, a comma between columns, and one aircraft's state a line:

- traffic [1]_, as ``Flight.to_csv`` writes it: times in ISO 8601, ft, kt and ft/min.
- State vectors of the OpenSky Network [2]_: times in seconds since 1970, and SI units.

References
----------
.. [1] Olive, "traffic, a toolbox for processing and analysing air traffic data", JOSS 4 (39), 2019.
.. [2] Schäfer, Strohmeier, Lenders, Martinovic, Wilhelm, "Bringing up OpenSky: A large-scale ADS-B sensor
   network for research", IPSN 2014.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from companion.errors import ConfigError
from companion.research.encounters.encounter_model import KNOT_M_S
from companion.research.encounters.well_clear import FOOT_M

MISSING = frozenset({"", "nan", "nat", "none", "null", "<na>"})  # How tables write that a value is missing.
ADDRESS_MAX = 0xFFFFFF


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a file's form, and the conversion of its values to our units.

    Parameters
    ----------
    name : str
        Name in the header.
    factor : float
        Our unit over the form's.
    limit : float
        Largest magnitude of a value.
    """

    name: str
    factor: float = 1.0
    limit: float = math.inf


@dataclass(frozen=True, slots=True)
class Form:
    """The columns of one form; only time, address and place have to be there.

    Parameters
    ----------
    time, address, fixed : str
        Names of the columns with the time of the state, the aircraft's ICAO address, and the time at which
        the position was received.
    values : mapping of str to Column
        Columns by the fields of :class:`RecordedReport`.
    """

    time: str
    address: str
    fixed: str
    values: Mapping[str, Column]


FORMS = (
    Form(
        "timestamp", "icao24", "last_position",
        {
            "latitude_deg": Column("latitude", limit=90.0),
            "longitude_deg": Column("longitude", limit=180.0),
            "pressure_altitude_m": Column("altitude", FOOT_M),
            "geometric_altitude_m": Column("geoaltitude", FOOT_M),
            "ground_speed_m_s": Column("groundspeed", KNOT_M_S),
            "course_deg": Column("track"),
            "climb_m_s": Column("vertical_rate", FOOT_M / 60.0),
        },
    ),
    Form(
        "time", "icao24", "lastposupdate",
        {
            "latitude_deg": Column("lat", limit=90.0),
            "longitude_deg": Column("lon", limit=180.0),
            "pressure_altitude_m": Column("baroaltitude"),
            "geometric_altitude_m": Column("geoaltitude"),
            "ground_speed_m_s": Column("velocity"),
            "course_deg": Column("heading"),
            "climb_m_s": Column("vertrate"),
        },
    ),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class RecordedReport:
    """One state of an aircraft as it was received; None where a value is missing.

    Parameters
    ----------
    stamp_s : float
        When it was received, in seconds since 1970 [s].
    address : int
        The aircraft's ICAO address.
    age_s : float
        How old the position was then [s]; 0 if the recording does not say.
    latitude_deg, longitude_deg : float or None
        Position [deg].
    pressure_altitude_m, geometric_altitude_m : float or None
        Altitude at 1013.25 hPa, and above the WGS 84 ellipsoid [m].
    ground_speed_m_s, climb_m_s : float or None
        Speed over the ground, and vertical speed, upward [m/s].
    course_deg : float or None
        Course over the ground, clockwise from north [deg].
    """

    stamp_s: float
    address: int
    age_s: float = 0.0
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    pressure_altitude_m: float | None = None
    geometric_altitude_m: float | None = None
    ground_speed_m_s: float | None = None
    course_deg: float | None = None
    climb_m_s: float | None = None


def recorded_from_text(text: str, name: str) -> dict[int, tuple[RecordedReport, ...]]:
    """Read a recording from the text of its file, which is called ``name`` in errors.

    Returns
    -------
    dict of int to tuple of RecordedReport
        By each aircraft's ICAO address its reports, in the order of their times.

    Raises
    ------
    ConfigError
        For the first thing wrong with it: the file, the line, the column, the value, and what was expected.
    """
    rows = csv.reader(io.StringIO(text))
    header = [column.strip() for column in next(rows, [])]
    form = _form_of(header, name)
    found: dict[int, list[RecordedReport]] = {}
    for fields in rows:
        if not fields:
            continue
        if len(fields) != len(header):
            expected = f"{len(header)} fields, as in the header"
            raise ConfigError(name, rows.line_num, "line", f"{len(fields)} fields", expected)
        report = _report_of(dict(zip(header, fields, strict=True)), form, name, rows.line_num)
        found.setdefault(report.address, []).append(report)
    if not found:
        raise ConfigError(name, None, "file", "no report", "a line per report below the header")
    return {address: _by_time(reports) for address, reports in found.items()}


def _by_time(reports: Iterable[RecordedReport]) -> tuple[RecordedReport, ...]:
    return tuple(sorted(reports, key=lambda report: report.stamp_s))


def _form_of(header: list[str], name: str) -> Form:
    """Return the form whose columns a file has."""
    needed = []
    for form in FORMS:
        places = (form.values["latitude_deg"].name, form.values["longitude_deg"].name)
        columns = (form.time, form.address, *places)
        if all(column in header for column in columns):
            return form
        needed.append(", ".join(columns))
    raise ConfigError(name, 1, "columns", ", ".join(header) or "none", " or ".join(needed))


def _report_of(fields: Mapping[str, str], form: Form, name: str, line: int) -> RecordedReport:
    """Return the report in a line, whose ``fields`` are given by the names of the columns."""
    stamp_s = _time_of(fields, form.time, name, line)
    if stamp_s is None:
        raise ConfigError(name, line, form.time, "nothing", "a time")
    fixed_s = _time_of(fields, form.fixed, name, line)
    values = {key: _number_of(fields, column, name, line) for key, column in form.values.items()}
    return RecordedReport(
        stamp_s, _address_of(fields, form, name, line),
        0.0 if fixed_s is None else max(0.0, stamp_s - fixed_s), **values,
    )  # fmt: skip


def _field(fields: Mapping[str, str], column: str) -> str | None:
    """Return the field of a column; None if the column or the value is missing."""
    given = fields.get(column, "").strip()
    return None if given.lower() in MISSING else given


def _time_of(fields: Mapping[str, str], column: str, name: str, line: int) -> float | None:
    """Return a time in seconds since 1970, written as a number or as ISO 8601, which counts as UTC."""
    given = _field(fields, column)
    if given is None:
        return None
    try:
        found = float(given)
    except ValueError:
        try:
            moment = datetime.fromisoformat(given)
        except ValueError:
            found = math.nan
        else:
            found = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    if not math.isfinite(found):
        raise ConfigError(name, line, column, given, "seconds since 1970, or a time in ISO 8601")
    return found


def _address_of(fields: Mapping[str, str], form: Form, name: str, line: int) -> int:
    given = _field(fields, form.address)
    try:
        found = int(given or "", 16)
    except ValueError:
        found = 0
    if not 0 < found <= ADDRESS_MAX:
        raise ConfigError(name, line, form.address, given or "nothing", "an ICAO address of six hex digits")
    return found


def _number_of(fields: Mapping[str, str], column: Column, name: str, line: int) -> float | None:
    """Return the value of a column in our unit; None where it is missing."""
    given = _field(fields, column.name)
    if given is None:
        return None
    try:
        found = float(given)
    except ValueError:
        found = math.nan
    if not (math.isfinite(found) and abs(found) <= column.limit):
        expected = "a number" if math.isinf(column.limit) else f"at most {column.limit:g} to either side of 0"
        raise ConfigError(name, line, column.name, given, expected)
    return found * column.factor
