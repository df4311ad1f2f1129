"""The pilot takes over and hands back: what is said of the way back, and what is flown on it."""

import numpy as np
from shapely.geometry import LineString, Polygon

from companion.config import mission_from_text
from companion.flight.state.modes import Mode
from tests.flight.test_app import at, both, switch
from tests.flight.test_operator import BOTH, MISSION_MODE
from tests.sim.client import PLAIN
from tests.support.sitl_harness import SitlHarness

# The way on lies round the wall's north end; the old item, seen from south of it, behind the wall.
WALL = "obstacles:\n  - {name: wall, polygon_enu_m: [[900, -900], [960, -900], [960, 160], [900, 160]], "
WALL += "base_m: 0, top_m: 300}\n"


BEHIND = (
    "obstacles:\n  - {name: block, polygon_enu_m: [[860, -320], [1600, -320], [1600, -260], [860, -260]], "
)
BEHIND += "base_m: 0, top_m: 300}\n"


def flown(dialect, authority, until_s, *steps):
    text = PLAIN + WALL + f"authority: {authority}\n"
    harness = SitlHarness(mission_from_text(text, "handback.yaml"), dialect=dialect)
    return harness.fly(until_s, both(*steps))


TOOK_S, BACK_S = 14.0, 44.0


def taken_and_handed_back(dialect, authority):
    steps = switch(TOOK_S, "LOITER"), switch(BACK_S, MISSION_MODE[dialect])
    return flown(dialect, authority, 70.0, *steps)


def said(harness, kind, after_s, before_s):
    return [e.text for e in harness.recorder.decisions if e.kind == kind and after_s <= e.stamp_s < before_s]


@BOTH
def test_how_to_hand_back_and_whether_it_is_safe_is_said_at_once(dialect):
    harness = flown(dialect, "{}", 18.0, switch(TOOK_S, "LOITER"))
    (whether,) = said(harness, "handback", TOOK_S, TOOK_S + 2.0)
    assert whether.startswith("safe, to item ")
    told = [message.text for stamp, message in harness.said("STATUSTEXT") if TOOK_S < stamp < TOOK_S + 2.0]
    assert f"{MISSION_MODE[dialect]} from here is safe for 10 s" in told
    assert any(text.endswith(f"{MISSION_MODE[dialect]} resumes") for text in told)


@BOTH
def test_nothing_is_sent_while_the_pilot_flies_unless_the_mission_file_allows_it(dialect):
    harness = taken_and_handed_back(dialect, "{}")
    assert harness.changes(TOOK_S + 0.1, BACK_S) == []
    assert harness.app.mode is Mode.ACTIVE
    assert harness.changes(after_s=BACK_S) != []


@BOTH
def test_where_it_is_allowed_a_checked_mission_is_kept_ready(dialect):
    harness = taken_and_handed_back(dialect, "{keep_ready: true}")
    assert said(harness, "ready", TOOK_S, BACK_S) != []
    autopilot = harness.simulator.autopilot
    assert not harness.simulator.truth.collision
    assert harness.app.mode is Mode.ACTIVE
    first, end = harness.app.state.mission_list.layout.flown_span
    assert first <= autopilot.current_sequence < end


def test_a_way_back_through_a_wall_is_told_and_its_mission_replaced():
    """Handed back behind a wall, the old item is flown to directly, through it; not what is kept ready."""
    blocked = {}
    for authority in ("{}", "{keep_ready: true}"):
        harness = SitlHarness(mission_from_text(PLAIN + BEHIND + f"authority: {authority}\n", "behind.yaml"))

        def away(harness):
            harness.simulator.set_mode("GUIDED")
            harness.simulator.autopilot._go_to((1100.0, -560.0, 100.0), 130.0)

        mode = switch(70.0, "AUTO")
        harness.fly(72.0 if authority == "{}" else 100.0, both(at(14.0, away), mode))
        blocked[authority] = harness
    told = said(blocked["{}"], "handback", 14.0, 70.0)
    assert any(text.startswith("NOT safe") and "distance to block" in text for text in told)
    assert not told[-1].startswith("safe")
    kept = blocked["{keep_ready: true}"]
    assert not kept.simulator.truth.collision
    rows = np.array(kept.simulator.truth.path)
    after = LineString(rows[rows[:, 0] >= 70.0][:, 1:3])  # before, the pilot flew as the pilot liked
    assert after.distance(Polygon(kept.simulator.truth.obstacles[0].polygon_enu_m)) > 7.5
