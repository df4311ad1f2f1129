"""What changes in flight is answered at once; beside the same flights by a service that does not look."""

import functools

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Point

from companion.config import mission_from_text
from companion.flight.exchange.handover import Handover
from companion.flight.replanning.plan_maker import PlanMaker
from companion.flight.replanning.replanning import Replanning
from companion.flight.replanning.surprise_watch import SurpriseWatch
from companion.planning.plan_runner import InlineRunner, PlanTiming, StopRule
from companion.types.events import Dialect
from sim.bench.reaction import MISSION, reaction_in
from tests.flight.test_geofences import BOTH, CIRCLE_OUT, fence, flown
from tests.sim.client import PLAIN
from tests.support import sitl_harness
from tests.support.sitl_harness import SitlHarness

LONG = (
    PLAIN.replace("{east_m: 1750, north_m: 750, up_m: 100}", "{east_m: 4000, north_m: 0, up_m: 100}")
    .replace("total_planning_time_s: 80", "total_planning_time_s: 250, threat_level_max: 0.3")
    .replace("total_planning_time_s", "max_iterations: 12000, total_planning_time_s")
)  # fmt: skip
CHANGED_S, AHEAD_M = 20.0, 600.0  # just after a plan
PERIOD_S = 0.5
QUICK_S = 0.1
WHILE_SEARCHING, WHILE_WAITING = 99, 24  # Seeds: a search is under way, a mission waits.


def ahead(harness):
    """A place on the flown path, 600 m on (2,) [m]."""
    east = harness.simulator.truth.path[-1][1]
    rows = harness.app.state.flown.path.positions_enu_m
    return rows[np.searchsorted(rows[:, 0], east + AHEAD_M), :2]


def sighted(harness, place, velocity=(0.0, 0.0)):
    """A surveillance source reports a ground vehicle."""
    autopilot = harness.simulator.autopilot
    latitude, longitude = autopilot.projection.degrees(*place)
    course = np.degrees(np.arctan2(*velocity)) % 360.0
    report = mavlink.MAVLink_adsb_vehicle_message(
        0xABC, round(latitude * 1e7), round(longitude * 1e7), 0, 584_000, round(100.0 * course),
        round(100.0 * np.hypot(*velocity)), 0, b"TRUCK", mavlink.ADSB_EMITTER_TYPE_SERVICE_SURFACE, 0, 63, 0,
    )  # fmt: skip
    autopilot.relay_traffic(report, (200, mavlink.MAV_COMP_ID_ADSB))


def fence_across(harness, places):
    if not places:
        places.append(ahead(harness))
        fence(harness, (CIRCLE_OUT, 150.0, *places[0]))


def pop_up(harness, places):
    places = places or [ahead(harness)]
    sighted(harness, places[0])


def answered_after_s(harness):
    """How long after the change another mission was flown; infinite while none is [s]."""
    swaps = [entry.stamp_s for entry in harness.recorder.decisions if entry.kind == "swap"]
    return next((at - CHANGED_S for at in swaps if at > CHANGED_S), np.inf)


def reaction_s(change, dialect, *, flies_on=False):
    """A flight in which something changes; after how long another mission is flown, and the flight.

    It ends with the answer, or ``flies_on`` past what was in the way.
    """
    harness = SitlHarness(mission_from_text(LONG, "surprise.yaml"), dialect=dialect)
    harness.places, due = [], [CHANGED_S]

    def on_step(harness):
        if harness.now_s >= due[0]:
            due[0] += PERIOD_S
            change(harness, harness.places)
        harness.is_over = not flies_on and answered_after_s(harness) < np.inf

    harness.fly(CHANGED_S + 25.0, on_step)
    return answered_after_s(harness), harness


@BOTH
@pytest.mark.parametrize("change", [fence_across, pop_up])
def test_a_surprise_is_answered_within_seconds(change, dialect):
    took_s, harness = reaction_s(change, dialect, flies_on=change is fence_across)
    assert took_s < 3.5
    if change is fence_across:
        assert flown(harness).distance(Point(harness.places[0])) > 150.0


@BOTH
def test_a_fence_that_moves_again_and_again_is_followed(dialect):
    """As many points as before, elsewhere: real autopilots are drawn on while they fly."""
    moved = []

    def move(harness, _places):
        if harness.now_s >= CHANGED_S + 3.0 * len(moved):
            east, north = ahead(harness)
            moved.append(harness.now_s)
            fence(harness, (CIRCLE_OUT, 80.0, east, north + 40.0 * len(moved)))

    _, harness = reaction_s(move, dialect, flies_on=True)
    assert len(moved) >= 6
    assert len(harness.texts("fence")) == len(moved)
    assert harness.app.num_swaps >= 3


@pytest.mark.parametrize("change", [fence_across, pop_up])
def test_without_the_watch_it_is_answered_much_later(change, monkeypatch):
    ours_s, _ = reaction_s(change, Dialect.PX4)
    monkeypatch.setattr(SurpriseWatch, "look", lambda _watch, _now_s, **_how: "")
    took_s, _ = reaction_s(change, Dialect.PX4)
    assert took_s > 3.0 * ours_s


# Narrower bounds than the bench's: what no path comes near need not be filled with distances.
TURN = MISSION.replace("planning: {", "planning: {max_iterations: 12000, ").replace(
    "bounds: {east_m: [-6000, 6000], north_m: [-6000, 6000]",
    "bounds: {east_m: [-500, 4500], north_m: [-1500, 1500]",
)


def turn_answered(dialect, seed):
    """A known aircraft turns towards ours, as ``companion bench`` has it.

    When that is answered, and why searches were broken off.
    """
    harness = SitlHarness(mission_from_text(TURN, "turn.yaml"), dialect=dialect, seed=seed)
    reaction = reaction_in(harness.simulator, "turn", seed)
    reasons, break_off = [], PlanMaker.break_off

    def look(harness):
        harness.is_over = reaction.is_over()

    def note(maker, why):
        reasons.append(why)
        break_off(maker, why)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(PlanMaker, "break_off", note)
        harness.fly(60.0, look)
    return reaction.took_s, reasons


@pytest.fixture(scope="module")
def answered():
    """:func:`turn_answered`, which flies once what two tests look at."""
    return functools.cache(turn_answered)


def test_a_vehicle_that_turns_towards_the_path_ends_the_search_under_way(answered):
    """One search in some forty flights is under way just then; that of this seed is."""
    took_s, reasons = answered(Dialect.PX4, WHILE_SEARCHING)
    assert took_s <= 1.6
    (reason,) = reasons
    assert "threat on the flown path" in reason


def test_with_searches_that_end_and_entries_that_wait_it_is_answered_later(monkeypatch, answered):
    (ours_s, _), hand_over = answered(Dialect.PX4, WHILE_SEARCHING), Handover.hand_over

    async def when_it_begins(handover, *given, is_urgent):
        assert is_urgent in (True, False)
        return await hand_over(handover, *given)

    monkeypatch.setattr(Replanning, "look_for_surprise", lambda _: None)
    monkeypatch.setattr(Handover, "hand_over", when_it_begins)
    later_s, _ = turn_answered(Dialect.PX4, WHILE_SEARCHING)
    assert later_s > 1.8 * ours_s


class QuickRunner(InlineRunner):
    """Plans are made in a tenth of a second of the flight's time, as a computer makes them."""

    def timing(self, clock, budget_s, _number):
        return PlanTiming(StopRule(lambda _asked: False), until_s=clock.now_s() + min(budget_s, QUICK_S))


def test_a_mission_that_waits_for_its_entry_is_given_up(monkeypatch):
    """A plan made while the turn is half seen ends before it is seen; its mission waits for seconds."""
    monkeypatch.setattr(sitl_harness, "InlineRunner", QuickRunner)
    ours_s, _ = turn_answered(Dialect.ARDUPILOT, WHILE_WAITING)
    monkeypatch.setattr(Handover, "may_give_up", False)
    waited_s, _ = turn_answered(Dialect.ARDUPILOT, WHILE_WAITING)
    assert ours_s <= 2.0
    assert waited_s > ours_s + 1.0
