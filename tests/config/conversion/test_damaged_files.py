"""Files of every format, damaged anywhere: what is read is a mission, or one error that was meant."""

import io
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from companion.cli_options import Targets
from companion.config import mission_from_text
from companion.config.conversion.exchange_files import READERS, export_mission, imported, taken
from companion.config.conversion.found_places import Kind
from companion.config.conversion.mission_composition import Wishes
from companion.errors import ConfigError
from tests.config.conversion.files import EXAMPLES, written
from tests.sim.client import CONFIGS

HOME = (-35.363261, 149.16523, 584.0)
WAYPOINTS = "QGC WPL 110\n0 1 0 16 0 0 0 0 -35.36 149.16 584 1\n1 0 3 16 0 0 0 0 -35.35 149.18 80 1\n"
GPX = '<gpx version="1.1"><rte><rtept lat="-35.35" lon="149.18"><ele>700</ele></rtept></rte></gpx>'


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """A good file of each format."""
    folder = tmp_path_factory.mktemp("samples")
    for form in ("plan", "kml", "geojson"):
        targets = {"plan": None, "kml": None, "geojson": None} | {form: folder / f"a.{form}"}
        export_mission(CONFIGS / "search-area.yaml", Targets(**targets, replaces=True))
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as target:
        target.writestr("doc.kml", (folder / "a.kml").read_bytes())
    good = {
        ".plan": (EXAMPLES / "field.plan").read_bytes(),
        ".kml": (folder / "a.kml").read_bytes(),
        ".kmz": archive.getvalue(),
        ".geojson": (folder / "a.geojson").read_bytes(),
        ".json": (folder / "a.geojson").read_bytes(),
        ".csv": (EXAMPLES / "radars.csv").read_bytes(),
        ".waypoints": WAYPOINTS.encode(),
        ".txt": WAYPOINTS.encode(),
        ".gpx": GPX.encode(),
    }
    return good.__getitem__


PUT = [b"", b"-", b"9", b"nan", b"1e400", b"null", b"[", b"}", b"<", b"\xff", b"\x00", b'"', b"95"]
WORDS = st.sampled_from(PUT)
DAMAGE = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 12), WORDS), min_size=1, max_size=4)


def result(path, call=taken):
    """What a call returns for a file, or its error."""
    try:
        return call(path)
    except ConfigError as error:
        return error


def mission_text(path):
    return imported([path], Wishes("mine", home=HOME))


@pytest.mark.parametrize("ending", READERS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damage=DAMAGE)
@example(damage=[(0.0, 1, b"")])
def test_a_damaged_file_is_a_mission_or_one_error(samples, tmp_path, ending, damage):
    data = samples(ending)
    for place, removed, put in damage:
        at = int(place * len(data))
        data = data[:at] + put + data[at + removed :]
    found = result(written(tmp_path, f"a{ending}", data), mission_text)
    if isinstance(found, ConfigError):
        assert found.expected
        assert "a" + ending in found.file
    else:
        mission_from_text(found, "mine.yaml")


@pytest.mark.parametrize("ending", READERS)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=200))
@example(data=b"\xef\xbb\xbf")
@example(data=b"\xef\xbb\xbf \n")
@example(data=b"\x0c\n\x0b")
def test_any_bytes_are_taken_or_one_error(tmp_path, ending, data):
    found = result(written(tmp_path, f"a{ending}", data))
    if isinstance(found, ConfigError):
        assert Path(found.file).name == f"a{ending}"
    else:
        assert all(isinstance(place.kind, Kind) for place in found.places)


def test_the_samples_are_good(samples, tmp_path):
    for ending in READERS:
        assert taken(written(tmp_path, f"a{ending}", samples(ending))).places, ending


def test_a_place_far_from_home_is_named(tmp_path):
    far = WAYPOINTS.replace("-35.35", "35.35")
    with pytest.raises(ConfigError) as caught:
        imported([written(tmp_path, "a.waypoints", far)], Wishes("mine"))
    assert (caught.value.file, caught.value.key) == ("a.waypoints: item 1", "place")
    assert caught.value.value.startswith("35.350000, 149.180000, which is 7828 km")
