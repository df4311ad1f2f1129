"""Ground under the page's map: files that are read, where it is drawn, and files that cannot be used."""

import base64
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Transformer
from scipy.interpolate import RegularGridInterpolator

from companion.config import load_mission
from companion.config.load import text_of
from companion.errors import ConfigError
from companion.frames import LocalFrame
from companion.ui.page.access import Access
from companion.ui.page.feed import Feed
from companion.ui.page.ground import CELLS, SPREAD, ground_at
from companion.ui.page.page_server import PageServer
from companion.ui.page.playback import Playback
from tests.ui.page import made_ground
from tests.ui.page.flown import Told
from tests.ui.page.test_playback import asked
from tests.ui.reports.flights import mission

ALPS = (47.3, 8.6)
NO_STEP = 65_535


@pytest.fixture(scope="module")
def alps(tmp_path_factory):
    """Heights of the square N47E008 that rise to the north and ripple to the east, unknown in one corner."""

    def height_of(latitude, longitude):
        height = 500 + 1_000 * (latitude - 47) + 40 * np.sin(300 * longitude)
        return np.where((latitude > 47.9) & (longitude > 8.9), np.nan, height)

    folder = tmp_path_factory.mktemp("alps")
    made_ground.write_heights(folder, *ALPS, height_of)
    return folder


def heights_of(document):
    """Heights that a page is told [m up], NaN where unknown, and where they stand."""
    told = document["heights"]
    steps = np.frombuffer(base64.b64decode(told["steps"]), "<u2").reshape(told["rows"], told["columns"])
    up = np.where(steps == NO_STEP, np.nan, told["low_m"] + told["step_m"] * steps.astype(float))
    east = told["west_m"] + told["spacing_m"] * np.arange(told["columns"])
    return east, told["south_m"] + told["spacing_m"] * np.arange(told["rows"]), up


def test_heights_are_those_of_the_file(alps):
    frame = LocalFrame(*ALPS, altitude_amsl_m=450.0)
    bounds = (0.0, 4_000.0, 0.0, 2_000.0)
    east, north, up = heights_of(ground_at(alps).document(frame, bounds))
    assert (east[0], north[0]) == (-SPREAD * 4_000.0, -SPREAD * 4_000.0)
    assert len(east) == CELLS + 1, "along the longer side of the area"

    [file] = alps.iterdir()
    samples = np.fromfile(file, ">i2").reshape(made_ground.SIDE, made_ground.SIDE).astype(float)
    oracle = RegularGridInterpolator(
        (np.linspace(48, 47, made_ground.SIDE), np.linspace(8, 9, made_ground.SIDE)), samples
    )
    for row, column in [(0, 0), (57, 201), (200, 384), (100, 3)]:
        latitude, longitude, _ = frame.global_from_local(east[column], north[row], 0.0)
        assert up[row, column] == pytest.approx(oracle([[latitude, longitude]])[0] - 450.0, abs=0.02)


def test_a_corner_that_is_unknown_stays_so(alps):
    _, _, up = heights_of(
        ground_at(alps).document(LocalFrame(47.9, 8.9, 0.0), (-500.0, 500.0, -500.0, 500.0))
    )
    assert np.isnan(up[-1, -1])
    assert np.isfinite(up[0, 0])


def test_far_from_the_file_no_height_is_told(alps):
    document = ground_at(alps).document(LocalFrame(40.0, 8.6, 0.0), (0.0, 1_000.0, 0.0, 1_000.0))
    assert document["heights"] is None


def test_squares_beside_each_other_are_one_ground(tmp_path):
    for longitude in (7.5, 8.5):
        made_ground.write_heights(tmp_path, 47.5, longitude, lambda _, east: 100 * east)
    _, _, up = heights_of(
        ground_at(tmp_path).document(LocalFrame(47.5, 8.0, 0.0), (-500.0, 500.0, -500.0, 500.0))
    )
    assert np.isfinite(up).all()
    assert np.all(np.diff(up[10]) >= -0.02), "from 700 m at its west to 900 m at its east, without a step"


@given(
    latitude=st.floats(-60, 60), longitude=st.floats(-179, 179), size_m=st.floats(500, 10_000),
    right=st.floats(-1, 2), up=st.floats(-1, 2),
)  # fmt: skip
def test_tiles_lie_where_web_mercator_says(alps_tiles, latitude, longitude, size_m, right, up):
    frame = LocalFrame(latitude, longitude, 0.0)
    told = alps_tiles.document(frame, (0.0, size_m, 0.0, size_m))["tiles"]
    place = right * size_m, up * size_m
    lat, lon, _ = frame.global_from_local(*place, 0.0)
    x, y = Transformer.from_crs(4326, 3857, always_xy=True).transform(lon, lat)
    width = 2 * 20_037_508.342789244
    u, v = x / width + 0.5, 0.5 - y / width
    a, b = (u - told["middle"][0]) / told["scale"], (v - told["middle"][1]) / told["scale"]
    terms = np.array([1.0, a, b, a * a, a * b, b * b])
    found = terms @ told["east_m"], terms @ told["north_m"]
    assert found == pytest.approx(place, abs=1.0)


@pytest.fixture(scope="module")
def alps_tiles(tmp_path_factory):
    file = tmp_path_factory.mktemp("tiles") / "a.mbtiles"
    pictures = {(14, *made_ground.tile_at(14, *ALPS)): made_ground.picture("red")}
    pictures |= {(13, *made_ground.tile_at(13, *ALPS)): made_ground.picture("blue")}
    return ground_at(
        made_ground.write_tiles(file, pictures, attribution='<a href="http://x">© somebody</a>\n')
    )


def test_a_tile_is_asked_for_with_rows_from_the_north(alps_tiles):
    column, row = made_ground.tile_at(14, *ALPS)
    assert alps_tiles.tile(14, column, row) == ("image/png", made_ground.picture("red"))
    assert alps_tiles.tile(14, column, 2**14 - 1 - row) is None
    told = alps_tiles.document(LocalFrame(*ALPS, 0.0), (0.0, 1.0, 0.0, 1.0))["tiles"]
    assert (told["zoom_min"], told["zoom_max"], told["credit"]) == (13, 14, "© somebody")


def test_a_file_that_goes_away_in_flight_takes_nothing_with_it(tmp_path):
    made = made_ground.write_tiles(tmp_path / "a.mbtiles", {(1, 0, 0): made_ground.picture("red")})
    ground = ground_at(made)
    assert ground.tile(1, 0, 0) is not None
    made.unlink()
    assert ground.tile(1, 0, 0) is None
    assert not made.exists(), "asking does not make it anew"


@pytest.mark.parametrize("left", [None, b"", bytes(1_000)], ids=["gone", "empty", "cut off"])
def test_heights_that_go_away_before_a_mission_is_known_are_none(alps, tmp_path, left):
    shutil.copytree(alps, tmp_path / "ground")
    ground = ground_at(tmp_path / "ground")
    [file] = (tmp_path / "ground").iterdir()
    file.unlink()
    if left is not None:
        file.write_bytes(left)
    document = ground.document(LocalFrame(*ALPS, altitude_amsl_m=450.0), (0.0, 1_000.0, 0.0, 1_000.0))
    assert document["heights"] is None


def broken(folder, kind):
    """A file of a kind that cannot be used."""
    match kind:
        case "not there":
            return folder / "none.mbtiles"
        case "empty folder":
            return folder
        case "no database":
            (folder / "a.mbtiles").write_bytes(b"PK\x03\x04 something else" * 100)
        case "vector tiles":
            made_ground.write_tiles(folder / "a.mbtiles", {(1, 0, 0): b"\x1a"}, format="pbf")
        case "no tiles":
            made_ground.write_tiles(folder / "a.mbtiles", {})
        case "name":
            (folder / "alps.hgt").write_bytes(bytes(2 * 1201 * 1201))
        case "size":
            (folder / "N47E008.hgt").write_bytes(bytes(1_000))
    return next(folder.iterdir())


RASTER = "expected an MBTiles file with pictures (format png, jpg or webp)"
SQUARE = "expected heights named by their south-western corner, as N47E008.hgt"


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("not there", "none.mbtiles (no such file); expected an .mbtiles or .hgt file, or a"),
        ("empty folder", "(no such file in it); expected an .mbtiles or .hgt file, or a folder with some"),
        ("no database", f"(file is not a database); {RASTER}"),
        ("vector tiles", f"a.mbtiles (format pbf); {RASTER}"),
        ("no tiles", "a.mbtiles (no tiles); expected an MBTiles file"),
        ("name", f"alps.hgt (its name); {SQUARE}"),
        ("size", "(1000 bytes); expected 2884802 bytes (1201 by 1201 samples) or 25934402 bytes"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_named(tmp_path, kind, said):
    with pytest.raises(ConfigError) as caught:
        ground_at(broken(tmp_path, kind))
    assert "command line: --page-ground: got " in str(caught.value)
    assert said in str(caught.value)


def test_other_files_in_the_folder_are_left_alone(alps, tmp_path):
    shutil.copytree(alps, tmp_path / "ground")
    (tmp_path / "ground" / "README.txt").write_text("from a survey")
    assert len(ground_at(tmp_path / "ground").squares) == 1
    assert ground_at(None) is None


@pytest.fixture
def served(alps_tiles):
    made = []

    def serve(playbacks=(), feed=None, ground=alps_tiles):
        made.append(PageServer(Access(0), feed, playbacks, ground=ground))
        return made[-1]

    yield serve
    for server in made:
        server.close()


def answered(server, path):
    """Status, head and body of an answer."""
    head, _, body = asked(server, path)
    return int(head.split()[1]), head.decode(), body


def playback_of(config):
    playback = Playback("flown")
    playback.begin(1.0, text_of(config))
    return playback


def test_a_page_is_told_where_its_ground_is(served):
    server = served([playback_of(mission())])
    [source] = json.loads(asked(server, "/sources.json")[2])["sources"]
    assert source["ground"] == "/ground/0"
    told = json.loads(asked(server, source["ground"])[2])
    assert set(told) == {"area_m", "tiles"}
    column, row = made_ground.tile_at(14, *ALPS)
    status, head, body = answered(server, f"/tiles/14/{column}/{row}")
    assert (status, body) == (200, made_ground.picture("red"))
    assert "Content-Type: image/png" in head


@pytest.mark.parametrize(
    "path",
    ["/tiles/14/-1/0", "/tiles/999999999/1/1", "/tiles/1/2", "/tiles/1/2/3/4", "/tiles/a/b/c",
     "/tiles/1/1/٣", "/tiles/..%2F..%2Fetc/1/1", "/ground/1", "/ground/live", "/ground/"],
)  # fmt: skip
def test_what_is_not_there_is_not_found(served, path):
    server = served([playback_of(mission())])
    assert answered(server, path)[0] == 404


def test_a_tile_that_no_file_has_is_no_error(served):
    server = served([playback_of(mission())])
    for path in ("/tiles/14/0/0", "/tiles/99999999/1/1", "/tiles/3/99/0"):
        status, head, body = answered(server, path)
        assert (status, body) == (204, b"")
        assert "Content-Length: 0" in head


def test_without_files_there_is_no_ground(served):
    server = served([playback_of(mission())], ground=None)
    [source] = json.loads(asked(server, "/sources.json")[2])["sources"]
    assert "ground" not in source
    assert answered(server, "/ground/0")[0] == answered(server, "/tiles/14/0/0")[0] == 404


def test_a_running_flight_has_it_as_soon_as_its_mission_is_known(served):
    feed = Feed()
    server = served(feed=feed)
    assert answered(server, "/ground/live")[0] == 404
    Told(feed.tell).fly(2)
    feed.news()
    assert json.loads(asked(server, "/ground/live")[2])["tiles"]["zoom_max"] == 14


def test_a_mission_of_another_version_has_none(served):
    playback = Playback("old")
    playback.begin(1.0, "name: nonsense")
    assert json.loads(asked(served([playback]), "/ground/0")[2]) == {}


def test_commands_refuse_ground_that_is_not_there(companion_command, tmp_path):
    config = Path("mission_configs") / "first-flight.yaml"
    missing = tmp_path / "no.mbtiles"
    for command in (
        ("sitl", config, "--page", 18_458, "--page-ground", missing),
        ("run", config, "--link", "udpin://127.0.0.1:18459", "--page", 18_458, "--page-ground", missing),
    ):
        done = companion_command(*command)
        assert done.code == 2
        assert "--page-ground: got" in done.err
        assert "no such file" in done.err


def test_made_up_ground_is_read(tmp_path):
    valley = load_mission(Path("mission_configs") / "valley.yaml")
    made_ground.write_ground(valley, tmp_path)
    ground = ground_at(tmp_path)
    east, north, up = heights_of(ground.document(valley.frame, (0.0, 4_000.0, 0.0, 2_500.0)))
    ridge = up[np.argmin(np.abs(north - 1_225)), np.argmin(np.abs(east - 3_000))]
    plain = up[np.argmin(np.abs(north - 300)), np.argmin(np.abs(east - 3_000))]
    assert ridge > plain + 200
