"""A flight's report from its recording alone."""

import shutil
from collections import Counter

import numpy as np
import pytest

from companion.config import load_mission
from companion.errors import RecordError
from companion.recording import mcap_schema as channels
from companion.recording.recorder import About, Recorder
from companion.service.replay import flight_summary
from companion.service.replay.flight_summary import flight_of
from companion.service.replay.frames_record import FROM_TLOG, ON_BOARD
from companion.types.events import Dialect
from companion.ui.reports.plots import flight_start
from sim.flight_record import record_of
from tests.sim.client import CONFIGS
from tests.support.recorded import recorded

pytestmark = pytest.mark.xdist_group("recorded flights")  # they share flights that are made once a process


@pytest.fixture(scope="module")
def flown():
    return recorded("first-flight", 3, Dialect.PX4)


def test_of_a_flight_beyond_the_longest_the_rows_are_counted_that_are_left_out(monkeypatch):
    monkeypatch.setattr(flight_summary, "ROWS_MAX", 3)
    told = flight_summary._ReportData(Counter())
    for second in range(5):
        told.take(channels.THREAT, {"stamp_s": float(second), "level": 0.5})
    assert [stamp_s for stamp_s, _ in told.threat] == [0.0, 1.0, 2.0]
    assert told.counters == {"beyond_the_longest_flight": 2}


def test_what_was_left_on_board_and_what_home_needed_of_it():
    told = flight_summary._ReportData(Counter())
    rows = [(1.0, 40.0, 21.0), (2.0, 39.0, None), (3.0, None, 5.0)]
    for stamp_s, left_wh, margin_wh in rows:
        told.take(channels.ENERGY, {"stamp_s": stamp_s, "left_wh": left_wh, "margin_wh": margin_wh})
    np.testing.assert_array_equal(told.energy, [[1.0, 40.0, 19.0], [2.0, 39.0, np.nan]])


def test_it_shows_what_the_service_knew(flown):
    folder, flight = flown
    mission, world, record = flight_of(folder)
    known = flight.recorder.record({})
    assert mission == flight.mission
    assert [entry.name for entry in world.obstacle_list] == ["wall"]
    np.testing.assert_allclose(record.flown, known.flown, atol=1e-6)
    np.testing.assert_allclose(record.threat, known.threat, atol=1e-6)
    assert [track.shape for track in record.dt_tracks] == [track.shape for track in known.dt_tracks]
    told = [(round(entry.stamp_s, 6), entry.kind, entry.text) for entry in known.decisions]
    assert [(entry.stamp_s, entry.kind, entry.text) for entry in record.decisions] == told
    assert record.plan_ms == pytest.approx(known.plan_ms)
    assert len(record.missions) == len(known.missions) == record.summary["missions_entered"]
    np.testing.assert_allclose(record.missions[0].positions_enu_m, known.missions[0].positions_enu_m)
    assert record.dt_paths == ()
    assert record.note == ON_BOARD


def test_it_answers_why_it_replanned(flown, companion_command):
    folder, flight = flown
    extended = next(entry for entry in flight.recorder.decisions if entry.text.startswith("extend, cost"))
    assert companion_command("report", folder).code == 0
    assert not (folder / "report.html").exists()  # there would be the simulator's, which knows more
    page = (folder / "report-on-board.html").read_text(encoding="utf-8")
    row = next(row for row in page.split("<tr>") if "extend, cost" in row)
    assert f"00:00:{int(extended.stamp_s):02}" in row  # the simulated day begins at midnight, UTC
    assert "15 s since the last plan" in row
    assert "carried min 22.5 s" in row
    assert ON_BOARD in page


def test_from_a_tlog_alone_it_shows_the_flight_and_what_was_told(flown, tmp_path):
    folder, flight = flown
    for name in ("flight.tlog", "mission.yaml"):
        shutil.copy(folder / name, tmp_path)
    _, _, record = flight_of(tmp_path)
    assert FROM_TLOG in record.note
    known = flight.recorder.record({}).flown
    assert len(record.flown) > 0.9 * len(known)
    np.testing.assert_allclose(record.flown[-1, 1:4], known[-1, 1:4], atol=15.0)
    told = [(entry.kind, entry.told) for entry in flight.recorder.decisions if entry.told]
    assert [(entry.kind, entry.told) for entry in record.decisions] == told


def test_a_recording_that_was_cut_off_is_reported_as_far_as_it_goes(flown, tmp_path):
    folder, _ = flown
    whole = (folder / "flight.mcap").read_bytes()
    (tmp_path / "flight.mcap").write_bytes(whole[: len(whole) // 2])
    _, _, record = flight_of(tmp_path)
    assert 5.0 < record.flown[-1, 0] < 55.0
    assert record.summary["mcap_ends_early"] == 1


def test_instants_are_those_of_the_decisions(flown):
    """The simulator's report and this one count from the same instant."""
    folder, flight = flown
    _, _, record = flight_of(folder)
    assert flight_start(record) == pytest.approx(flight_start(record_of(flight)), abs=0.05)


def test_a_recording_in_which_nothing_was_flown_is_named(tmp_path, companion_command):
    recorder = Recorder(tmp_path, about=About(load_mission(CONFIGS / "first-flight.yaml"), 1))
    recorder.begin(0.0)
    recorder.close()
    done = companion_command("report", tmp_path)
    assert done.code == 2
    assert "nothing was flown" in done.err


def test_a_folder_without_a_flight_is_named(tmp_path, companion_command):
    with pytest.raises(RecordError, match=r"neither flight\.mcap nor flight\.tlog"):
        flight_of(tmp_path)
    done = companion_command("report", tmp_path)
    assert done.code == 2
    assert tmp_path.name in done.err
