"""Maps are read as they were written, in any coordinate system, and refused where they do not serve."""

import contextlib

import numpy as np
import pytest
import rasterio
from pyproj import Transformer

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config import mission_from_text
from companion.config.load import recorded_text
from companion.config.mission_summary import mission_summary
from companion.config.sections.terrain_map import ground_of, posts_of
from companion.errors import ConfigError
from companion.world.ground.elevation_file import TerrainError, read_posts
from tests.ground.maps import BOUNDS, FRAME
from tests.sim.client import CONFIGS, PLAIN

UTM, DEGREES = "EPSG:32755", "EPSG:4326"


def height_at(x, y, x0, y0, step):
    """Metres above the sea at a post: different for each."""
    return 600.0 + 3.0 * (x - x0) / step + 0.5 * (y0 - y) / step


def write(file, crs, step, *, beyond=0.02, hole=None, part=slice(None), amsl=0.0):
    """A GeoTIFF over the bounds and ``beyond`` degrees more; returns its first post and its step."""
    there = Transformer.from_crs(FRAME.crs, crs, always_xy=True)
    x, y = there.transform(np.array([0.0, 1000.0, 1000.0, 0.0]), np.array([0.0, 0.0, 800.0, 800.0]))
    more = beyond if crs == DEGREES else beyond * 1e5
    left, top = x.min() - more, y.max() + more
    columns, rows = int((x.max() + more - left) / step), int((top - y.min() + more) / step)
    transform = rasterio.Affine(step, 0.0, left + step * (part.start or 0), 0.0, -step, top)
    xs = left + (np.arange(columns) + 0.5) * step
    ys = top - (np.arange(rows) + 0.5) * step
    heights = height_at(xs[None, :], ys[:, None], left, top, step).astype("float32") + amsl
    if hole is not None:
        heights[hole] = -9999.0
    heights = heights[:, part]
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "nodata": -9999.0}
    with rasterio.open(
        file, "w", height=heights.shape[0], width=heights.shape[1], transform=transform, **profile
    ) as out:
        out.write(heights, 1)
    return left, top


@pytest.mark.parametrize(("crs", "step"), [(UTM, 25.0), (DEGREES, 1.0 / 3600.0)])
def test_heights_are_those_of_the_file(tmp_path, crs, step):
    left, top = write(tmp_path / "map.tif", crs, step)
    posts = read_posts(tmp_path / "map.tif", FRAME, BOUNDS, 0.0)
    there = Transformer.from_crs(FRAME.crs, crs, always_xy=True)
    places = np.random.default_rng(1).uniform((0.0, 0.0), (1000.0, 800.0), (50, 2))
    x, y = there.transform(places[:, 0], places[:, 1])
    expected = height_at(x, y, left, top, step) - FRAME.altitude_amsl_m
    assert GroundHeights(posts, 50.0, 120.0).up_m(places) == pytest.approx(expected, abs=0.02)


def test_a_folder_of_tiles_is_one_map(tmp_path):
    folder = tmp_path / "tiles"
    folder.mkdir()
    write(tmp_path / "whole.tif", UTM, 25.0)
    write(folder / "west.tif", UTM, 25.0, part=slice(0, 100))
    write(folder / "east.tif", UTM, 25.0, part=slice(100, None))
    (folder / "notes.txt").write_text("not a map")
    whole, tiles = (read_posts(tmp_path / name, FRAME, BOUNDS, 0.0) for name in ("whole.tif", "tiles"))
    np.testing.assert_array_equal(whole.up_m, tiles.up_m)
    assert (whole.first_x, whole.first_y) == (tiles.first_x, tiles.first_y)


def test_heights_over_the_ellipsoid_are_lowered_by_the_geoid(tmp_path):
    write(tmp_path / "map.tif", UTM, 25.0)
    plain, lowered = (read_posts(tmp_path / "map.tif", FRAME, BOUNDS, geoid) for geoid in (0.0, 19.5))
    assert plain.up_m - lowered.up_m == pytest.approx(19.5)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda folder: folder / "nothing.tif", "GDAL reads"),
        (
            lambda folder: write(folder / "map.tif", UTM, 25.0, beyond=0.0) and folder / "map.tif",
            "every post",
        ),
        (
            lambda folder: write(folder / "map.tif", UTM, 25.0, hole=(100, 100)) and folder / "map.tif",
            "no height at 1 of",
        ),
        (lambda folder: folder, "no raster file"),
    ],
)
def test_what_does_not_serve_is_refused(tmp_path, make, words):
    place = make(tmp_path)
    with pytest.raises(TerrainError, match=words):
        read_posts(place, FRAME, BOUNDS, 0.0)


def mission_text(terrain, **changes):
    """A mission over ground."""
    return PLAIN.replace("dimension: 2", "dimension: 3") + f"terrain: {terrain}\n"


@pytest.mark.parametrize(
    ("terrain", "key", "words"),
    [
        ("{}", "terrain", "one of file, generated and sample"),
        ("{sample: jacksboro_fault, file: a.tif}", "terrain", "one of file, generated and sample"),
        ("{file: a.tif}", "terrain.file", "GDAL reads"),
        ("{sample: jacksboro_fault}", "terrain.sample", "cover"),
        ("{generated: {kind: hills}, height_min_m: 5}", "terrain.height_min_m", "clearance_min_m"),
        ("{generated: {kind: hills}, height_max_m: 40}", "terrain.height_max_m", "above height_min_m, 50"),
        ("{generated: {kind: hills}, height_wanted_m: 40}", "terrain.height_wanted_m", "between"),
        ("{generated: {kind: hills, relief_m: 3000}}", "start.up_m", "height over ground"),
    ],
)
def test_a_wrong_section_is_named_with_its_key(terrain, key, words):
    with pytest.raises(ConfigError) as caught:
        mission_from_text(mission_text(terrain), "ground.yaml")
    assert caught.value.key == key
    assert words in caught.value.expected


def test_a_radar_below_the_ground_is_refused():
    """It would see nothing. In ``ridge`` the ground is 230 m up 2,500 m east, 900 m north."""
    text = (CONFIGS / "ridge.yaml").read_text(encoding="utf-8")
    place = "east_m: 1900, north_m: 300, up_m: 71"
    assert place in text
    for up_m, is_below in ((80.0, True), (232.0, False)):
        moved = text.replace(place, f"east_m: 2500, north_m: 900, up_m: {up_m}")
        with pytest.raises(ConfigError) if is_below else contextlib.nullcontext() as caught:
            mission_from_text(moved, "ridge.yaml")
        if is_below:
            assert caught.value.key == "radars.0.up_m"
            assert "height of the ground there" in caught.value.expected
    far = text.replace(place, "east_m: 9000, north_m: 900, up_m: 0")
    assert mission_from_text(far, "ridge.yaml").radars[0].up_m == 0


def test_a_file_lies_beside_the_mission_file(tmp_path):
    write(tmp_path / "map.tif", UTM, 25.0, beyond=0.1, amsl=-2000.0)
    text = mission_text("{file: map.tif}")
    mission = mission_from_text(text, str(tmp_path / "mission.yaml"))
    assert posts_of(mission).name == "map.tif"
    assert np.isfinite(ground_of(mission).high).all()


def test_a_recording_finds_the_map_from_another_folder(tmp_path):
    write(tmp_path / "a map.tif", UTM, 25.0, beyond=0.1, amsl=-2000.0)
    text = mission_text("{file: a map.tif, height_min_m: 60}  # our valley")
    mission = mission_from_text(text, str(tmp_path / "mission.yaml"))
    with pytest.raises(ConfigError, match="No such file"):
        mission_from_text(text, str(tmp_path / "flights" / "flight.mcap"))
    told = recorded_text(text, mission)
    assert mission_from_text(told, str(tmp_path / "flights" / "flight.mcap")) == mission
    assert told.endswith("height_min_m: 60}  # our valley\n")
    assert recorded_text(PLAIN, mission_from_text(PLAIN, "m.yaml")) == PLAIN


def test_the_same_seed_gives_the_same_ground():
    missions = [
        mission_from_text(mission_text(f"{{generated: {{kind: ridges, seed: {n}, relief_m: 40}}}}"), "m.yaml")
        for n in (1, 1, 2)
    ]
    first, again, other = (posts_of(mission).up_m for mission in missions)
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert first.min() == 0.0
    assert first.max() == pytest.approx(40.0)


def test_the_summary_says_what_the_map_holds():
    mission = mission_from_text(mission_text("{generated: {kind: hills, seed: 1, relief_m: 40}}"), "m.yaml")
    told = mission_summary(mission)["ground"]
    of_places = {key: told.pop(key) for key in list(told) if "over_ground" in key or "way" in key}
    assert set(of_places) == {
        *("start_over_ground_m", "goals_over_ground_m"),
        *("straight_way_over_ground_m", "straight_way_lowest_after_m"),
    }
    assert told == {
        "map": "hills 1", "lowest_up_m": 0, "highest_up_m": 39, "highest_amsl_m": 623, "spacing_m": 30,
    }  # fmt: skip
