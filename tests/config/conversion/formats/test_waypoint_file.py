"""``QGC WPL 110``: missions, fences and rally points of Mission Planner."""

import pytest

from companion.config.conversion.found_places import Kind
from companion.errors import ConfigError
from tests.config.conversion.files import take

HOME = "0\t1\t0\t16\t0\t0\t0\t0\t-35.363261\t149.165230\t584\t1"
GOAL = "1\t0\t3\t16\t0\t0\t0\t0\t-35.350000\t149.180000\t80\t1"


def lines(*items):
    return "\r\n".join(["QGC WPL 110", *items]) + "\r\n"


def test_home_take_off_and_goals(tmp_path):
    takeoff = "1\t0\t3\t22\t15\t0\t0\t0\t0\t0\t50\t1"
    jump = "3\t0\t3\t177\t1\t2\t0\t0\t0\t0\t0\t1"
    importer = take(tmp_path, "a.waypoints", lines(HOME, takeoff, GOAL.replace("1", "2", 1), jump))
    assert [place.kind for place in importer.places] == [Kind.ORIGIN, Kind.TAKEOFF, Kind.GOAL]
    assert importer.places[0].values == {"altitude_amsl_m": 584.0}
    assert importer.places[1].values == {"up_m": 50.0}
    assert importer.places[2].corners == ((-35.35, 149.18),)
    assert importer.remarks == (
        "a.waypoints: DO_JUMP (177) item 3: not taken: goals are reached once, in order",
    )


def test_a_fence_and_a_rally_point(tmp_path):
    corners = [(-35.4, 149.1), (-35.4, 149.2), (-35.3, 149.2)]
    fence = [f"{n}\t0\t3\t5001\t3\t0\t0\t0\t{lat}\t{lon}\t0\t1" for n, (lat, lon) in enumerate(corners, 1)]
    circle = "4\t0\t3\t5004\t80\t0\t0\t0\t-35.35\t149.15\t0\t1"
    rally = "5\t0\t3\t5100\t0\t0\t0\t0\t-35.35\t149.15\t60\t1"
    importer = take(tmp_path, "a.waypoints", lines(HOME, *fence, circle, rally))
    assert [place.kind for place in importer.places] == [Kind.ORIGIN, Kind.FENCE, Kind.NO_FLY, Kind.FIELD]
    assert importer.places[1].corners == tuple(corners)


BROKEN = {
    "empty": (b"  \n", "file", "nothing"),
    "version": (lines(HOME).replace("110", "120"), "header", "QGC WPL 120"),
    "no header": (HOME, "header", None),
    "columns": (lines(HOME, "1\t0\t3"), "line 3", "3 columns"),
    "no number": (lines(HOME, GOAL.replace("149.18", "east")), "line 3 column 10", "east0000"),
    "NaN": (lines(HOME, GOAL.replace("-35.35", "nan")), "line 3 column 9", None),
    "latitude": (lines(HOME, GOAL.replace("-35.35", "95.00")), "item 1 latitude", "95.0"),
    "frame": (lines(HOME, GOAL.replace("\t3\t16", "\t3.5\t16")), "line 3 frame", "3.5"),
    "a fence cut off": (
        lines(HOME, "1\t0\t3\t5001\t3\t0\t0\t0\t-35\t149\t0\t1", GOAL), "item 1", "1 of 3 vertices",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_gives_one_error(case, tmp_path):
    content, key, value = BROKEN[case]
    with pytest.raises(ConfigError) as caught:
        take(tmp_path, "a.waypoints", content)
    assert caught.value.key == key
    assert value is None or caught.value.value == value
