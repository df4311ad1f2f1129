"""The service asked to leave, and the mission file read again, in flight."""

import asyncio

import pytest

from companion.config import mission_from_text
from companion.config.reload import changed_mission
from companion.errors import ConfigError
from companion.mission.item_difference import difference
from companion.types.events import Dialect
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness


def mission(*changes):
    text = FIRST_FLIGHT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return mission_from_text(text, "first-flight.yaml")


def flown_part(harness):
    """What of the autopilot's list the service believes to be flown, as it is there and as it was sent."""
    layout, flown = harness.app.state.mission_list.layout, harness.app.state.flown
    span = slice(layout.flown_span[0] - 1, layout.flown_span[1])
    return harness.simulator.autopilot.mission_items[span], flown.mission.items[span]


def is_wholly_new(harness, before):
    """Whether a PX4, which switches over with the last item, holds all that was sent since."""
    sent = {message.seq: (message.x, message.y) for _, message in harness.said("MISSION_ITEM_INT")[before:]}
    items = harness.simulator.autopilot.mission_items
    there = {item.sequence: (item.latitude_e7, item.longitude_e7) for item in items}
    return harness.flight.dialect is Dialect.PX4 and sent == there


@pytest.mark.parametrize("dialect", list(Dialect))
@pytest.mark.parametrize("messages", [1, 11])
def test_an_exchange_is_broken_off_and_what_is_flown_stays_whole(dialect, messages):
    begun, before, leaving = [], [], []

    def on_step(harness):
        items = [stamp for stamp, message in harness.said("MISSION_ITEM_INT")]
        if harness.recorder.missions and not before:
            before.append(len(items))
        if before and len(items) >= before[0] + messages and not begun:
            begun.append(harness.now_s)
            leaving.append(asyncio.ensure_future(harness.app.withdraw()))

    change = ("time_horizon_s: 15", "time_horizon_s: 8")  # an exchange every 8 s
    harness = SitlHarness(mission(change), dialect=dialect).fly(30.0, on_step)
    assert begun
    assert leaving[0].done()
    assert harness.changes(after_s=begun[0] + 0.1) == []
    there, sent = flown_part(harness)
    assert difference(sent, there) == "" or is_wholly_new(harness, before[0])
    assert "Planner stopped, autopilot flies its mission" in [
        message.text for _, message in harness.said("STATUSTEXT")
    ]
    assert harness.simulator.autopilot.mode in ("AUTO", "MISSION")


def test_a_changed_file_is_taken_up_between_plans_and_flown_by():
    wall = "[[1500, 500], [1540, 500], [1540, 1000], [1500, 1000]]"
    entry = f"  - {{name: new_wall, polygon_enu_m: {wall}, base_m: 0, top_m: 300}}"
    new_wall = ("obstacles:\n", f"obstacles:\n{entry}\n")
    changed, done = mission(new_wall), []

    def on_step(harness):
        if harness.now_s > 12.0 and not done:
            done.append(len(harness.recorder.missions))
            harness.app.adopt(changed)

    harness = SitlHarness(mission()).fly(30.0, on_step)
    after = harness.recorder.missions[done[0] :]
    assert after, harness.kinds()
    assert "unsafe" in after[0].reason  # what was flown until then passes through the new wall
    assert harness.app.state.violations_of(harness.app.state.flown.path) == ()


def test_other_goals_begin_at_the_first_and_lay_the_list_out_anew():
    done = []
    changed = mission(("{east_m: 1750, north_m: 750, up_m: 100, acceptance_radius_m: 60}",
                       "{east_m: 1650, north_m: 500, up_m: 100, acceptance_radius_m: 60}"))  # fmt: skip

    def on_step(harness):
        if harness.now_s > 12.0 and not done:
            done.append(len(harness.recorder.missions))
            harness.app.adopt(changed)

    harness = SitlHarness(mission()).fly(30.0, on_step)
    assert harness.app.state.next_goal == 0
    assert len(harness.recorder.missions) > done[0], harness.texts("rejected")
    end = harness.app.state.flown.path.positions_enu_m[-1]
    assert abs(end[0] - 1650.0) <= 61.0
    assert abs(end[1] - 500.0) <= 61.0


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("name: first-flight", "name: second-flight", "name"),
        ("latitude_deg: -35.363261", "latitude_deg: -35.363260", "origin"),
        ("speed_m_s: 0,", "speed_m_s: 1,", "dynamic_threats"),
        ("# link:\n#   track_sources: [200, 42]", "link:\n  track_sources: [200, 42]", "link"),
        ("  # seed: 1\n", "  seed: 2\n", "planning.seed"),
        ("turn_radius_min_m: 125", "turn_radius_min_m: wide", "vehicle.turn_radius_min_m"),
    ],
)
def test_what_cannot_change_in_flight_is_refused_by_its_key(tmp_path, old, new, key):
    assert old in FIRST_FLIGHT
    file = tmp_path / "mission.yaml"
    file.write_text(FIRST_FLIGHT.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as refused:
        changed_mission(mission(), file)
    assert refused.value.key == key
    assert refused.value.file == str(file)


def test_thresholds_obstacles_radars_and_goals_may_change(tmp_path):
    file = tmp_path / "mission.yaml"
    text = FIRST_FLIGHT.replace("threat_level_max: 0.2", "threat_level_max: 0.3")
    text = text.replace("max_threat_radius_m: 500", "max_threat_radius_m: 400").replace(
        "east_m: 1750", "east_m: 1700"
    )
    file.write_text(text, encoding="utf-8")
    assert changed_mission(mission(), file)[0].planning.threat_level_max == 0.3
