"""Flights about made-up recordings, and whether the judge of such flights sees what is wrong."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim.threats.recorded_tracks import recorded_from_text
from tests.traffic_replay.__main__ import chosen_flights, main
from tests.traffic_replay.oracle import CLIMB, EAST, NORTH, TIME, UP, chains_of, impossible_rows, is_justified
from tests.traffic_replay.pieces import HOW, leap_fixes, pieces_of, placed
from tests.traffic_replay.replay_flights import LENGTH_S, Outcome, flown, judge, mission, path_alone

pytestmark = pytest.mark.xdist_group("traffic replay")  # The flights alone are flown once.

HEADER = "timestamp,icao24,latitude,longitude,altitude,groundspeed,track,vertical_rate"
ALTITUDE_FT, SPEED_KT, COURSE_DEG = 3_000.0, 110.0, 200.0
LEAP_S = 60  # The recording with a leap has it in this second.


def recording(step_s=1, leap_s=None, leap_up_ft=0.0, leap_deg=0.0):
    """A recording of two minutes of an aircraft that flies straight; at ``leap_s`` it is elsewhere."""
    rows = [HEADER]
    for second in range(0, 120, step_s):
        way_deg = SPEED_KT * second / 3600.0 / 60.0
        latitude = 46.5 + way_deg * math.cos(math.radians(COURSE_DEG))
        east_deg = way_deg * math.sin(math.radians(COURSE_DEG)) / math.cos(math.radians(46.5))
        leaps = second == leap_s
        stamp = f"2026-01-01 10:{second // 60:02}:{second % 60:02}+00:00"
        place = f"{latitude + leaps * leap_deg:.6f},{7.25 + east_deg:.6f},{ALTITUDE_FT + leaps * leap_up_ft}"
        rows.append(f"{stamp},4b1815,{place},{SPEED_KT},{COURSE_DEG},0")
    return "\n".join(rows) + "\n"


def piece(**keywords):
    (found,) = pieces_of("made up", recorded_from_text(recording(**keywords), "made-up.csv"), 1e3)
    return found


@pytest.mark.parametrize("step_s", [1, 10])
@pytest.mark.thorough
def test_an_aircraft_that_would_come_near_is_announced_before(step_s):
    told = flown(piece(step_s=step_s), "through", 3)
    assert not told.is_wrong, told
    assert told.alone
    assert told.alerts_s
    assert told.alerts_s[0] < told.alone[0][0] - 10.0
    assert max(told.aside_m) > 30.0, "it gives way"


@pytest.mark.parametrize("how", ["far", "as high as recorded"])
@pytest.mark.thorough
def test_an_aircraft_that_stays_away_changes_nothing(how):
    text = recording().replace(f",{ALTITUDE_FT},", ",9000.0,")
    (high,) = pieces_of("high", recorded_from_text(text, "high.csv"), 1e3)
    told = flown(high, how, 3)
    assert not told.is_wrong, told
    assert told.alerts_s == []
    assert told.reports > 30


@pytest.mark.parametrize("leap", [{"leap_up_ft": -2_000.0}, {"leap_deg": 0.5}])
@pytest.mark.thorough
def test_a_report_that_cannot_be_true_changes_nothing(leap):
    there = piece(leap_s=LEAP_S, **leap)
    assert list(leap_fixes(there)) == [LEAP_S]
    told = flown(there, "leap", 3)
    assert told.impossible == 1
    assert not told.is_wrong, told
    assert told.alerts_s == []


@pytest.mark.thorough
def test_the_command_prints_what_it_flew(tmp_path, capsys):
    path = tmp_path / "made-up.csv"
    path.write_text(recording(), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["traffic-replay", "-n", "1", str(path)])
        assert main() == 0
    lines = capsys.readouterr().out.splitlines()
    assert [cell.strip() for cell in lines[1].split("|")][:2] == ["made-up", "1"]
    assert lines[-1].startswith("0 flights wrong")
    assert {how for _, how in chosen_flights(path, 4)} <= set(HOW)


# --- the judge


def judged(alerts_s=(), path=None, moved=None):
    """The outcome of a flight about an aircraft through it, of which the pilot was told at ``alerts_s``."""
    alone = path_alone(1)
    there = moved or placed(piece(), "through", alone, mission().frame, np.random.default_rng(2))
    entries = [SimpleNamespace(kind="traffic", text="icao:4B1815 at", stamp_s=stamp) for stamp in alerts_s]
    flight = SimpleNamespace(
        recorder=SimpleNamespace(decisions=entries),
        simulator=SimpleNamespace(truth=SimpleNamespace(path=alone if path is None else path)),
    )
    told = Outcome("made up", "through")
    judge(told, there, flight, alone)
    return told, there


def test_who_is_not_told_has_been_missed():
    told, _ = judged()
    ((when, _, _),) = told.missed
    assert told.is_wrong
    in_time, _ = judged([when - 20.0])
    assert not in_time.is_wrong
    assert in_time.told_before_s == pytest.approx([20.0], abs=0.1)
    assert judged([when + 1.0])[0].missed
    assert judged([when - 80.0])[0].missed


def test_an_alert_about_what_passes_elsewhere_is_unjustified():
    told, there = judged()
    ((when, _, _),) = told.missed
    rows = there.rows.copy()
    rows[:, UP] += 400.0
    above, _ = judged([when - 20.0], moved=replace(there, rows=rows))
    assert above.unjustified_s == [round(when - 20.0, 2)]
    rows[:, CLIMB] = -12.0
    rows[:, UP] = there.rows[:, UP] - 12.0 * (rows[:, TIME] - when)
    assert is_justified(rows, path_alone(1), when - 20.0), "it comes down upon the flight"


def test_a_detour_without_a_reason_is_wrong():
    alone = path_alone(1)
    there = placed(piece(), "far", alone, mission().frame, np.random.default_rng(2))
    aside = alone + np.array([0.0, 0.0, 200.0, 0.0])
    assert judged(path=aside, moved=there)[0].is_wrong_detour
    assert not judged(moved=there)[0].is_wrong_detour


def test_reports_of_another_place_height_or_climb_cannot_be_true():
    rows = piece().rows.copy()
    rows[30, EAST] += 40_000.0
    rows[70, UP] += 2_000.0
    rows[90, CLIMB] = 160.0
    assert impossible_rows(rows) == [30, 70, 90]


def test_a_place_to_which_an_aircraft_leaps_for_good_is_believed_from_the_third_report_on():
    rows = piece().rows.copy()
    rows[60:, NORTH] += 40_000.0
    first, second = chains_of(rows)[0]
    assert first.believed_from_s(rows) == rows[0, TIME]
    assert second.believed_from_s(rows) == rows[62, TIME]
    assert impossible_rows(rows) == []


def test_an_aircraft_that_was_silent_for_a_while_begins_anew():
    rows = piece().rows.copy()
    rows[60:, TIME] += 100.0
    rows[60:, NORTH] += 90_000.0
    assert [chain.believed_from_s(rows) for chain in chains_of(rows)[0]] == [rows[0, TIME], rows[60, TIME]]


def test_pieces_are_as_long_as_a_flight_and_have_all_reports():
    tracks = recorded_from_text(recording(), "made-up.csv")
    found = pieces_of("made up", tracks, LENGTH_S)
    assert [len(each.reports) for each in found] == [115, 5]
    assert sum(len(each.reports) for each in pieces_of("made up", tracks, 50.0)) == 120
