"""A mission file that is edited: how its places are written, undone steps, and saving."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.config.source import parse
from companion.errors import ConfigError
from companion.ui.editor.edit_scene import scene_of
from companion.ui.editor.edited_mission import Change, EditedMission, change_of, changed_text, changes_of

TEXT = Path("mission_configs/first-flight.yaml").read_text(encoding="utf-8")
DEGREES = """\
name: degrees
dimension: 2
unit_m: 25
origin: {latitude_deg: -35.363261, longitude_deg: 149.165230, altitude_amsl_m: 584.0}
bounds: {latitude_deg: [-35.3633, -35.3482], longitude_deg: [149.165, 149.195], up_m: [60, 160]}
start: {latitude_deg: -35.3565, longitude_deg: 149.1669, up_m: 100, course_deg: 90}
goals:
  - {utm: {zone: 55H, easting_m: 698485, northing_m: 6085231}, up_m: 100}  # in UTM
vehicle: {airspeed_min_m_s: 12.5, airspeed_max_m_s: 37.5, airspeed_cruise_m_s: 25, acceleration_max_m_s2: 0.5,
  turn_radius_min_m: 125, straight_length_min_m: 125, penetration_speed_m_s: 30}
planning: {sensing_horizon_m: 825, time_horizon_s: 15, total_planning_time_s: 80}
dynamic_threats:
  - {name: lorry, latitude_deg: -35.352, longitude_deg: 149.17, speed_m_s: 5, max_threat_radius_m: 100}
obstacles:
  - {name: hall, base_m: 0, top_m: 50,
      polygon_lat_lon_deg: [[-35.354, 149.176], [-35.354, 149.178], [-35.353, 149.178]]}
"""


def places_of(text):
    scene = scene_of(text, "mission")
    assert scene.mission is not None, scene.document["faults"]
    return {one["name"]: one for one in scene.document["elements"]}


@pytest.mark.parametrize("text", [TEXT, DEGREES], ids=["metres", "degrees and UTM"])
def test_a_moved_place_keeps_the_way_it_is_written(text):
    before = places_of(text)
    for one in before.values():
        after = places_of(changed_text(text, [Change("move", tuple(one["path"]), [10.0, -20.0])]))[
            one["name"]
        ]
        assert after["written"] == one["written"]
        assert after["values"].keys() == one["values"].keys()
        for key in ("place_m", "polygon_enu_m"):
            for old, new in zip(*(points_of(entry.get(key)) for entry in (one, after)), strict=True):
                assert new[:2] == pytest.approx([old[0] + 10.0, old[1] - 20.0], abs=0.06)


def points_of(entry):
    return [] if entry is None else [entry] if isinstance(entry[0], float | int) else list(entry)


@pytest.mark.parametrize("name", ["convoy", "search-area", "valley"])
def test_everything_on_the_map_of_a_shipped_mission_can_be_changed(name):
    text = Path(f"mission_configs/{name}.yaml").read_text(encoding="utf-8")
    for one in scene_of(text, name).document["elements"]:
        path = tuple(one["path"])
        changes = [Change("move", path, [10.0, -5.0]), Change("set", (*path, "new_key"), 5)]
        changes += [Change("remove", (*path, key)) for key in one["values"]]
        if len(path) > 1:
            added = {"name": "new", "east_m": 1.0, "north_m": 2.0}
            changes += [Change("remove", path), Change("add", path, added)]
        for line in one.keys() & {"polygon_enu_m", "route_enu_m"}:
            corner, last = (*path, line, 1), (*path, line, len(one[line]) - 1)
            changes += [Change("move", corner, [3.0, 3.0]), Change("add", corner, [3.0, 4.0])]
            changes += [Change("remove", corner), Change("remove", last)]
        for change in changes:
            after = changed_text(text, [change])
            assert [line for line in after.splitlines() if line.startswith("#")] == [
                line for line in text.splitlines() if line.startswith("#")
            ], change


def test_corners_are_moved_drawn_and_removed_in_degrees():
    path = ("obstacles", 0, "polygon_enu_m")
    moved = changed_text(DEGREES, [Change("move", (*path, 1), [30.0, 0.0])])
    assert "[-35.354, 149.176], [-35.354" in moved
    corner = places_of(moved)["hall"]["polygon_enu_m"][1]
    assert corner[0] == pytest.approx(places_of(DEGREES)["hall"]["polygon_enu_m"][1][0] + 30.0, abs=0.02)
    more = changed_text(DEGREES, [Change("add", (*path, 1), [1080.0, 900.0])])
    assert places_of(more)["hall"]["polygon_enu_m"][1] == pytest.approx((1080.0, 900.0), abs=0.02)
    assert changed_text(more, [Change("remove", (*path, 1))]) == DEGREES


def test_new_places_are_written_as_the_start_is():
    radar = {"name": "r", "east_m": 500.0, "north_m": 600.0, "max_threat_radius_m": 100}
    text = changed_text(DEGREES, [Change("add", ("radars", 0), radar)])
    assert places_of(text)["r"]["written"] == "degrees"
    assert places_of(text)["r"]["place_m"][:2] == pytest.approx([500.0, 600.0], abs=0.02)
    route = [
        Change("add", ("dynamic_threats", 0, "route_enu_m", 0), [300.0, 900.0]),
        Change("set", ("dynamic_threats", 0, "behaviour"), "drive"),
    ]
    text = changed_text(DEGREES, route)
    assert "route_lat_lon_deg: [[" in text
    assert places_of(text)["lorry"]["route_enu_m"][0] == pytest.approx((300.0, 900.0), abs=0.02)
    assert "route_enu_m: [[300, 900]]" in changed_text(TEXT, route)


@pytest.mark.parametrize("text", [TEXT, DEGREES], ids=["metres", "degrees"])
def test_bounds_are_dragged(text):
    new = changed_text(text, [Change("bound", ("bounds",), [-40.0, 2600.0, -10.5, 1640.0])])
    assert scene_of(new, "x").document["bounds_m"][:4] == pytest.approx(
        [-40.0, 2600.0, -10.5, 1640.0], abs=0.02
    )
    keys = [parse(each, "x").data["bounds"].keys() for each in (text, new)]
    assert keys[0] == keys[1]


def test_a_fence_becomes_walls_as_of_an_import():
    corners = [[-500.0, -500.0], [1900.0, -500.0], [1900.0, 1400.0], [-500.0, 1400.0]]
    text = changed_text(TEXT, [Change("fence", ("obstacles",), corners)])
    walls = mission_from_text(text, "x").obstacles[1:]
    assert [wall.name for wall in walls] == [f"fence wall {number}" for number in range(1, len(walls) + 1)]
    assert all(wall.base_m <= 60 and wall.top_m >= 160 for wall in walls)
    with pytest.raises(ConfigError, match="corners that enclose an area"):
        changed_text(TEXT, [Change("fence", ("obstacles",), corners[:2])])


def test_all_faults_are_told_with_their_keys():
    text = changed_text(
        TEXT,
        [
            Change("set", ("start", "east_m"), -500),
            Change("set", ("obstacles", 0, "top_m"), -1),
            Change("set", ("planning", "sensing_horizon_m"), 10),
        ],
    )
    faults = scene_of(text, "x").document["faults"]
    assert [fault["key"] for fault in faults] == [
        "start.east_m",
        "planning.sensing_horizon_m",
        "obstacles.0.base_m",
    ]
    assert faults[0]["path"] == ["start", "east_m"]
    assert faults[0]["expected"] == "within bounds.east_m, 0 to 2000"
    wrong = changed_text(TEXT, [Change("set", ("goals", 0, "up_m"), "high"), Change("set", ("unknown",), 1)])
    scene = scene_of(wrong, "x")
    assert scene.mission is None
    assert {fault["key"] for fault in scene.document["faults"]} == {"goals.0.up_m", "unknown"}
    assert scene.document["elements"][1]["place_m"] == [1750, 750, 0.0], "it is still drawn"


def test_what_cannot_be_read_is_not_drawn_and_said():
    text = changed_text(DEGREES, [Change("set", ("start", "latitude_deg"), 95)])
    scene = scene_of(text, "x")
    assert [fault["key"] for fault in scene.document["faults"]] == ["start.latitude_deg"]
    assert "place_m" not in scene.document["elements"][0]
    assert "place_m" in scene.document["elements"][1]
    without_origin = changed_text(TEXT, [Change("remove", ("origin",))])
    assert scene_of(without_origin, "x").document["elements"][0]["place_m"] == [150, 750, 100]


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (5, "request: changes: got 5; expected a list of mappings"),
        ({"do": "burn", "path": ["a"]}, "request: do: got 'burn'; expected one of set, move"),
        ({"do": "set", "path": []}, "request: path: got []; expected a list of 1 to 6"),
        ({"do": "set", "path": ["a", 1.5]}, "request: path: got ['a', 1.5]"),
        (
            {"do": "move", "path": ["start"], "value": [1]},
            "request: value: got [1]; expected a list of 2 numbers",
        ),
        ({"do": "move", "path": ["start"], "value": [1, float("nan")]}, "request: value"),
        (
            {"do": "exchange", "path": ["goals", 0], "value": 1.5},
            "request: value: got 1.5; expected a whole number",
        ),
        ({"do": "fence", "path": ["obstacles"], "value": [[1]]}, "pairs of numbers"),
    ],
)
def test_a_wrong_request_is_refused_by_key_value_and_what_was_expected(asked, message):
    with pytest.raises(ConfigError) as caught:
        change_of(asked)
    assert message in str(caught.value)
    with pytest.raises(ConfigError, match="request: changes: got 'text'"):
        changes_of("text")


# --- undoing, saving


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "mission.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def a_change(draw):
    """A change of any kind, possible or not."""
    lists = ("goals", "radars", "dynamic_threats", "obstacles", "nothing")
    entry = (draw(st.sampled_from(lists)), draw(st.integers(0, 3)))
    number = st.floats(-5000, 5000).map(lambda value: round(value, 2))
    match draw(st.sampled_from(("move", "corner", "set", "add", "insert", "remove", "bound"))):
        case "move":
            return Change("move", draw(st.sampled_from((entry, ("start",)))), [draw(number), draw(number)])
        case "corner":
            path = (*entry, "polygon_enu_m", draw(st.integers(0, 4)))
            return Change("move", path, [draw(number), draw(number)])
        case "set":
            key = draw(st.sampled_from(("up_m", "top_m", "name", "acceptance_radius_m", "odd key")))
            value = draw(st.one_of(number, st.text(max_size=12), st.booleans(), st.none()))
            return Change("set", (*entry, key), value)
        case "add":
            place = {
                "name": draw(st.text("abc #:", max_size=5)),
                "east_m": draw(number),
                "north_m": draw(number),
            }
            return Change("add", entry, place)
        case "insert":
            path = (*entry, "polygon_enu_m", draw(st.integers(0, 4)))
            return Change("add", path, [draw(number), draw(number)])
        case "remove":
            return Change("remove", draw(st.sampled_from((entry, (*entry, "name"), ("simulation",)))))
        case _:
            return Change("bound", ("bounds",), [draw(number) for _ in range(4)])


@given(st.data(), st.sampled_from([TEXT, DEGREES]))
def test_any_changes_and_as_many_undos_give_the_same_text(tmp_path_factory, data, text):
    path = tmp_path_factory.mktemp("edited") / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    edited = EditedMission(path)
    texts = [edited.text]
    for _ in range(data.draw(st.integers(1, 6))):
        try:
            edited.change([data.draw(st.composite(a_change)())])
        except ConfigError:
            assert edited.text == texts[-1], "all or nothing"
        if edited.text != texts[-1]:
            texts.append(edited.text)
            comments = [[line for line in each.splitlines() if line.startswith("#")] for each in texts[-2:]]
            assert comments[0] == comments[1]
    last = edited.text
    for expected in reversed(texts[:-1]):
        edited.undo()
        assert edited.text == expected
    assert not edited.can_undo
    while edited.can_redo:
        edited.redo()
    assert edited.text == last
    assert path.read_text(encoding="utf-8") == text, "nothing is written before it is saved"


def test_a_saved_file_differs_by_what_was_changed(file):
    edited = EditedMission(file)
    edited.change([Change("move", ("start",), [10.0, 0.0])])
    assert edited.is_changed
    edited.save()
    assert not edited.is_changed
    assert file.read_text(encoding="utf-8") == TEXT.replace("start: {east_m: 150", "start: {east_m: 160")
    edited.undo()
    assert edited.is_changed
    edited.save()
    assert file.read_text(encoding="utf-8") == TEXT


def test_a_file_that_others_changed_is_not_overwritten(file):
    edited = EditedMission(file)
    edited.change([Change("move", ("start",), [10.0, 0.0])])
    file.write_text(TEXT + "# by another\n", encoding="utf-8")
    with pytest.raises(
        ConfigError, match="a file that was changed meanwhile; expected the file as it was read"
    ):
        edited.save()
    assert file.read_text(encoding="utf-8").endswith("# by another\n")
    edited.reload()
    assert edited.text.endswith("# by another\n")
    assert not edited.is_changed
    edited.undo()
    assert "east_m: 160" in edited.text, "what was lost by loading comes back"
    edited.redo()
    file.unlink()
    with pytest.raises(ConfigError, match="changed meanwhile"):
        edited.save()


def test_mode_link_and_mark_of_a_file_stay(file, tmp_path):
    file.write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    file.chmod(0o604)
    link = tmp_path / "link.yaml"
    link.symlink_to(file)
    edited = EditedMission(link)
    edited.change([Change("set", ("name",), "other")])
    edited.save()
    assert link.is_symlink()
    assert file.read_bytes().startswith(b"\xef\xbb\xbf#")
    assert os.stat(file).st_mode & 0o777 == 0o604


def test_a_file_that_cannot_be_written_is_said(file, monkeypatch):
    edited = EditedMission(file)
    edited.change([Change("set", ("name",), "other")])

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("companion.ui.editor.edited_mission.replace_file", full)
    with pytest.raises(ConfigError, match="No space left on device"):
        edited.save()
    assert edited.is_changed
    assert file.read_text(encoding="utf-8") == TEXT


def test_a_file_that_is_no_mission_is_refused_at_once(tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text("a: [1, 2", encoding="utf-8")
    with pytest.raises(ConfigError, match="valid YAML"):
        EditedMission(broken)
    with pytest.raises(ConfigError, match="no such file"):
        EditedMission(tmp_path / "none.yaml")
