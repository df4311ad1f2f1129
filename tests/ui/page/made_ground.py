"""Made-up ground for a mission: a height file and a file of map tiles, as other programs write them.

``python -m tests.ui.page.made_ground MISSION FOLDER`` writes both, hills where the mission's obstacles stand.
"""

import io
import math
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import shapely
from PIL import Image, ImageDraw

from companion.config import load_mission

SIDE = 1201
UNKNOWN = -32_768
TILE = 256
NEAR_M = 20_000  # of the origin there are hills
SLOPE_M = 60


def square_name(latitude_deg, longitude_deg):
    """Name of the height file that has a place."""
    south, west = math.floor(latitude_deg), math.floor(longitude_deg)
    return f"{'N' if south >= 0 else 'S'}{abs(south):02d}{'E' if west >= 0 else 'W'}{abs(west):03d}.hgt"


def write_heights(folder, latitude_deg, longitude_deg, height_of):
    """A height file of the square that has a place; ``height_of`` is asked by latitudes and longitudes."""
    south, west = math.floor(latitude_deg), math.floor(longitude_deg)
    latitude, longitude = np.meshgrid(
        np.linspace(south + 1, south, SIDE), np.linspace(west, west + 1, SIDE), indexing="ij"
    )
    file = Path(folder) / square_name(latitude_deg, longitude_deg)
    heights = height_of(latitude.ravel(), longitude.ravel()).reshape(SIDE, SIDE)
    np.where(np.isnan(heights), UNKNOWN, np.round(heights)).astype(">i2").tofile(file)
    return file


def mercator(latitude_deg, longitude_deg):
    """Web Mercator, 0 to 1 eastwards and southwards (EPSG:3857 over its width)."""
    north = math.log(math.tan(math.pi / 4 + math.radians(latitude_deg) / 2))
    return longitude_deg / 360 + 0.5, 0.5 - north / (2 * math.pi)


def tile_at(zoom, latitude_deg, longitude_deg):
    """Column and row of the tile with a place, rows from the north."""
    u, v = mercator(latitude_deg, longitude_deg)
    return math.floor(u * 2**zoom), math.floor(v * 2**zoom)


def write_tiles(file, pictures, **about):
    """An MBTiles file with pictures by zoom, column and row from the north; what else its metadata says."""
    Path(file).unlink(missing_ok=True)
    metadata = {"name": "made up", "format": "png"} | about
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute("CREATE TABLE metadata (name text, value text)")
        connection.execute(
            "CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)"
        )
        connection.executemany("INSERT INTO metadata VALUES (?, ?)", metadata.items())
        connection.executemany(
            "INSERT INTO tiles VALUES (?, ?, ?, ?)",
            [(zoom, column, 2**zoom - 1 - row, picture) for (zoom, column, row), picture in pictures.items()],
        )
    return Path(file)


def picture(colour, marks=()):
    """A tile of one colour, with lines of (points, colour, width) in pixels on it."""
    image = Image.new("RGB", (TILE, TILE), colour)
    pen = ImageDraw.Draw(image)
    for points, ink, width in marks:
        pen.line(points, fill=ink, width=width)
    data = io.BytesIO()
    image.save(data, "png")
    return data.getvalue()


def hills(mission):
    """Heights above the sea by latitude and longitude: hills where obstacles stand, else a plain."""
    walls = [
        (shapely.Polygon(wall.polygon_enu_m), wall.top_m - wall.base_m) for wall in mission.obstacle_list
    ]

    def height_of(latitude, longitude):
        east = (
            (longitude - mission.origin.longitude_deg)
            * 111_320
            * math.cos(math.radians(mission.origin.latitude_deg))
        )
        north = (latitude - mission.origin.latitude_deg) * 110_950
        up = 25 * np.sin(east / 900) * np.cos(north / 700) + 15 * np.sin(north / 310 + east / 530)
        near = np.hypot(east, north) < NEAR_M
        places = shapely.points(east[near], north[near])
        for wall, top in walls:
            share = np.exp(-((shapely.distance(wall, places) / SLOPE_M) ** 2))
            up[near] = np.maximum(up[near], 0.9 * top * share + (1 - share) * up[near])
        return mission.origin.altitude_amsl_m + up

    return height_of


def write_ground(mission, folder):
    """Heights of a mission's square, and tiles of fields and a road about it."""
    origin = mission.origin
    write_heights(folder, origin.latitude_deg, origin.longitude_deg, hills(mission))
    pictures, dice = {}, np.random.default_rng(1)
    zoom = 15
    east = mission.bounds.east_m[1]
    corners = [
        tile_at(zoom, *mission.frame.global_from_local(x, y, 0.0)[:2])
        for x, y in ((-1.0 * east, -1.0 * east), (2.0 * east, 2.0 * east))
    ]
    (west, south), (last, north) = corners
    for column in range(west, last + 1):
        for row in range(north, south + 1):
            green = [int(value) for value in np.array([205, 218, 190]) + dice.integers(-14, 14, 3)]
            field = [((0, 128), (256, 128)), ((128, 0), (128, 256))]
            marks = [(points, (188, 200, 172), 2) for points in field]
            if row == (south + north) // 2:
                marks.append((((0, 90), (90, 110), (180, 80), (256, 90)), (255, 255, 255), 7))
            pictures[zoom, column, row] = picture(tuple(green), marks)
    write_tiles(Path(folder) / "made-up.mbtiles", pictures, attribution="made up for a <b>test</b>")


if __name__ == "__main__":
    write_ground(load_mission(Path(sys.argv[1])), sys.argv[2])
