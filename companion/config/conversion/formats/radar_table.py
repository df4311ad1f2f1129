"""Tables of radars in CSV: name, latitude, longitude, radius, and what else a radar has."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence

from companion.config.conversion.formats.foreign_file import foreign_text
from companion.config.conversion.found_places import PROPERTIES, Importer, Kind

_NAMES = {
    "radar": "name", "id": "name",
    "lat": "latitude", "latitude_deg": "latitude",
    "lon": "longitude", "lng": "longitude", "long": "longitude", "longitude_deg": "longitude",
    "radius": "max_threat_radius_m", "radius_m": "max_threat_radius_m", "range_m": "max_threat_radius_m",
    "altitude": "altitude_amsl_m", "altitude_m": "altitude_amsl_m", "alt": "altitude_amsl_m",
}  # fmt: skip
_REQUIRED = ("latitude", "longitude", "max_threat_radius_m")
_ROWS_MAX = 10_000


def take_radar_table(importer: Importer, data: bytes) -> None:
    """Take a table of radars; its first row names the columns, commas, semicolons or tabs part them.

    Raises
    ------
    ConfigError
        If a column is missing, or a value is wrong.
    """
    text = foreign_text(importer, data)
    separator = max(",;\t", key=text.splitlines()[0].count)
    try:
        header, *rows = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    except csv.Error as error:
        raise importer.error(
            "table", str(error), "rows of cells, parted by commas, semicolons or tabs"
        ) from None
    columns = _columns(importer, header)
    for line, row in enumerate(rows[:_ROWS_MAX], 2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(header):
            raise importer.error(
                f"row {line}", f"{len(row)} cells", f"{len(header)} cells, as the first row", line
            )
        _take_row(importer, {name: row[place].strip() for name, place in columns.items()}, separator, line)
    for line in range(_ROWS_MAX + 2, len(rows) + 2):
        importer.leave("row", line, f"a table has at most {_ROWS_MAX} rows")


def _columns(importer: Importer, header: Sequence[str]) -> dict[str, int]:
    """Return the position of each known column."""
    columns: dict[str, int] = {}
    for place, written in enumerate(header):
        plain = written.strip().lower().replace(" ", "_")
        name = _NAMES.get(plain, plain)
        if name in columns:
            raise importer.error(f"column {written.strip()!r}", "a second one", f"one column for {name}", 1)
        if name in ("name", *_REQUIRED, *PROPERTIES[Kind.RADAR]):
            columns[name] = place
        else:
            importer.leave("column", repr(written.strip()), "a radar has no such property")
    for name in _REQUIRED:
        if name not in columns:
            known = sorted({written for written, meant in _NAMES.items() if meant == name} | {name})
            raise importer.error("columns", ", ".join(header), f"a column {' or '.join(known)}", 1)
    return columns


def _take_row(importer: Importer, row: Mapping[str, str], separator: str, line: int) -> None:
    values = dict(row)
    name = values.pop("name", "") or f"radar {line - 1}"
    if separator != ",":  # There a comma is the decimal sign of many a spreadsheet.
        values = {key: value.replace(",", ".") for key, value in values.items()}
    label = f"row {line}"
    place = importer.degrees(label, values.pop("latitude"), values.pop("longitude"))
    if not values["max_threat_radius_m"]:
        raise importer.error(f"{label} radius", "nothing", "a radius in metres", line)
    importer.add(Kind.RADAR, [place], name, values, label)
