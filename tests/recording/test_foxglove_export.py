"""A recording as a picture for Foxglove: schemas by name, entities in metres, instants as recorded."""

import json
from collections import Counter

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from mcap.reader import make_reader

from companion.config.load import text_of
from companion.errors import RecordError
from companion.recording import foxglove_export
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.flight_pictures import FENCES, LOG, SCENES, TRANSFORM, Pictures
from companion.recording.foxglove_export import export_flight, layout_of, readable
from companion.recording.mcap_reader import utc_of
from companion.recording.mcap_writer import plain
from companion.types.threat import Obstacle
from tests.support.messages import read_messages
from tests.ui.page.flown import EPOCH_S, recorded
from tests.ui.reports.flights import mission


@pytest.fixture
def picture(tmp_path):
    layout = export_flight(recorded(tmp_path / "flight"), tmp_path / "picture.mcap")
    return tmp_path / "picture.mcap", layout


def messages(file):
    with file.open("rb") as stream:
        return [
            (channel.topic, schema.name, 1e-9 * message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(stream).iter_messages()
        ]


def entities(file):
    """What was drawn last under each name."""
    found = {}
    for topic, _, _, message in messages(file):
        if topic in SCENES:
            for gone in message["deletions"]:
                found.pop(gone["id"], None)
            found |= {entry["id"]: entry for entry in message["entities"]}
    return found


def test_a_schema_in_words_of_viewers_has_one_type_a_key_and_no_arrays_of_arrays():
    keys = {"speed": channels.NUMBER, "row": channels.NUMBERS, "rows": channels.ROWS, "names": channels.TEXTS}
    assert readable({"type": "object", "properties": keys}) == {
        "type": "object",
        "properties": {
            "speed": {"type": "number"},
            "row": {"type": "array", "items": {"type": "number"}},
            "names": {"type": "array", "items": {"type": "string"}},
        },
    }


def test_schemas_are_foxgloves_by_name_and_what_was_recorded_is_there_too(picture):
    file, _ = picture
    names = {topic: name for topic, name, _, _ in messages(file)}
    assert {names[topic] for topic in SCENES if topic in names} == {"foxglove.SceneUpdate"}
    assert names[TRANSFORM] == "foxglove.FrameTransform"
    assert names[LOG] == "foxglove.Log"
    assert names[channels.LOCATION] == "foxglove.LocationFix"
    assert names[channels.OWNSHIP] == "companion.Ownship"
    again = read_messages(file, Counter())
    before = read_messages(file.parent / "flight" / "flight.mcap", Counter())
    for topic in before:
        assert again[topic] == [known(told) for told in before[topic]]


def known(told):
    """A message without what is null; its arrays have nothing of the kind."""
    return {key: value for key, value in told.items() if value is not None}


def test_schemas_have_what_viewers_understand_and_messages_keep_to_them(picture):
    """They refuse a topic in whose schema a key has two types, or arrays of arrays: tried in Lichtblick."""
    single = {"string", "number", "integer", "boolean", "object", "array"}
    types = {
        "string": str,
        "number": int | float,
        "integer": int,
        "boolean": bool,
        "object": dict,
        "array": list,
    }
    with picture[0].open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            described, told = json.loads(schema.data), json.loads(message.data)
            for key, kind in described.get("properties", {}).items():
                assert kind["type"] in single, (channel.topic, key)
                assert kind.get("items", {"type": "object"})["type"] in single - {"array"}, (
                    channel.topic,
                    key,
                )
                if key in told:
                    assert isinstance(told[key], types[kind["type"]]), (channel.topic, key)
                    if kind["type"] == "array":
                        assert all(isinstance(each, types[kind["items"]["type"]]) for each in told[key])


def test_who_begins_in_the_middle_is_shown_all_of_it(picture):
    """A viewer that is sent to an instant shows the last message of each topic, none of those before."""
    last = {topic: message for topic, _, _, message in messages(picture[0]) if topic in SCENES}
    shown = {entry["id"] for message in last.values() for entry in message["entities"]}
    assert shown == set(entities(picture[0]))


def test_what_is_drawn(picture):
    drawn = entities(picture[0])
    assert set(drawn) == {
        "obstacle wall", "obstacle hut", "radar radar_1", "goal 1", "horizon", "candidate", "search tree",
        "search threat tree", "search sub goals", "mission", "flown", "field over 0.25", "field over 0.5",
        "field over 0.75",
    }, "the track is gone with the last message"  # fmt: skip
    way = drawn["mission"]["lines"][0]
    assert [tuple(point.values()) for point in way["points"]] == [
        (100.0, 750.0, 120.0), (900.0, 1000.0, 120.0), (1900.0, 750.0, 120.0),
    ]  # fmt: skip
    assert len(drawn["search tree"]["lines"][0]["points"]) == 2 * 50
    assert drawn["radar radar_1"]["texts"][0]["text"] == "radar_1"
    ring = np.array([[point["x"], point["y"]] for point in drawn["radar radar_1"]["lines"][0]["points"]])
    np.testing.assert_allclose(np.hypot(*(ring - (1400.0, 750.0)).T), 800.0)
    (goal,) = drawn["search sub goals"]["spheres"]
    assert goal["pose"]["position"] == {"x": 700.0, "y": 750.0, "z": 120.0}
    # The horizon goes with the aircraft.
    (senses,) = drawn["horizon"]["lines"]
    np.testing.assert_allclose([np.hypot(point["x"], point["y"]) for point in senses["points"]], 600.0)
    assert {name for name, entry in drawn.items() if entry["frame_id"] != "map"} == {"horizon"}
    assert drawn["horizon"]["frame_id"] == "aircraft"
    assert [name for name, entry in drawn.items() if entry["frame_locked"]] == ["horizon"]


def test_the_field_is_masked_and_at_the_height_flown(picture):
    drawn = entities(picture[0])
    solids = [entry["triangles"][0] for name, entry in drawn.items() if name.startswith("field")]
    corners = np.array(
        [[[point[axis] for axis in "xyz"] for point in solid["points"]] for solid in solids[:1]]
    )
    assert (corners[..., 2] == 120.0).all()
    everywhere = [(point["x"], point["y"]) for solid in solids for point in solid["points"]]
    east, north = np.array(everywhere).T
    cell = 2000.0 / 120
    assert np.hypot(east - 1400.0, north - 750.0).max() < 800.0 + cell
    # The wall between 900 and 1000 m east hides what lies west of it at the radar's own north.
    assert not ((east < 900.0) & (abs(north - 750.0) < 100.0)).any()
    assert ((east < 900.0) & (abs(north - 750.0) > 400.0)).any()


def test_the_field_is_drawn_anew_where_the_height_is_another():
    pictures = Pictures()
    about = {"mission_file": text_of(mission()), "epoch_s": 0.0, "stamp_s": 0.0}
    list(pictures.of(channels.MISSION, about))

    def bands(up):
        told = {"stamp_s": 1.0, "position_enu_m": [100.0, 750.0, up], "course_rad": 0.0}
        shown = [message for name, _, message in pictures.of(channels.OWNSHIP, told) if name in SCENES]
        return [
            ([entry["id"] for entry in message["entities"]], [gone["id"] for gone in message["deletions"]])
            for message in shown
            if not message["entities"] or message["entities"][0]["id"].startswith("field")
        ]

    low = ["field over 0.25", "field over 0.5", "field over 0.75"]
    assert bands(120.0) == [(low, [])]
    assert bands(139.0) == []
    # 700 m above the radar its slant range is at least 700 of 800 m: exp(-(7/8)^4) = 0.556.
    assert bands(700.0) == [(low[:2], low[2:])]
    # Above its range there is no field, and the bands of before are gone.
    assert bands(900.0) == [([], low[:2])]
    without = {**about, "mission_file": text_of(mission(radars=False))}
    assert bands(120.0) == [(low, [])]
    gone = [
        entry["id"]
        for _, _, message in pictures.of(channels.MISSION, without)
        for entry in message["deletions"]
    ]
    assert gone == ["radar radar_1", *low]
    assert bands(300.0) == []


def test_cells_of_a_band_are_rectangles_in_rows():
    east, north = np.array([5.0, 15.0, 25.0, 35.0]), np.array([105.0, 115.0])
    levels = np.array([[0.04, 0.3, 0.3, 0.8], [0.3, 0.0, 0.3, 0.05]])
    drawn = {
        entry["id"]: [tuple(point.values()) for point in entry["triangles"][0]["points"]]
        for entry in scenes.field_entities(east, north, levels, 70.0, 0.0)
    }
    areas = {}
    for name, points in drawn.items():
        sides = np.array(points).reshape(-1, 3, 3)
        areas[name] = 0.5 * np.linalg.norm(
            np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0]), axis=1
        )
    assert {name: found.tolist() for name, found in areas.items()} == {
        "field over 0.05": [50.0, 50.0],
        "field over 0.25": [100.0, 100.0, 50.0, 50.0, 50.0, 50.0],
        "field over 0.75": [50.0, 50.0],
    }
    assert set(drawn["field over 0.25"][:6]) == {
        (10.0, 100.0, 70.0), (30.0, 100.0, 70.0), (30.0, 110.0, 70.0), (10.0, 110.0, 70.0),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("east", "both", "north", "wide", "thin", "angle"),
    [
        (9.0, 0.0, 4.0, 3.0, 2.0, 0.0),
        (4.0, 0.0, 9.0, 3.0, 2.0, np.pi / 2),
        # Deviations of 3 along north-east and 1 across: (9 + 1) / 2 on the diagonal, (9 - 1) / 2 beside it.
        (5.0, 4.0, 5.0, 3.0, 1.0, np.pi / 4),
        (5.0, -4.0, 5.0, 3.0, 1.0, -np.pi / 4),
    ],
)
def test_an_uncertain_place_is_an_ellipse_of_two_deviations(east, both, north, wide, thin, angle):
    rows = [[east, 7.0, both, 7.0], [7.0] * 4, [both, 7.0, north, 7.0], [7.0] * 4]
    drawn = scenes.spread((1.0, 2.0, 3.0), rows, scenes.THREAT)
    assert drawn["size"]["x"] == pytest.approx(4.0 * wide)
    assert drawn["size"]["y"] == pytest.approx(4.0 * thin)
    turn = drawn["pose"]["orientation"]
    assert 2.0 * np.arctan2(turn["z"], turn["w"]) == pytest.approx(angle)
    assert drawn["pose"]["position"] == {"x": 1.0, "y": 2.0, "z": 3.0}


RUBBISH = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.just(10**400)
    | st.floats(allow_nan=False)
    | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)
KEYS = sorted({key for channel in channels.CHANNELS for key in channel.keys if key != "mission_file"})
TRACK = st.fixed_dictionaries(
    {}, optional={key: RUBBISH for key in ("identity", "position_enu_m", "covariance", "max_threat_radius_m")}
)
WALL = st.fixed_dictionaries(
    {}, optional={key: RUBBISH for key in ("name", "polygon_enu_m", "base_m", "top_m")}
)


@given(
    st.sampled_from([channel.topic for channel in channels.CHANNELS if channel.topic != channels.MISSION]),
    st.dictionaries(st.sampled_from(KEYS), RUBBISH, max_size=8)
    | st.fixed_dictionaries({"tracks": st.lists(TRACK), "obstacles": st.lists(WALL)}),
)
@example(channels.SWAP, {"outcome": "flown", "waypoints_enu_m": [[1.0, "east", 2.0], [10**400, 0, 0]]})
@example(channels.PLAN, {"path": [[0.0, 1.0, [], 2.0], None, [0.0]]})
@example(channels.TRACKS, {"tracks": [{"covariance": [["a", 10**400], 3], "position_enu_m": ["b"]}]})
@example(channels.SNAPSHOT, {"obstacles": [{"polygon_enu_m": [[0, 0], [1, 0]]}, {"name": []}, 5]})
@example(channels.SNAPSHOT, {"obstacles": [{"polygon_enu_m": [[0, 0], [1, "up"], [0, 1], [1, 1]]}]})
def test_rubbish_in_a_recording_ends_no_export(topic, told):
    pictures = Pictures()
    about = {"mission_file": text_of(mission(radars=False)), "epoch_s": 0.0, "stamp_s": 0.0}
    list(pictures.of(channels.MISSION, about))
    for _, _, message in pictures.of(topic, told):
        json.dumps(plain(message), allow_nan=False)


def test_an_instant_that_no_field_holds_ends_no_export(tmp_path, monkeypatch):
    flight = recorded(tmp_path / "flight")
    monkeypatch.setattr(foxglove_export, "utc_of", lambda _: 1e15)
    layout = export_flight(flight, tmp_path / "picture.mcap")
    assert layout.exists()
    with (tmp_path / "picture.mcap").open("rb") as stream:
        assert max(entry.log_time for _, _, entry in make_reader(stream).iter_messages()) == 2**64 - 1


@pytest.mark.parametrize(("flies_on", "rings"), [(False, 1), (True, 0)])
def test_only_what_threatens_has_a_reach(flies_on, rings):
    told = {
        "identity": "a", "position_enu_m": [1.0, 2.0, 3.0], "velocity_enu_m_s": [1.0, 0.0, 0.0],
        "max_threat_radius_m": 250.0, "flies_on": flies_on,
    }  # fmt: skip
    assert len(scenes.track_entity(told, 0.0)["lines"]) == 1 + rings


@pytest.mark.parametrize(
    ("told", "utc_s"),
    [
        ({"timestamp": {"sec": 5, "nsec": 250_000_000}}, 5.25),
        ({"timestamp": {"sec": "noon", "nsec": []}}, 0.0),
        ({"timestamp": "noon"}, None),
        ({}, None),
    ],
)
def test_the_time_that_a_document_tells(told, utc_s):
    assert utc_of(told) == utc_s


def test_instants_and_attitude(picture):
    turns = [entry for entry in messages(picture[0]) if entry[0] == TRANSFORM]
    _, _, logged_s, first = turns[0]
    assert logged_s == pytest.approx(EPOCH_S)
    assert first["timestamp"] == {"sec": int(EPOCH_S), "nsec": 0}
    assert first["translation"] == {"x": 100.0, "y": 750.0, "z": 120.0}
    # A course of 1.5 rad from north is a heading of 0.0708 rad from east.
    assert 2.0 * np.arctan2(first["rotation"]["z"], first["rotation"]["w"]) == pytest.approx(np.pi / 2 - 1.5)


def test_decisions_are_a_log(picture):
    said = [entry[3] for entry in messages(picture[0]) if entry[0] == LOG]
    assert [(entry["level"], entry["message"]) for entry in said] == [
        (2, "swap: first plan, cost 100.0; item 3 of 5"), (3, "emergency: loiter"),
    ]  # fmt: skip


def test_the_layout_shows_topics_that_are_there(picture):
    file, layout = picture
    document = json.loads(layout.read_text())
    topics = {entry[0] for entry in messages(file)} | {FENCES}  # which this flight has none of
    config = document["configById"]
    named = {*config["3D!flight"]["topics"], *config["map!flight"]["topics"]}
    assert named | {config["RosOut!flight"]["topicToRender"]} <= topics

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(document["layout"])) == sorted(config)
    # It looks at the bounds' middle: 2,000 by 1,500 m.
    eye = config["3D!flight"]["cameraState"]
    assert (eye["targetOffset"], eye["distance"]) == ([1000.0, 750.0, 0.0], 3000.0)
    assert layout_of(None)["layout"] == document["layout"]


def test_a_prism_has_walls_and_a_roof_and_no_more():
    # An L of area 3: roof triangles cover it, and not the notch.
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])
    solid = scenes.prism(Obstacle("l", corners, -5.0, 900.0), 30.0, scenes.OBSTACLE)
    points = np.array([[point["x"], point["y"], point["z"]] for point in solid["points"]]).reshape(-1, 3, 3)
    walls, roof = points[:12], points[12:]
    assert (walls[..., 2].min(), walls[..., 2].max()) == (0.0, 30.0)
    assert (roof[..., 2] == 30.0).all()
    sides = roof[:, 1:, :2] - roof[:, :1, :2]
    assert np.abs(np.linalg.det(sides)).sum() / 2.0 == pytest.approx(3.0)


def test_without_a_message_there_is_no_picture(tmp_path):
    (tmp_path / "flight.mcap").write_bytes(b"rubbish")
    with pytest.raises(RecordError, match="no message in it"):
        export_flight(tmp_path / "flight.mcap", tmp_path / "picture.mcap")
    with pytest.raises(RecordError, match="No such file"):
        export_flight(tmp_path / "flight.mcap", tmp_path / "nowhere" / "picture.mcap")


def test_the_command(companion_command, picture, tmp_path):
    done = companion_command("export", tmp_path / "flight", tmp_path / "again.mcap")
    assert done.code == 0
    assert f"picture: {tmp_path / 'again.mcap'}" in done.out
    assert entities(tmp_path / "again.mcap") == entities(picture[0])
