"""Entities of a picture, by hand."""

import pytest

from companion.recording.scene_update import prism
from tests.support.paths import box

GREY = (0.5, 0.5, 0.5, 1.0)


@pytest.mark.parametrize(
    ("base_m", "top_m", "drawn"),
    [(0.0, 80.0, {0.0, 80.0}), (-30.0, 80.0, {0.0, 80.0}), (20.0, 300.0, {20.0, 200.0})],
    ids=["it stands on the ground", "it begins below the ground", "it is higher than the world"],
)
def test_an_obstacle_is_drawn_from_its_base_or_the_ground_up_to_its_top_or_the_ceiling(base_m, top_m, drawn):
    entity = prism(box("house", 0.0, 0.0, 10.0, 10.0, base_m, top_m), 200.0, GREY)
    assert {point["z"] for point in entity["points"]} == drawn
    assert {point["x"] for point in entity["points"]} == {0.0, 10.0}
    assert entity["pose"]["position"] == {"x": 0.0, "y": 0.0, "z": 0.0}
