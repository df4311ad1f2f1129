"""A recording as a picture for Foxglove: schemas by name, entities in metres, instants as recorded."""

import json
from collections import Counter

import numpy as np
import pytest
from mcap.reader import make_reader

from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording import scene_update as scenes
from companion.recording.foxglove_export import LAYOUT, LOG, SCENE, TRANSFORM, export_flight
from companion.types.threat import Obstacle
from tests.page.flown import EPOCH_S, Told, ownship
from tests.support.messages import read_messages


@pytest.fixture
def picture(tmp_path):
    told = Told(lambda *_: None, tmp_path / "flight")
    told.fly(10)
    told.recorder.decide(10.0, "emergency", "loiter")
    told.recorder.state(12.0, ownship(12.0, 595.0), (), 0.0)
    told.recorder.close()
    layout = export_flight(tmp_path / "flight" / "flight.mcap", tmp_path / "picture.mcap")
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
        if topic == SCENE:
            for gone in message["deletions"]:
                found.pop(gone["id"], None)
            found |= {entry["id"]: entry for entry in message["entities"]}
    return found


def test_schemas_are_foxgloves_by_name_and_what_was_recorded_is_there_too(picture):
    file, _ = picture
    names = {topic: name for topic, name, _, _ in messages(file)}
    assert names[SCENE] == "foxglove.SceneUpdate"
    assert names[TRANSFORM] == "foxglove.FrameTransform"
    assert names[LOG] == "foxglove.Log"
    assert names[channels.LOCATION] == "foxglove.LocationFix"
    assert names[channels.OWNSHIP] == "companion.Ownship"
    again = read_messages(file, Counter())
    before = read_messages(file.parent / "flight" / "flight.mcap", Counter())
    for topic in before:
        assert again[topic] == before[topic]


def test_what_is_drawn(picture):
    drawn = entities(picture[0])
    assert set(drawn) == {
        "obstacle wall", "obstacle hut", "radar radar_1", "goal 1", "candidate", "search tree", "mission",
        "flown",
    }, "the track is gone with the last message"  # fmt: skip
    way = drawn["mission"]["lines"][0]
    assert [tuple(point.values()) for point in way["points"]] == [
        (100.0, 750.0, 120.0), (900.0, 1000.0, 120.0), (1900.0, 750.0, 120.0),
    ]  # fmt: skip
    assert len(drawn["search tree"]["lines"][0]["points"]) == 2 * 50
    assert drawn["radar radar_1"]["texts"][0]["text"] == "radar_1"
    ring = np.array([[point["x"], point["y"]] for point in drawn["radar radar_1"]["lines"][0]["points"]])
    np.testing.assert_allclose(np.hypot(*(ring - (1400.0, 750.0)).T), 800.0)
    assert all(entry["frame_id"] == "map" for entry in drawn.values())


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
    assert document == LAYOUT
    topics = {entry[0] for entry in messages(file)}
    config = document["configById"]
    named = {*config["3D!flight"]["topics"], *config["map!flight"]["topics"]}
    assert named | {config["RosOut!flight"]["topicToRender"]} <= topics

    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(document["layout"])) == sorted(config)


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
