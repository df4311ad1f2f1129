"""An engine that stops: the field is named within a second, and flown to where that is allowed."""

import math

import pytest

from companion.flight.state.modes import Mode
from companion.types.mission import Command
from tests.flight.test_app import at, both
from tests.glide.glide_flights import GlideHarness, flown, judged, mission_of
from tests.support.sitl_harness import SitlHarness

STOPS_S = 30.0
# In one flight another circle is chosen while a mission is exchanged; in one the engine stops in a climb, in
# one in rising air at a low airspeed, and in one in the descent to the goal.
ANOTHER_CIRCLE, CLIMBING, RISING_AIR, BEFORE_ARRIVAL = 1084, 1151, 1207, 1211
TOLD_MAX_S = 5.0
NUMBERS = {"ardupilot": 9, "px4": 13}  # Flights of first-flight.


def stops(harness):
    harness.simulator._scenario.flight.has_thrust = False


def told_of(harness):
    """Texts about the engine, with their times."""
    return [(entry.stamp_s, entry.told) for entry in harness.recorder.decisions if entry.kind == "engine"]


@pytest.mark.parametrize("autopilot", ["ardupilot", pytest.param("px4", marks=pytest.mark.slow)])
def test_it_comes_down_at_the_field_that_was_named(autopilot):
    told, harness = flown(NUMBERS[autopilot])
    assert told.dialect == autopilot
    assert told.verdict == "at the field", told
    assert told.chosen_after_s <= 1.0
    texts = [text for _, text in told_of(harness) if text]
    assert any(text.startswith(f"NO THRUST: glide to {told.place}, ") for text in texts)
    assert any(text == f"NO THRUST: final to {told.place}" for text in texts)
    commands = [item.command for item in harness.simulator.autopilot.mission_items]
    assert Command.NAV_LAND in commands
    assert harness.app.num_plans > 0
    after = [entry for entry in harness.recorder.decisions if entry.stamp_s > harness.told_s + 6.0]
    assert not [entry for entry in after if entry.kind in ("keep", "off path", "emergency")]


def without_authority(number):
    mission, dialect, _ = mission_of(number)
    authority = mission.authority.model_copy(update={"glide": False})
    return mission.model_copy(update={"authority": authority}), dialect


@pytest.mark.slow
def test_without_authority_the_field_is_named_and_shown_and_nothing_is_sent_for_it():
    mission, dialect = without_authority(NUMBERS["ardupilot"])
    shown = []

    def look(harness):
        shown.append(harness.app._departure.glide.status())

    harness = SitlHarness(mission, dialect=dialect).fly(STOPS_S + 8.0, both(at(STOPS_S, stops), look))
    texts = [text for _, text in told_of(harness) if text]
    assert any(text.startswith("NO THRUST: glide to ") for text in texts)
    assert shown[0] == {}
    assert shown[-1]["is_commanded"] is False
    assert shown[-1]["spare_m"] > 0.0
    assert shown[-1]["name"] in texts[-1]
    assert not [
        entry
        for entry in harness.recorder.decisions
        if entry.text.startswith("glide to") and entry.kind == "swap"
    ]
    assert Command.NAV_LOITER_TO_ALT not in [
        item.command for item in harness.simulator.autopilot.mission_items
    ]


@pytest.mark.slow
def test_with_thrust_again_no_field_is_named_any_more():
    """Without authority: a glide that is commanded closes the throttle, and nobody notices a new thrust."""
    mission, dialect = without_authority(NUMBERS["ardupilot"])

    def again(harness):
        harness.simulator._scenario.flight.has_thrust = True

    harness = SitlHarness(mission, dialect=dialect)
    harness.fly(STOPS_S + 40.0, both(at(STOPS_S, stops), at(STOPS_S + 10.0, again)))
    after = [entry for entry in harness.recorder.decisions if entry.stamp_s > STOPS_S + 10.0]
    assert any(entry.told == "Thrust again" for entry in after)
    assert harness.app._departure.glide.status() == {}
    assert harness.app.mode in (Mode.ACTIVE, Mode.ARRIVED)


@pytest.mark.slow
def test_while_the_pilot_flies_the_field_is_named_and_nothing_is_sent():
    mission, dialect, _ = mission_of(NUMBERS["ardupilot"])
    harness = SitlHarness(mission, dialect=dialect)
    pilot = at(STOPS_S - 1.0, lambda flight: flight.simulator.set_mode("FBWA"))
    harness.fly(STOPS_S + 12.0, both(pilot, at(STOPS_S, stops)))
    assert any(text.startswith("NO THRUST: ") for _, text in told_of(harness))
    assert not harness.changes(after_s=STOPS_S + 1.0)


@pytest.mark.slow
def test_a_new_path_names_its_stretches_and_the_pilot_reads_them_once():
    mission, dialect, _ = mission_of(NUMBERS["ardupilot"])
    fields = mission.glide.fields[:1]
    mission = mission.model_copy(update={"glide": mission.glide.model_copy(update={"fields": fields})})
    harness = SitlHarness(mission, dialect=dialect).fly(45.0)
    swaps = [entry for entry in harness.recorder.decisions if entry.kind == "swap"]
    assert swaps
    assert all("no_field_s" in entry.why for entry in swaps)
    told = [text for _, text in told_of(harness) if text.startswith("No field in glide for ")]
    assert len(told) == len(set(told))
    assert bool(told) is any(entry.why["no_field_s"] for entry in swaps)


@pytest.mark.slow
def test_after_a_handback_the_glide_begins_anew():
    mission, dialect, _ = mission_of(NUMBERS["ardupilot"])
    harness = GlideHarness(mission, 1, dialect, STOPS_S)
    pilot = at(STOPS_S + 12.0, lambda flight: flight.simulator.set_mode("FBWA"))
    back = at(STOPS_S + 16.0, lambda flight: flight.simulator.set_mode("AUTO"))
    harness.fly(STOPS_S + 200.0, both(harness.act, pilot, back))
    swaps = [entry for entry in harness.recorder.decisions if entry.kind == "swap"]
    swaps = [entry for entry in swaps if entry.text.startswith("glide to")]
    assert any(entry.stamp_s < STOPS_S + 12.0 for entry in swaps)
    assert any(entry.stamp_s > STOPS_S + 16.0 for entry in swaps)
    assert judged(1, mission, dialect, harness).verdict == "at the field"


@pytest.mark.slow
@pytest.mark.parametrize("number", [*range(12), ANOTHER_CIRCLE, CLIMBING, RISING_AIR])
def test_engines_that_stop_anywhere(number):
    told, _ = flown(number)
    assert not told.told_after_s > TOLD_MAX_S, told
    assert told.verdict not in ("touched", "elsewhere", "not down"), told


@pytest.mark.slow
def test_an_engine_whose_stop_shows_after_the_arrival_is_glided_for_all_the_same():
    told, harness = flown(BEFORE_ARRIVAL)
    assert harness.told_mode is Mode.ARRIVED
    assert told.verdict == "at the field", told


def test_the_harness_knows_the_stretch_in_which_the_engine_stopped():
    mission, dialect, _ = mission_of(1)
    harness = GlideHarness(mission, 1, dialect, math.inf)
    harness.stopped_s, harness.path_begin_s, harness.stretches = 50.0, 40.0, ((8, 11),)
    assert harness.is_in_named_stretch
    harness.stretches = ((11, 14),)
    assert not harness.is_in_named_stretch
    harness.told_s = 52.0
    assert harness.is_in_named_stretch
