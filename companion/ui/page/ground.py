"""The ground under the map, from files on this computer: raster tiles and heights. Nothing is planned by it.

References
----------
MBTiles 1.3 specification (Mapbox): the tables ``metadata`` and ``tiles``, whose rows count from the south.
Farr et al., "The Shuttle Radar Topography Mission", Rev. Geophys. 45, 2007: height files (``.hgt``), a
degree square each, big-endian 16-bit metres above the geoid, rows from the north, -32768 where unknown.
"""

from __future__ import annotations

import base64
import math
import re
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.errors import ConfigError
from companion.frames import LocalFrame
from companion.plain_text import printable

FloatArray = NDArray[np.float64]
TILES, HEIGHTS = ".mbtiles", ".hgt"
TILE_MAX = 4 * 2**20  # Most bytes of a picture.
ZOOM_MAX = 24
BUSY_S = 0.2  # Another program may hold the file for this long.
SPREAD = 1.0  # The area extends the bounds on each side by this share of their longer side.
CELLS = 384  # Cells of the height map along the longer side of the area.
_KINDS = {"png": "image/png", "jpg": "image/jpeg", "jpeg": "image/jpeg", "webp": "image/webp"}
_UNKNOWN = -32_768
_NO_STEP = 65_535
_SIDES = {1201, 3601}  # Samples along a degree.
_CREDIT_MAX = 300  # Most characters of a credit.
_FIT_POINTS = 9  # Points along each side of the area.
_OPTION = "--page-ground"
_SQUARE = re.compile(r"([NS])(\d{2})([EW])(\d{3})\.hgt", re.IGNORECASE)


@dataclass(frozen=True)
class Tiles:
    """A file of map tiles: Web Mercator squares by zoom, column and row.

    Parameters
    ----------
    file : Path
        The MBTiles file.
    kind : str
        MIME type of its pictures.
    zoom_min, zoom_max : int
        Levels that it has.
    credit : str
        Name of who made the map, as the file says.
    """

    file: Path
    kind: str
    zoom_min: int
    zoom_max: int
    credit: str

    def picture(self, zoom: int, column: int, row: int) -> bytes | None:
        """Picture of a tile, rows counted from the north; None where there is none, or it cannot be read."""
        if not (self.zoom_min <= zoom <= self.zoom_max and 0 <= column < 2**zoom and 0 <= row < 2**zoom):
            return None
        query = (
            "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ? "
            f"AND length(tile_data) <= {TILE_MAX}"
        )
        try:
            found = _rows_of_query(self.file, query, zoom, column, 2**zoom - 1 - row)
        except sqlite3.Error:  # The file existed when the page was opened; a stick may have been pulled out.
            return None
        return bytes(found[0][0]) if found and isinstance(found[0][0], bytes) else None


@dataclass(frozen=True)
class Square:
    """A file of heights.

    Parameters
    ----------
    file : Path
        The height file.
    south_deg, west_deg : int
        South-western corner of the square.
    side : int
        Samples along each side, the rim's two included.
    """

    file: Path
    south_deg: int
    west_deg: int
    side: int

    def heights(self, latitude_deg: FloatArray, longitude_deg: FloatArray) -> FloatArray:
        """Heights above the geoid of n points in it [m], shape (n,), bilinear; NaN where none can be read.

        Parameters
        ----------
        latitude_deg, longitude_deg : ndarray, shape (n,)
            Points, WGS84.

        Returns
        -------
        ndarray, shape (n,)
            Heights [m].
        """
        try:
            samples = np.memmap(self.file, dtype=">i2", mode="r", shape=(self.side, self.side))
        except (OSError, ValueError):  # The file was removed or cut off since the page was opened.
            return np.full(len(latitude_deg), np.nan)
        down = (self.south_deg + 1 - latitude_deg) * (self.side - 1)
        right = (longitude_deg - self.west_deg) * (self.side - 1)
        row = np.clip(np.floor(down), 0, self.side - 2).astype(np.intp)
        column = np.clip(np.floor(right), 0, self.side - 2).astype(np.intp)

        around = [
            samples[row + down_by, column + east_by].astype(np.float64)
            for down_by in (0, 1)
            for east_by in (0, 1)
        ]
        for found in around:
            found[found == _UNKNOWN] = np.nan
        low, across = down - row, right - column
        above = (1.0 - across) * around[0] + across * around[1]
        below = (1.0 - across) * around[2] + across * around[3]
        return (1.0 - low) * above + low * below


@dataclass(frozen=True)
class Ground:
    """The ground that is drawn under the map.

    Parameters
    ----------
    tiles : tuple of Tiles
        Map tiles; the first that has a tile is drawn.
    squares : tuple of Square
        Heights.
    """

    tiles: tuple[Tiles, ...] = ()
    squares: tuple[Square, ...] = ()

    def tile(self, zoom: int, column: int, row: int) -> tuple[str, bytes] | None:
        """MIME type and picture of a tile; None where no file has it."""
        for tiles in self.tiles:
            picture = tiles.picture(zoom, column, row)
            if picture is not None:
                return tiles.kind, picture
        return None

    def document(self, frame: LocalFrame, bounds_m: tuple[float, ...]) -> dict[str, object]:
        """Return what the page needs to draw the ground about a mission: the tiles' addresses, and heights.

        Parameters
        ----------
        frame : LocalFrame
            The mission's.
        bounds_m : tuple of float
            West, east, south, north (and more) of the mission [m].
        """
        west, east, south, north = bounds_m[:4]
        spread = SPREAD * max(east - west, north - south)
        area = (west - spread, east + spread, south - spread, north + spread)
        found: dict[str, object] = {"area_m": area}
        if self.tiles:
            found["tiles"] = {
                "zoom_min": min(tiles.zoom_min for tiles in self.tiles),
                "zoom_max": max(tiles.zoom_max for tiles in self.tiles),
                "credit": "; ".join(dict.fromkeys(tiles.credit for tiles in self.tiles if tiles.credit)),
                **_places_of_tiles(frame, area),
            }
        if self.squares:
            found["heights"] = self._heights(frame, area)
        return found

    def _heights(
        self, frame: LocalFrame, area: tuple[float, float, float, float]
    ) -> dict[str, object] | None:
        """Heights above the mission's origin, as in :func:`height_grid`; None where none is known."""
        west, east, south, north = area
        spacing = max(east - west, north - south) / CELLS
        columns = math.floor((east - west) / spacing) + 1
        rows = math.floor((north - south) / spacing) + 1
        x, y = np.meshgrid(west + spacing * np.arange(columns), south + spacing * np.arange(rows))
        latitude, longitude = frame.places_from_local(x.ravel(), y.ravel())
        height = np.full(x.size, np.nan)
        for square in self.squares:
            inside = (
                np.isnan(height)
                & (latitude >= square.south_deg)
                & (latitude <= square.south_deg + 1)
                & (longitude >= square.west_deg)
                & (longitude <= square.west_deg + 1)
            )
            if inside.any():
                height[inside] = square.heights(latitude[inside], longitude[inside])
        if np.isnan(height).all():
            return None
        height -= frame.altitude_amsl_m
        return height_grid(height.reshape(rows, columns), (west, south, spacing))


def height_grid(up_m: FloatArray, grid: tuple[float, float, float]) -> dict[str, object]:
    """Return heights for the page: 16-bit little-endian steps above the lowest, in base64.

    Parameters
    ----------
    up_m : ndarray, shape (NY, NX)
        Rows from south to north [m]; not a number where unknown, which becomes the highest step.
    grid : tuple of float
        West and south of the first height, and the spacing [m].
    """
    low, high = float(np.nanmin(up_m)), float(np.nanmax(up_m))
    step = max((high - low) / (_NO_STEP - 1), 1e-3)
    steps = np.where(np.isnan(up_m), _NO_STEP, np.round((up_m - low) / step))
    return {
        "west_m": grid[0],
        "south_m": grid[1],
        "spacing_m": grid[2],
        "columns": up_m.shape[1],
        "rows": up_m.shape[0],
        "low_m": low,
        "step_m": step,
        "steps": base64.b64encode(steps.astype("<u2").tobytes()).decode("ascii"),
    }


def _places_of_tiles(frame: LocalFrame, area: tuple[float, float, float, float]) -> dict[str, object]:
    """Web Mercator of the area's middle, and polynomials from differences to it to the mission's metres.

    Mercator x and y count 0 to 1 from the date line eastwards and from the north southwards. Of second order,
    since the scale changes with the latitude: 2 m at 10 km without it, centimetres with it.
    """
    west, east, south, north = area
    x, y = np.meshgrid(np.linspace(west, east, _FIT_POINTS), np.linspace(south, north, _FIT_POINTS))
    latitude, longitude = frame.places_from_local(x.ravel(), y.ravel())
    u = longitude / 360.0 + 0.5
    v = 0.5 - np.arcsinh(np.tan(np.radians(latitude))) / (2.0 * np.pi)
    middle = float(u.mean()), float(v.mean())
    scale = max(float(np.ptp(u)), float(np.ptp(v)))
    du, dv = (u - middle[0]) / scale, (v - middle[1]) / scale
    terms = np.stack([np.ones_like(du), du, dv, du * du, du * dv, dv * dv], axis=1)
    fit = np.linalg.lstsq(terms, np.stack([x.ravel(), y.ravel()], axis=1), rcond=None)[0]
    return {"middle": middle, "scale": scale, "east_m": fit[:, 0].tolist(), "north_m": fit[:, 1].tolist()}


def ground_at(path: Path | None) -> Ground | None:
    """Ground of a file, or of all that a folder has; None where none is asked for.

    Parameters
    ----------
    path : Path or None
        ``.mbtiles`` or ``.hgt`` file, or folder with such files.

    Raises
    ------
    ConfigError
        If there is none, or one cannot be used.
    """
    if path is None:
        return None
    files = _files_at(path)
    return Ground(
        tuple(_tiles_in(file) for file in files if file.suffix.lower() == TILES),
        tuple(_square_in(file) for file in files if file.suffix.lower() == HEIGHTS),
    )


def _files_at(path: Path) -> list[Path]:
    """Files of the ground: the one that is named, or all in a folder."""
    kinds = f"an {TILES} or {HEIGHTS} file, or a folder with some"
    if not path.exists():
        raise _refused(path, "no such file", kinds)
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
    except OSError as error:
        raise _refused(path, str(error.strerror), kinds) from error
    files = [file for file in files if file.suffix.lower() in (TILES, HEIGHTS)]
    if not files:
        raise _refused(path, "no such file in it" if path.is_dir() else "another kind of file", kinds)
    return files


def _refused(file: Path, found: str, expected: str) -> ConfigError:
    return ConfigError("command line", None, _OPTION, f"{printable(file)} ({found})", expected)


def _rows_of_query(file: Path, query: str, *values: object) -> list[tuple[object, ...]]:
    """Rows of a database that is only read. It is opened each time: a picture takes a millisecond more."""
    with closing(
        sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=BUSY_S)
    ) as connection:
        return connection.execute(query, values).fetchall()


def _tiles_in(file: Path) -> Tiles:
    """Map tiles of a file."""
    raster = "an MBTiles file with pictures (format png, jpg or webp)"
    try:
        metadata = {
            str(name): str(value) for name, value in _rows_of_query(file, "SELECT name, value FROM metadata")
        }
        levels = _rows_of_query(file, "SELECT min(zoom_level), max(zoom_level) FROM tiles")[0]
    except (sqlite3.Error, ValueError) as error:
        raise _refused(file, str(error), raster) from error
    kind = metadata.get("format", "nothing").strip().lower()
    if kind not in _KINDS:
        raise _refused(file, f"format {printable(kind[:40])}", raster)
    low, high = levels
    if not (isinstance(low, int) and isinstance(high, int) and 0 <= low <= high <= ZOOM_MAX):
        raise _refused(
            file, "no tiles" if low is None else f"zoom {low} to {high}", f"{raster}, zoom 0 to {ZOOM_MAX}"
        )
    credit = re.sub(r"<[^>]*>", "", metadata.get("attribution", ""))
    return Tiles(file, _KINDS[kind], low, high, printable(credit[:_CREDIT_MAX]).strip())


def _square_in(file: Path) -> Square:
    """Heights of a file."""
    named = _SQUARE.fullmatch(file.name)
    if named is None:
        raise _refused(file, "its name", "heights named by their south-western corner, as N47E008.hgt")
    south, west = int(named[2]), int(named[4])
    try:
        size = file.stat().st_size
    except OSError as error:
        raise _refused(file, str(error.strerror), "a file that can be read") from error
    side = math.isqrt(size // 2)
    if side not in _SIDES or 2 * side * side != size:
        raise _refused(
            file,
            f"{size} bytes",
            " or ".join(f"{2 * n * n} bytes ({n} by {n} samples)" for n in sorted(_SIDES)),
        )
    return Square(
        file, south if named[1].upper() == "N" else -south, west if named[3].upper() == "E" else -west, side
    )
