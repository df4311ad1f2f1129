"""A recording as a picture for rerun: what is logged where and when, and that the package takes it."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from companion.config.load import text_of
from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording import rerun_export
from companion.recording import scene_update as scenes
from companion.recording.mcap_reader import messages_of
from companion.recording.rerun_export import TIMELINE, export_rerun
from tests.cli.calls import in_a_process
from tests.ui.page.flown import EPOCH_S, recorded
from tests.ui.reports.flights import mission

ITS_NAME = "expected a name that ends in .rrd with --rerun, and only then"
DRAWN = (
    "Arrows3D", "Clear", "Ellipsoids3D", "GeoPoints", "LineStrips3D", "Mesh3D", "Points3D", "Quaternion",
    "Scalars", "SeriesLines", "TextLog", "TimeRange", "Transform3D",
)  # fmt: skip
LAID_OUT = (
    "Blueprint", "BlueprintPanel", "EyeControls3D", "Horizontal", "LineGrid3D", "MapView", "PlotLegend",
    "ScalarAxis", "SelectionPanel", "Spatial3DView", "Tabs", "TextLogColumns", "TextLogView", "TimeAxis",
    "TimePanel", "TimeSeriesView", "Vertical",
)  # fmt: skip


class Made(SimpleNamespace):
    """Something of the package: its kind and what it was made of."""


class Stream:
    """Notes what is logged, and when by the flight's clock; None is for always."""

    def __init__(self):
        self.logged, self.now_s, self.blueprint, self.is_ended = [], None, None, False

    def set_log_time_enabled(self, *, enabled):
        assert not enabled

    set_log_tick_enabled = set_log_time_enabled

    def binary_stream(self):
        return SimpleNamespace(read=lambda flush=True: b"picture")

    def send_recording_name(self, name):
        self.name = name

    def set_time(self, timeline, *, duration):
        assert timeline == TIMELINE
        self.now_s = duration

    def log(self, path, made, static=False):
        path = path if isinstance(path, str) else "/".join(path)
        self.logged.append((path, None if static else self.now_s, made))

    def send_blueprint(self, blueprint):
        self.blueprint = blueprint

    def disconnect(self):
        self.is_ended = True

    def of(self, path):
        """What was logged under a path but what holds always."""
        return [
            (stamp_s, made) for logged, stamp_s, made in self.logged if logged == path and stamp_s is not None
        ]


def kind_of(name):
    def make(*given, **more):
        return Made(kind=name, given=given, **more)

    return make


def package_of(noted):
    """The few calls of the package that are in use."""
    return SimpleNamespace(
        **{name: kind_of(name) for name in DRAWN},
        RecordingStream=lambda _, send_properties: noted,
        Radius=SimpleNamespace(ui_points=lambda size: size),
        TimeRangeBoundary=SimpleNamespace(infinite=lambda: "an end"),
        ViewCoordinates=SimpleNamespace(RIGHT_HAND_Z_UP="z is up"),
        blueprint=SimpleNamespace(**{name: kind_of(name) for name in LAID_OUT}),
    )


@pytest.fixture
def stream(monkeypatch):
    noted = Stream()
    monkeypatch.setitem(sys.modules, "rerun", package_of(noted))
    return noted


def drawing():
    """A drawing of the made-up mission, and what it logs."""
    noted = Stream()
    made = rerun_export._Drawing(package_of(noted), noted)
    made.draw(channels.MISSION, {"mission_file": text_of(mission()), "epoch_s": EPOCH_S, "stamp_s": 0.0})
    return made, noted


@pytest.fixture
def flight(tmp_path):
    return recorded(tmp_path / "flight", level=0.25)


def test_paths_and_counts(flight, stream, tmp_path):
    export_rerun(flight, tmp_path / "out.rrd")
    counts = Counter(path for path, stamp_s, _ in stream.logged if stamp_s is not None)
    # The track is drawn each 0.5 s at most, which are 0.6 s at 5 Hz: at 0, 0.6, … 9.6 s.
    kinds = [counts.pop(f"world/track/icao:D70001/{kind}") for kind in ("lines", "spheres", "name")]
    assert kinds == [17, 17, 17]
    stamps = [stamp_s for stamp_s, _ in stream.of("world/flown/lines")]
    steps = np.diff(stamps)
    assert counts.pop("world/flown/lines") == len(stamps) > 8
    assert steps.min() > 0.99
    assert steps[:-1].max() < 1.21
    assert counts == {
        "world/aircraft": 51, "world/obstacle/wall/solid": 1, "world/obstacle/hut/solid": 1,
        "world/radar/radar_1/lines": 1, "world/radar/radar_1/spheres": 1, "world/radar/radar_1/name": 1,
        "world/goal/1/spheres": 1, "world/aircraft/horizon/lines": 1, "world/field/over 0.25/solid": 1,
        "world/field/over 0.5/solid": 1, "world/field/over 0.75/solid": 1, "world/candidate/lines": 1,
        "world/search/tree/lines": 1, "world/search/sub goals/spheres": 1, "world/mission/lines": 1,
        "world/track/icao:D70001": 1, "decisions": 2, "altitude_m": 51, "speed_m_s/air": 51,
        "speed_m_s/ground": 51, "threat_level": 51, "geo/aircraft": counts["geo/aircraft"],
    }  # fmt: skip
    assert (tmp_path / "out.rrd").read_bytes() == b"picture"
    assert stream.name == "flight"
    assert stream.is_ended


def test_times_are_the_flights_own(flight, stream, tmp_path):
    export_rerun(flight, tmp_path / "out.rrd")
    assert [stamp_s for stamp_s, _ in stream.of("decisions")] == [0.5, 10.0]
    stamps = [stamp_s for stamp_s, _ in stream.of("altitude_m")]
    np.testing.assert_allclose(stamps, [*(0.2 * np.arange(50)), 12.0])
    # Places on the map tell UTC alone.
    located = [stamp_s for stamp_s, _ in stream.of("geo/aircraft")]
    assert len(located) >= 10
    assert located[0] == pytest.approx(0.0, abs=1e-6)
    assert located[-1] == pytest.approx(12.0, abs=1e-6)
    assert [stamp_s for stamp_s, _ in stream.of("world/mission/lines")] == [0.5]
    assert stream.of("world/track/icao:D70001") == [(12.0, Made(kind="Clear", given=(), recursive=True))]


def test_what_is_drawn(flight, stream, tmp_path):
    export_rerun(flight, tmp_path / "out.rrd")
    ((_, way),) = stream.of("world/mission/lines")
    np.testing.assert_array_equal(
        way.given[0], [[[100.0, 750.0, 120.0], [900.0, 1000.0, 120.0], [1900.0, 750.0, 120.0]]]
    )
    ((_, tree),) = stream.of("world/search/tree/lines")
    assert np.shape(tree.given[0]) == (50, 2, 3)
    ((_, radar),) = stream.of("world/radar/radar_1/lines")
    (ring,) = radar.given[0]
    np.testing.assert_array_equal(ring[0], ring[-1])
    np.testing.assert_allclose(np.hypot(*(ring[:, :2] - (1400.0, 750.0)).T), 800.0)
    reach = stream.of("world/track/icao:D70001/lines")[0][1].given[0][0]
    np.testing.assert_allclose(np.hypot(*(reach[:, :2] - (1500.0, 300.0)).T), 250.0)
    # Variances of 9 and 16 m²: two deviations are 8 m north, which the ellipse has first, and 6 m east.
    where = stream.of("world/track/icao:D70001/spheres")[0][1]
    np.testing.assert_allclose(where.half_sizes, [[10.0] * 3, [8.0, 6.0, 0.5]])
    np.testing.assert_allclose(where.quaternions[1].xyzw, [0.0, 0.0, 0.5**0.5, 0.5**0.5])
    last = stream.of("threat_level")[-1]
    assert last == (12.0, Made(kind="Scalars", given=(0.25,)))
    assert [(made.given[0], made.level) for _, made in stream.of("decisions")] == [
        ("swap: first plan, cost 100.0; item 3 of 5", "INFO"), ("emergency: loiter", "WARN"),
    ]  # fmt: skip
    ((_, wall),) = stream.of("world/obstacle/wall/solid")
    corners, normals = np.asarray(wall.vertex_positions), np.asarray(wall.vertex_normals)
    assert np.ptp(corners[:, 2]) == 300.0
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    sides = corners.reshape(-1, 3, 3)
    along = np.einsum("nij,nj->ni", sides - sides[:, :1], normals[::3])
    assert np.abs(along).max() < 1e-9, "upright on faces"
    # A course of 1.5 rad from north is a heading of 0.0708 rad from east.
    _, first = stream.of("world/aircraft")[0]
    assert first.translation == [100.0, 750.0, 120.0]
    *_, z, w = first.quaternion.xyzw
    assert 2.0 * np.arctan2(z, w) == pytest.approx(np.pi / 2 - 1.5)


def test_every_colour_of_the_scene_has_one_for_dark_ground():
    """Each with a lightness that stands out from it: light colours' luma [0, 255] is above 90."""
    named = [value for value in vars(scenes).values() if isinstance(value, tuple) and len(value) == 4]
    colours = [colour for colour in named if colour is not scenes.BANDS]
    assert len(colours) == 13
    for colour in colours:
        *dark, opacity = rerun_export._rgba(colour)
        assert dark != [round(255.0 * share) for share in colour[:3]]
        assert np.dot(dark, (0.299, 0.587, 0.114)) > 90.0
        assert opacity == round(255.0 * colour[3])


def test_a_kind_that_an_entity_has_no_more_is_cleared():
    made, noted = drawing()
    tree = {"stamp_s": 1.0, "tree_enu_m": [[0, 0, 0], [1, 0, 0]], "tree_parents": [-1, 0]}
    made.draw(channels.TREES, tree | {"sub_goals_enu_m": [[1.0, 2.0, 3.0]]})
    made.draw(channels.TREES, tree | {"stamp_s": 2.0, "tree_parents": []})
    made.draw(channels.TREES, tree | {"stamp_s": 3.0, "tree_parents": []})
    for path in ("world/search/tree/lines", "world/search/sub goals/spheres"):
        assert [stamp_s for stamp_s, _ in noted.of(path)] == [1.0, 2.0]
        assert noted.of(path)[1][1].kind == "Clear"


def test_t_f_is_of_what_is_flown_and_a_gap_where_there_is_none():
    made, noted = drawing()

    def tick(stamp_s):
        made.draw(channels.OWNSHIP, {"stamp_s": stamp_s, "position_enu_m": [0.0, 0.0, 100.0]})

    def plan(number, first_s, **more):
        made.draw(channels.PLAN, {"stamp_s": 0.0, "number": number, "pursuit": {"first_s": first_s}, **more})

    def fly(number, outcome="flown"):
        made.draw(channels.SWAP, {"stamp_s": 0.0, "outcome": outcome, "plan_number": number})

    tick(0.0)
    plan(1, 40.0)
    tick(1.0)
    fly(1)
    tick(2.0)
    plan(2, None)
    fly(2, "failed")
    tick(3.0)
    plan(3, None, flown_pursuit={"first_s": 5.0})
    tick(4.0)
    tick(6.0)
    fly(2)
    tick(7.0)
    tick(8.0)
    said = [
        (stamp_s, made.given[0] if made.given else made.kind) for stamp_s, made in noted.of("until_t_f_s")
    ]
    assert said == [(2.0, 38.0), (3.0, 37.0), (4.0, 1.0), (6.0, 0.0), (7.0, "Clear")]


def parts_of(part):
    """What a part of the blueprint holds, itself last."""
    return [*(inner for child in part.given if isinstance(child, Made) for inner in parts_of(child)), part]


def test_the_blueprint_shows_what_is_logged(flight, stream, tmp_path):
    export_rerun(flight, tmp_path / "out.rrd")
    shown = [view for view in parts_of(stream.blueprint) if hasattr(view, "origin")]
    # No pursuer could threaten this flight: there is no plot of t_f.
    assert [(view.kind, view.origin) for view in shown] == [
        ("Spatial3DView", "world"), ("TimeSeriesView", "altitude_m"), ("TimeSeriesView", "speed_m_s"),
        ("TimeSeriesView", "threat_level"), ("TextLogView", "decisions"), ("MapView", "geo"),
    ]  # fmt: skip
    for view in shown:
        assert any(
            stream.of(path) for path, _, _ in stream.logged if f"{path}/".startswith(f"{view.origin}/")
        )
    (panel,) = (view for view in parts_of(stream.blueprint) if view.kind == "TimePanel")
    assert (panel.timeline, panel.play_state) == (TIMELINE, "following")
    eye = shown[0].eye_controls
    assert eye.look_target[:2] == pytest.approx([1000.0, 650.0])
    assert eye.position[1] < 0.0, "from the south"


def test_what_cannot_be_written_or_read_is_told(flight, stream, tmp_path):
    with pytest.raises(RecordError, match="No such file"):
        export_rerun(flight, tmp_path / "nowhere" / "out.rrd")
    (tmp_path / "link.rrd").symlink_to(tmp_path / "other")
    with pytest.raises(RecordError, match=r"link\.rrd"):
        export_rerun(flight, tmp_path / "link.rrd")
    assert not (tmp_path / "other").exists()
    (tmp_path / "rubbish.mcap").write_bytes(b"rubbish")
    with pytest.raises(RecordError, match="no message in it"):
        export_rerun(tmp_path / "rubbish.mcap", tmp_path / "out.rrd")
    assert stream.is_ended


def test_the_command(companion_command, flight, stream, tmp_path):
    for targets, written in (([], flight.with_suffix(".rrd")), ([tmp_path / "o.rrd"], tmp_path / "o.rrd")):
        done = companion_command("export", flight.parent, *targets, "--rerun")
        assert (done.code, done.out) == (0, f"picture: {written}\n")
        assert written.read_bytes() == b"picture"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "TARGET: got nothing; expected a file to write, or --rerun"),
        (["o.rrd"], f"TARGET: got o.rrd; {ITS_NAME}"),
        (["o.mcap", "--rerun"], f"TARGET: got o.mcap; {ITS_NAME}"),
    ],
)
def test_a_target_that_does_not_fit_is_told(
    companion_command, flight, stream, monkeypatch, arguments, complaint
):
    monkeypatch.chdir(flight.parent)
    done = companion_command("export", flight.parent, *arguments)
    assert (done.code, done.err) == (2, f"error: command line: {complaint}\n")
    assert not any(Path(name).exists() for name in ("o.rrd", "o.mcap"))


def test_without_the_package_it_says_what_to_install(flight, tmp_path):
    result = in_a_process("export", flight, tmp_path / "out.rrd", "--rerun", without="rerun")
    assert result.code == 2
    assert result.err == (
        "error: companion: export: got no rerun installed; expected pip install 'safe-rrt-companion[rerun]'\n"
    )
    assert not (tmp_path / "out.rrd").exists()


def needs_the_package():
    """The package itself, where it is installed: make rerun-test sees to that."""
    return pytest.importorskip("rerun", reason="the extra rerun is not installed; make rerun-test")


def rrd(verb, folder, *options):
    """What the package's own program says of the picture, with a home of its own."""
    home = {name: str(folder) for name in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME")}
    done = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", verb, *options, folder / "out.rrd"],
        capture_output=True, text=True, check=False, env=os.environ | home,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_the_package_reads_what_it_wrote(flight, tmp_path):
    needs_the_package()
    num_messages = sum(1 for _ in messages_of(flight, Counter()))
    assert export_rerun(flight, tmp_path / "out.rrd") == num_messages > 51 * 3
    assert "1 file verified without error" in rrd("verify", tmp_path)
    told = rrd("print", tmp_path).replace("\\", "")
    for path in (
        "/world/obstacle/wall/solid", "/world/radar/radar_1/lines", "/world/field/over 0.25/solid",
        "/world/aircraft/horizon/lines", "/world/mission/lines", "/world/candidate/lines",
        "/world/flown/lines", "/world/search/tree/lines", "/world/track/icao:D70001/spheres", "/decisions",
        "/altitude_m", "/speed_m_s/air", "/threat_level", "/geo/aircraft", "/time_panel",
    ):  # fmt: skip
        assert f" - {path} - " in told, path
    assert TIMELINE in rrd("print", tmp_path, "-vv")


@pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="this system has no /proc/net")
def test_nothing_is_told_to_a_network(flight, tmp_path, monkeypatch):
    needs_the_package()
    seen = []

    def look(self):
        held = {os.readlink(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd") if is_open(name)}
        table = [line.split() for name in ("tcp", "tcp6", "udp", "udp6") for line in rows_of(name)]
        seen.append(held & {f"socket:[{row[9]}]" for row in table})
        end(self)

    end = rerun_export._Drawing.end
    monkeypatch.setattr(rerun_export._Drawing, "end", look)
    export_rerun(flight, tmp_path / "out.rrd")
    assert seen == [set()]


def is_open(name):
    return os.path.lexists(f"/proc/self/fd/{name}")


def rows_of(name):
    file = Path("/proc/self/net") / name
    return file.read_text(encoding="ascii").splitlines()[1:] if file.exists() else []


@pytest.mark.skipif(sys.platform == "win32", reason="this system limits no file's size")
def test_a_disk_that_is_full_is_told(flight, tmp_path):
    needs_the_package()
    limited = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000)); "
        "from companion.cli import main; main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", limited, "export", flight, tmp_path / "out.rrd", "--rerun"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == RecordError.exit_code
    assert done.stderr == f"error: {tmp_path / 'out.rrd'}: File too large\n"
