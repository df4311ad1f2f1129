"""QGroundControl's plans: home, goals, zones and rally points; what is not taken is named."""

import json

import pytest

from companion.config.conversion.found_places import Kind
from companion.errors import ConfigError
from tests.config.conversion.files import EXAMPLES, HOME, PLAN, plan, take, waypoint


def kinds(importer):
    return [place.kind for place in importer.places]


def test_home_and_waypoints(tmp_path):
    items = [
        waypoint(15, 0, 0, None, *HOME, 50, command=22),
        waypoint(0, 30, 0, None, -35.35, 149.18, 80),
        waypoint(0, 0, 0, None, -35.34, 149.19, 700, frame=0),
    ]
    home, takeoff, first, second = take(tmp_path, "a.plan", plan(items=items)).places
    assert (home.kind, home.corners, home.values) == (Kind.ORIGIN, (HOME,), {"altitude_amsl_m": 584.0})
    assert (takeoff.kind, takeoff.values) == (Kind.TAKEOFF, {"up_m": 50.0})
    assert (first.kind, first.corners) == (Kind.GOAL, ((-35.35, 149.18),))
    assert first.values == {"up_m": 80.0, "acceptance_radius_m": 30.0}
    assert second.values == {"altitude_amsl_m": 700.0}
    assert first.where == "a.plan: item 2"


def test_zones_and_rally_points(tmp_path):
    square = [[-35.4, 149.1], [-35.4, 149.2], [-35.3, 149.2], [-35.3, 149.1]]
    zones = {
        "version": 2,
        "polygons": [
            {"inclusion": True, "polygon": square, "version": 1},
            {"inclusion": False, "polygon": square, "version": 1},
        ],
        "circles": [{"inclusion": False, "circle": {"center": list(HOME), "radius": 100}, "version": 1}],
        "breachReturn": [*HOME, 50],
    }
    rally = {"version": 2, "points": [[*HOME, 50]]}
    importer = take(tmp_path, "a.plan", plan(items=[]) | {"geoFence": zones, "rallyPoints": rally})
    assert kinds(importer) == [Kind.ORIGIN, Kind.FENCE, Kind.NO_FLY, Kind.NO_FLY, Kind.FIELD]
    assert importer.places[1].corners == tuple(map(tuple, square))
    assert len(importer.places[3].corners) == 24
    assert any("breachReturn: not taken" in remark for remark in importer.remarks)


def test_what_is_no_goal_is_named_with_its_number_and_the_reason(tmp_path):
    items = [
        waypoint(0, 0, 0, None, 0, 0, 0, command=178, frame=2),
        waypoint(1, 3, 0, None, 0, 0, 0, command=177, frame=2),
        waypoint(0, 0, 0, None, *HOME, 0, command=21),
        waypoint(1, 3, 0, None, 0, 0, 0, command=177, frame=2),
        waypoint(0, 0, 0, None, 0, 0, 0, command=2500, frame=2),
        waypoint(0, 0, 0, None, -35.35, 149.18, 80, frame=10),
        waypoint(0, 0, 0, None, 0, 0, 80),
        {"type": "ComplexItem", "complexItemType": "fwLandingPattern", "version": 1},
        {"type": "ComplexItem", "complexItemType": "StructureScan", "version": 2},
    ]
    importer = take(tmp_path, "a.plan", plan(items=items, cruiseSpeed=17))
    assert kinds(importer) == [Kind.ORIGIN]
    said = "\n".join(importer.remarks)
    for words in (
        "DO_CHANGE_SPEED (178) item 1: not taken: airspeeds are",
        "DO_JUMP (177) item 2, item 4: not taken: goals are reached once, in order",
        "NAV_LAND (21) item 3: not taken",
        "command 2500 item 5: not taken: a mission file has no such command",
        "NAV_WAYPOINT (16) item 6: not taken: its height is in frame 10",
        "NAV_WAYPOINT (16) item 7: not taken: it has no place",
        "fwLandingPattern item 8: not taken",
        "StructureScan item 9: not taken: it has no transects",
        "mission.cruiseSpeed 17: not taken",
    ):
        assert words in said, words


def test_loiters_and_holds_are_taken_as_goals_with_a_remark(tmp_path):
    items = [
        waypoint(3, 0, 80, None, -35.35, 149.18, 80, command=18),
        waypoint(12, 0, 0, None, -35.35, 149.19, 80),
    ]
    importer = take(tmp_path, "a.plan", plan(items=items))
    assert kinds(importer) == [Kind.ORIGIN, Kind.GOAL, Kind.GOAL]
    assert (
        "item 1 NAV_LOITER_TURNS (18): taken as a point to reach; the circling is not taken"
        in importer.remarks[0]
    )
    assert "the hold of 12 s is not taken" in importer.remarks[1]


def test_a_survey_becomes_the_waypoints_of_its_transects(tmp_path):
    inner = [waypoint(0, 0, 0, None, -35.35, 149.17 + 0.01 * n, 80) for n in range(4)]
    inner.append(waypoint(25, 0, 1, 0, 0, 0, 0, command=206, frame=2))
    survey = {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "version": 5,
        "TransectStyleComplexItem": {"version": 2, "Items": inner, "VisualTransectPoints": []},
    }
    importer = take(tmp_path, "a.plan", plan(items=[survey]))
    assert [place.corners[0][1] for place in importer.places[1:]] == pytest.approx(
        [149.17, 149.18, 149.19, 149.2]
    )
    assert any("item 1 survey: taken as the 5 items" in remark for remark in importer.remarks)
    assert any("command 206 item 1.5: not taken" in remark for remark in importer.remarks)


BROKEN = {
    "empty": ("", "file", "nothing", "a file with content"),
    "truncated": (json.dumps(PLAN)[:200], "syntax", None, "whole and valid JSON"),
    "a list": ("[]", "file", "list", "a JSON object, in braces"),
    "not a plan": ({"fileType": "Mission"}, "fileType", "Mission", "Plan, as QGroundControl writes it"),
    "a later version": (PLAN | {"version": 2}, "version", "2", None),
    "a later mission": (plan(version=3), "mission.version", "3", None),
    "no mission": ({"fileType": "Plan", "version": 1}, "mission", "nothing", "an object, in braces"),
    "NaN": (json.dumps(plan(plannedHomePosition=[float("nan"), 1, 2])), "file", "NaN", None),
    "infinity": (json.dumps(plan(plannedHomePosition=[1e999, 1, 2])), "file", "Infinity", None),
    "latitude": (
        plan(items=[waypoint(0, 0, 0, None, 95, 149, 80)]),
        "item 1 latitude",
        "95",
        "a number from -90 to 90",
    ),
    "no longitude": (
        plan(items=[waypoint(0, 0, 0, None, -35, "x", 80)]),
        "item 1 longitude",
        "x",
        "a number from -180 to 180",
    ),
    "no altitude": (
        plan(items=[waypoint(0, 0, 0, None, -35, 149, None)]),
        "item 1 altitude",
        "nothing",
        None,
    ),
    "params": (
        plan(items=[waypoint(0, 0)]),
        "mission.items.0.params",
        "[0, 0]",
        "a list of at least 7 values",
    ),
    "an item": (plan(items=[3]), "mission.items.0", "3", "an item, in braces"),
    "its type": (plan(items=[{"type": "Odd"}]), "mission.items.0.type", "Odd", "SimpleItem or ComplexItem"),
    "deep": ('{"a":' * 100_000, "syntax", "deep nesting", None),
    "not UTF-8": (b"\xff\xfe{}", "file", "bytes that are not UTF-8", None),
    "a long number": ('{"a": ' + "9" * 5_000 + "}", "syntax", None, "valid JSON"),
    "a fence of two": (
        PLAN | {"geoFence": {"version": 2, "polygons": [{"inclusion": True, "polygon": [[1, 1], [1, 2]]}]}},
        "geoFence.polygons.0.polygon",
        None,
        "a list of at least 3 values",
    ),
    "a circle": (
        PLAN | {"geoFence": {"version": 2, "circles": [{"inclusion": True, "circle": {"center": [1, 1]}}]}},
        "geoFence.circles.0.circle.radius",
        "nothing",
        None,
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_plan_gives_one_error(case, tmp_path):
    content, key, value, expected = BROKEN[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.plan", content)
    error = caught.value
    assert error.file.endswith("a.plan")
    assert error.key == key
    if value is not None:
        assert error.value == value
    if expected is not None:
        assert error.expected == expected


def test_the_example_has_a_fence_a_zone_two_goals_and_a_rally_point(tmp_path):
    importer = take(tmp_path, "field.plan", (EXAMPLES / "field.plan").read_text(encoding="utf-8"))
    wanted = [Kind.ORIGIN, Kind.TAKEOFF, Kind.GOAL, Kind.GOAL, Kind.FENCE, Kind.NO_FLY, Kind.FIELD]
    assert kinds(importer) == wanted
