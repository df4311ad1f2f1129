"""A small share of ``make torture``: exchanges broken off, random schedules, and that the judge can see."""

import asyncio
import math
from dataclasses import replace

import pytest

from companion.types.events import Dialect
from companion.types.state import Ownship
from sim.autopilot.px4.px4_store import stored
from sim.faults import Event, FaultKind, LinkFaults, Schedule, random_schedule
from sim.mission_types import MissionKind
from tests.torture.campaigns import lossy_flight
from tests.torture.harness import (
    TortureHarness,
    at_speed,
    broken_after,
    flown,
    fly,
    num_messages,
    random_flight,
)

BOTH = pytest.mark.parametrize("dialect", list(Dialect), ids=lambda dialect: dialect.value)
# Within the first mission's upload, its reading back and entry, within the next one's, and within the
# first that writes a part only. `make torture` breaks off everywhere.
BREAKS = {
    Dialect.ARDUPILOT: (8, 60, 111, 150, 215, 330, 435, 436, 476, 530, 566),
    Dialect.PX4: (8, 20, 40, 80),
}


@BOTH
def test_undisturbed_missions_are_swapped_and_nothing_is_violated(dialect):
    verdict, _ = fly(dialect, 1, Schedule())
    assert verdict.num_swaps >= 2
    assert verdict.num_judged > 50
    assert verdict.violations == []


@pytest.mark.parametrize(
    ("dialect", "number"), [(dialect, number) for dialect, numbers in BREAKS.items() for number in numbers]
)
def test_an_exchange_broken_off_leaves_a_mission_that_passes(dialect, number):
    verdict, harness = fly(dialect, 1, Schedule(), broken_after(number, 8.0), 34.0)
    assert harness.exchange["count"] >= number
    assert verdict.violations == []
    assert not verdict.collision
    assert verdict.num_swaps >= 1


@BOTH
@pytest.mark.parametrize("seed", [1, 2])
def test_random_schedules(dialect, seed):
    verdict, _ = random_flight(dialect, seed)
    assert verdict.violations == []
    assert not verdict.collision


@pytest.mark.parametrize("course_deg", [0.0, 90.0, 217.0])
def test_the_judge_flies_at_the_airspeed_that_is_commanded(course_deg):
    """On any course in any wind: what is left of its speed over the ground without the wind is that."""
    here = Ownship(0.0, (0.0, 0.0, 100.0), math.radians(course_deg), 0.0, 25.0, 33.0, (8.0, -3.0))
    there = at_speed(here, 37.5)
    over_ground = [
        there.ground_speed_m_s * part for part in (math.sin(here.course_rad), math.cos(here.course_rad))
    ]
    assert math.dist(over_ground, there.wind_enu_m_s) == pytest.approx(37.5)
    assert there.course_rad == here.course_rad


@pytest.mark.parametrize(
    ("world", "dialect", "seed"),
    [
        ("paper-2d", Dialect.ARDUPILOT, 5),
        ("paper-3d", Dialect.PX4, 5),
        # A circle moved over the last waypoint: entered from inside, it swung into a wall in another wind.
        ("paper-2d", Dialect.ARDUPILOT, 1161),
        pytest.param("paper-2d", Dialect.PX4, 5, marks=pytest.mark.slow),
        pytest.param("paper-3d", Dialect.ARDUPILOT, 5, marks=pytest.mark.slow),
        # Circles moved into the bounds: ways into them once led out of these, and into an obstacle.
        pytest.param("paper-2d", Dialect.ARDUPILOT, 20104, marks=pytest.mark.slow),
        pytest.param("paper-2d", Dialect.ARDUPILOT, 30161, marks=pytest.mark.slow),
        # Entered at its third waypoint, a mission that commanded its airspeed behind the first two.
        pytest.param("paper-2d", Dialect.ARDUPILOT, 50173, marks=pytest.mark.slow),
        # Hurried behind its first waypoint, out of a turn: it passed a wall at 9 m, where 15 are to be kept.
        pytest.param("paper-2d", Dialect.ARDUPILOT, 72011, marks=pytest.mark.slow),
        # Judged by mistake at 41 m/s over the ground, as if the wind were behind it on each course.
        pytest.param("paper-2d", Dialect.ARDUPILOT, 347, marks=pytest.mark.slow),
        # A line that takes 1.7 s each way, and a hurried flight round the corner of a wall: both touched it.
        pytest.param("paper-2d", Dialect.ARDUPILOT, 30323, marks=pytest.mark.slow),
        pytest.param("paper-2d", Dialect.ARDUPILOT, 30428, marks=pytest.mark.slow),
    ],
)
@pytest.mark.thorough
def test_random_schedules_on_narrow_maps(dialect, world, seed):
    verdict, _ = random_flight(dialect, seed, world)
    assert verdict.violations == []
    assert not verdict.collision
    assert verdict.num_judged > 50


def test_the_positions_broken_at_lie_in_the_exchange():
    for dialect, numbers in BREAKS.items():
        assert max(numbers) < num_messages(dialect, 34.0)


@pytest.mark.parametrize(
    "faults",
    [
        LinkFaults(loss=0.5),
        LinkFaults(delay_s=2.0),
        LinkFaults(jitter_s=1.0),
        LinkFaults(duplication=0.5),
        LinkFaults(corruption=0.3),
        *(LinkFaults(mission_nack=number) for number in (1, 15)),
        *(pytest.param(LinkFaults(mission_nack=number), marks=pytest.mark.slow) for number in (4, 13, 14)),
        LinkFaults(command_nack=1),
        *(pytest.param(LinkFaults(command_nack=number), marks=pytest.mark.slow) for number in (2, 3, 4)),
    ],
    ids=str,
)
@BOTH
@pytest.mark.thorough
def test_one_fault_all_along(dialect, faults):
    verdict, _ = fly(dialect, 1, Schedule(((5.0, 40.0, faults),)), duration_s=30.0)
    assert verdict.violations == []
    assert not verdict.collision


@BOTH
def test_the_goal_is_reached_over_a_link_that_loses_every_fifth_frame(dialect):
    how, harness = lossy_flight(dialect, 1)
    assert how == "goal"
    assert harness.app.num_swaps >= 3


@BOTH
def test_swaps_that_keep_failing_are_announced_as_an_emergency_step(dialect):
    # From 12 s on no item of ours gets through: the flown mission is kept, and the pilot told so, once.
    def without_items(harness):
        def watch(frame, is_from_client):
            is_item = int.from_bytes(frame[7:10], "little") == 73
            return not (is_item and is_from_client and harness.now_s > 12.0)

        return watch

    verdict, harness = fly(dialect, 1, Schedule(), without_items, duration_s=70.0)
    said = [entry for entry in harness.recorder.decisions if "swaps failed" in entry.text]
    assert len(said) == 1
    assert harness.app.emergency is not None
    assert verdict.violations == []


@pytest.mark.parametrize("kind", [each for each in FaultKind if each is not FaultKind.UPLOADER])
@pytest.mark.thorough
def test_one_fault(kind):
    event = Event(12.0, 18.0, kind, 3.0)
    verdict, _ = fly(Dialect.ARDUPILOT, 1, Schedule((), (event,)), duration_s=35.0)
    assert verdict.violations == []
    assert verdict.num_swaps >= 2


def test_schedules_repeat_and_differ():
    assert random_schedule(5, 60.0) == random_schedule(5, 60.0)
    assert len({random_schedule(seed, 60.0) for seed in range(20)}) == 20
    kinds = {event.kind for seed in range(200) for event in random_schedule(seed, 60.0).events}
    assert kinds == set(FaultKind)


# --- the judge is no yes-man


def spoiled(dialect, spoil):
    """A flight in which somebody spoils the mission at 8 s."""
    harness = TortureHarness(dialect, 1, Schedule())
    act, done = harness.act, []

    def spoiling(inner):
        if harness.now_s > 8.0 and not done:
            done.append(harness.now_s)
            spoil(harness.simulator.autopilot)
        act(inner)

    harness.act = spoiling
    return asyncio.run(flown(harness, 11.0))


def through_the_wall(autopilot):
    """Move what lies ahead behind the wall."""
    latitude, longitude = autopilot.projection.degrees(630.0, -300.0)
    wrong = {"latitude_e7": round(latitude * 1e7), "longitude_e7": round(longitude * 1e7)}
    current = autopilot.current_sequence
    items = [
        replace(item, **wrong) if item.sequence > current and item.command == 16 else item
        for item in autopilot.mission_items
    ]
    if hasattr(autopilot, "store"):
        autopilot.store.mission[:] = items
        autopilot.store.revision += 1
    else:
        autopilot.switch(MissionKind.MISSION, stored(items), current)


def cut_short(autopilot):
    """Take away what follows the next waypoint."""
    keep = autopilot.current_sequence + 1
    if hasattr(autopilot, "store"):
        autopilot.store.truncate(MissionKind.MISSION, keep)
    else:
        autopilot._lists[MissionKind.MISSION] = stored(autopilot.mission_items[:keep])
        autopilot._revision += 1


@BOTH
def test_the_judge_sees_a_way_through_a_wall(dialect):
    verdict = spoiled(dialect, through_the_wall)
    assert any("clearance" in violation[1] for violation in verdict.violations)


@BOTH
def test_the_judge_sees_a_mission_that_does_not_end_in_a_loiter(dialect):
    verdict = spoiled(dialect, cut_short)
    assert any("ending" in violation[1] for violation in verdict.violations)


def test_the_judge_sees_a_mode_that_changed_by_itself():
    verdict = spoiled(Dialect.ARDUPILOT, lambda autopilot: autopilot.set_mode("RTL"))
    assert any("mode RTL" in violation[1] for violation in verdict.violations)


def test_the_judge_flies_at_the_speed_to_come_too(monkeypatch):
    """Where less is commanded, at its own only until that is reached; where more, all the way at both."""
    _, harness = fly(Dialect.ARDUPILOT, 5, Schedule(), duration_s=20.0)
    judge = harness.judge
    assert judge._commanded() == (0, pytest.approx(25.0, abs=0.5))
    way = judge._way()
    (as_it_is,) = judge._tracks(*way)
    monkeypatch.setattr(judge, "_commanded", lambda: (0, 36.0))
    now, at_once = judge._tracks(*way)
    assert len(now) == len(as_it_is)
    assert len(at_once) < len(as_it_is), "faster, it is there sooner"
    monkeypatch.setattr(judge, "_commanded", lambda: (1, 36.0))
    now, later = judge._tracks(*way)
    assert len(at_once) < len(later) < len(now), "only behind the first of its targets"
    monkeypatch.setattr(judge, "_commanded", lambda: (0, 15.0))
    now, slower = judge._tracks(*way)
    assert len(now) < len(as_it_is) < len(slower)
