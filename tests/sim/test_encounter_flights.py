"""Aircraft that pass in the simulator: what is reported of them, and what an encounter's row says."""

from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import load_mission
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.encounters.daa_scenario import scenario_from_text
from companion.research.encounters.encounter_model import model_from_text
from companion.types.events import Dialect
from sim.bench.encounter_flights import EncounterRunner, flown_encounter
from sim.bench.encounter_measures import encounter_measures
from sim.simulator import Simulator
from sim.threats.passing_aircraft import PassingAircraft
from sim.threats.reports import ADSB, SOURCES
from tests.research.encounters.made_model import text
from tests.sim.client import CONFIGS

TIMES = np.arange(0.0, 61.0)
STILL = np.zeros_like(TIMES)
# From 1000 m east at 60 m/s to the west, climbing at 2 m/s from 200 m.
TRACK = np.column_stack(
    [TIMES, 1000.0 - 60.0 * TIMES, STILL + 300.0, 200.0 + 2.0 * TIMES, STILL - 60.0, STILL, STILL + 2.0]
)


def reports(aircraft, duration_s):
    """What a simulator tells of one aircraft: by time, the ADSB_VEHICLE messages."""
    mission = load_mission(CONFIGS / "first-flight.yaml").model_copy(update={"dynamic_threats": ()})
    simulator = Simulator(mission, seed=1, aircraft=[("passing", aircraft)])
    parser, found = mavlink.MAVLink(None), []
    for _ in range(round(duration_s / 0.1)):
        simulator.step(0.1)
        told = parser.parse_buffer(simulator.take_outgoing()) or ()
        found += [(simulator.now_s, one) for one in told if one.get_type() == "ADSB_VEHICLE"]
    return mission.frame, found


def test_a_report_a_second_tells_where_it_was_a_while_ago():
    frame, found = reports(PassingAircraft(TRACK, replace(ADSB, delay_s=2.0, loss=0.0)), 20.0)
    assert len(found) == pytest.approx(20, abs=1)
    late = [(now_s, message) for now_s, message in found if now_s > 3.0]
    errors = []
    for now_s, message in late:
        east, north, up = frame.local_from_global(
            message.lat * 1e-7, message.lon * 1e-7, message.altitude * 1e-3
        )
        then = now_s - 2.0
        errors.append((east - (1000.0 - 60.0 * then), north - 300.0, up - (200.0 + 2.0 * then)))
        assert message.ver_velocity == 200
        assert message.emitter_type == mavlink.ADSB_EMITTER_TYPE_LIGHT
        assert message.heading == pytest.approx(27000, abs=400)
    # Noise of 8 m and 3 m, and up to 0.1 s of 60 m/s between two of its steps.
    assert np.abs(np.mean(errors, axis=0)) == pytest.approx((0.0, 0.0, 0.0), abs=9.0)
    assert np.abs(errors).max() < 40.0


def test_an_aircraft_flies_on_behind_the_end_of_its_track():
    aircraft = PassingAircraft(TRACK)
    aircraft.step(90_000_000, 0.02, None)  # Half a minute later.
    assert aircraft.position == (1000.0 - 60.0 * 90.0, 300.0)
    assert (aircraft.up_m, aircraft.velocity_m_s, aircraft.climb_m_s) == (380.0, (-60.0, 0.0), 2.0)


def test_the_stated_share_of_reports_is_lost():
    _, found = reports(PassingAircraft(TRACK, replace(ADSB, loss=0.5)), 60.0)
    assert 18 <= len(found) <= 42  # 30 expected of 60; three standard deviations.
    assert reports(PassingAircraft(TRACK, replace(ADSB, loss=1.0)), 5.0)[1] == []


def test_measures_of_a_straight_passage_by_hand():
    # Head on at 25 + 60 m/s, 300 m aside: they meet after 1000/85 s, and it has climbed 23.53 m by then.
    times = np.arange(0.0, 60.0, 0.1)
    own = np.column_stack([times, 25.0 * times, 0.0 * times, 0.0 * times + 203.53])
    found = encounter_measures(own, {"passing": TRACK})
    assert found["miss_m"] == pytest.approx(300.0, abs=0.1)
    assert found["above_m"] == pytest.approx(200.0 + 2.0 * 1000.0 / 85.0 - 203.53, abs=0.3)
    assert [found[name] for name in ("nmac", "lowc", "lowc_en_route", "lowc_non_cooperative")] == [
        False, True, True, True,
    ]  # fmt: skip
    # At the meeting the range is the miss distance: FG(300/609.6, 300/609.6), and 20 m of 76.2 m.
    x2, z2 = (300.0 / 609.6) ** 2, (20.0 / 76.2) ** 2
    assert found["severity"] == pytest.approx(1.0 - (1.0 - (1.0 - x2) ** 2 * (1.0 - z2)) ** 0.5, abs=0.01)
    high = np.column_stack([own[:, :3], own[:, 3] + 400.0])
    clear = encounter_measures(high, {"passing": TRACK})
    assert not any(clear[name] for name in ("nmac", "lowc", "lowc_en_route", "lowc_non_cooperative"))
    assert clear["severity"] == 0.0
    far = TRACK + np.array([0.0, 0.0, 5000.0, 0.0, 0.0, 0.0, 0.0])
    assert encounter_measures(own, {"far": far, "passing": TRACK}) == found


@pytest.mark.slow
def test_an_encounter_flown_twice_gives_the_same_row_and_what_was_drawn():
    mission = load_mission(CONFIGS / "first-flight.yaml").model_copy(
        update={"dynamic_threats": (), "radars": (), "obstacles": ()}
    )
    model = model_from_text(text(), "made")
    outcome = flown_encounter(mission, model, 3, spread=1.0, dialect=Dialect.PX4)
    row = outcome.measures
    assert row["without.miss_m"] == pytest.approx(row["drawn_miss_m"], abs=6.0)
    assert row["without.lowc"]
    assert row["success"]
    for name in ("true_path", "passing"):
        assert np.diff(np.array(outcome.paths[name])[:, 0]) == pytest.approx(1.0, abs=0.11)
    assert flown_encounter(mission, model, 3, spread=1.0, dialect=Dialect.PX4) == outcome


@pytest.mark.thorough
def test_a_campaigns_encounter_is_flown_alone_and_with_the_aircraft():
    campaign = load_campaign(CONFIGS.parent / "campaigns" / "encounters.yaml")
    run = next(run for run in campaign.runs if run.setting == "only losses of well clear")
    runner = EncounterRunner(campaign, {})
    runner.warm_up()
    outcome = runner.outcome(run)
    assert outcome.measures["success"] is True
    assert (outcome.measures["without.lowc"], outcome.measures["lowc"]) == (True, False)
    assert outcome.measures["without.miss_m"] == pytest.approx(outcome.measures["drawn_miss_m"], abs=6.0)
    assert set(outcome.paths) == {"true_path", "passing"}
    other = next(each for each in campaign.runs if each.setting == "made up" and each.seed == run.seed)
    # The flight alone is the same under all settings of a seed, and is flown once.
    assert runner.outcome(other) == EncounterRunner(campaign, {}).outcome(other)


@pytest.mark.parametrize("name", ["remote_id", "utm"])
@pytest.mark.thorough
def test_well_clear_is_kept_however_the_aircraft_is_reported(name):
    """The encounter of the campaign, whose flight alone loses well clear."""
    mission = load_mission(CONFIGS.parent / "campaigns" / "encounters" / "passing.yaml")
    model = model_from_text(text(), "made")
    row = flown_encounter(
        mission, model, 1, spread=1.0, dialect=Dialect.ARDUPILOT, source=SOURCES[name]
    ).measures
    assert (row["without.lowc"], row["lowc"], row["success"]) == (True, False, True)


@pytest.mark.thorough
def test_a_scenario_is_flown_clear_before_there_is_anything_to_tell():
    """Head on, with 150 m between the ways: the other aircraft at 60 m/s, ours at 25 m/s."""
    rows = []
    for second in range(0, 101, 2):
        own, other = (30.0 * second - 3000.0) / 111_320.0, (6000.0 - 60.0 * second) / 111_320.0
        rows.append(f"Ownship, 0.0, {own:.7f}, 1000.0, 30.0, 0.0, 0.0, {second}")
        rows.append(f"Other, {150.0 / 110_574.0:.7f}, {other:.7f}, 1000.0, -60.0, 0.0, 0.0, {second}")
    head = ["NAME, lat, lon, alt, vx, vy, vz, time", "[none], [deg], [deg], [m], [m/s], [m/s], [m/s], [s]"]
    scenario = scenario_from_text("\n".join(head + rows), "head-on.daa")
    mission = load_mission(CONFIGS.parent / "campaigns" / "encounters" / "passing.yaml")
    row = flown_encounter(mission, scenario, 3, spread=1.0, dialect=Dialect.PX4).measures
    assert row["without.miss_m"] == pytest.approx(150.0, abs=15.0)
    assert (row["without.lowc"], row["lowc"], row["success"]) == (True, False, True)
    assert (row["alert_before_s"], row["alerts"]) == (None, 0)
