"""The recorder listens; whatever becomes of the disk, the flight goes on."""

import errno
import logging

import numpy as np
import pytest

from companion.errors import RecordError
from companion.link.wire import tlog
from companion.recording.recorder import TRACK_ROWS_MAX, Recorder
from companion.types.record import UploadedMission
from companion.types.state import Ownship
from companion.types.threat import TrackState
from tests.link.pymavlink_frames import heartbeat

EPOCH_S = 1_767_225_600.0


class FullDisk:
    """A file that takes so many writes and then no more."""

    def __init__(self, path, writes):
        self._file = path.open("ab", buffering=0)
        self._left = writes
        self.is_closed = False

    def write(self, data):
        self._spend()
        return self._file.write(data)

    def flush(self):
        self._spend()

    def close(self):
        self.is_closed = True
        self._file.close()
        self._spend()

    def _spend(self):
        self._left -= 1
        if self._left < 0:
            raise OSError(errno.ENOSPC, "No space left on device")


@pytest.fixture
def full_disk(monkeypatch):
    files = []

    def fill(recorder, writes):
        file = FullDisk(recorder.folder / "flight.tlog", writes)
        files.append(file)
        recorder._tlog._file.close()
        monkeypatch.setattr(recorder._tlog, "_file", file)
        return file

    return fill


def track(identity, east):
    return TrackState(
        1.0, identity, (east, 2.0, 0.0), (0.0, 0.0, 0.0), np.eye(4), 10.0, 250.0, 15.0, False, 1.0
    )


def test_frames_are_written_with_their_time(tmp_path):
    recorder = Recorder(tmp_path / "new" / "flight", EPOCH_S)
    recorder.frame(1.5, heartbeat())
    recorder.frame(2.25, heartbeat(kind=2))
    recorder.close()
    recorder.frame(3.0, heartbeat())  # after the end: nothing, and no complaint
    entries = list(tlog.read_tlog(tmp_path / "new" / "flight" / "flight.tlog"))
    assert [entry.time_s for entry in entries] == [EPOCH_S + 1.5, EPOCH_S + 2.25]
    assert [entry.raw for entry in entries] == [heartbeat(), heartbeat(kind=2)]


def test_a_full_disk_stops_the_recording_and_not_the_flight(tmp_path, full_disk, caplog):
    recorder = Recorder(tmp_path, EPOCH_S)
    file = full_disk(recorder, writes=3)
    with caplog.at_level(logging.ERROR):
        for k in range(20):
            recorder.frame(float(k), heartbeat())
            recorder.decide(float(k), "keep", "as before")
    assert file.is_closed
    assert [message for message in caplog.messages if "recording stopped" in message] == caplog.messages
    assert len(caplog.messages) == 1
    assert "No space left on device" in caplog.text
    assert len(recorder.decisions) == 20
    recorder.close()


def test_a_disk_that_is_full_at_the_end(tmp_path, full_disk, caplog):
    recorder = Recorder(tmp_path, EPOCH_S)
    full_disk(recorder, writes=2)
    recorder.frame(0.0, heartbeat())
    with caplog.at_level(logging.ERROR):
        recorder.close()
    assert "recording stopped" in caplog.text


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="file/flight"):
        Recorder(tmp_path / "file" / "flight")


def test_in_memory_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recorder = Recorder()
    recorder.frame(0.0, heartbeat())
    recorder.close()
    assert list(tmp_path.iterdir()) == []


def test_the_record_has_what_was_noted():
    recorder = Recorder()
    own = Ownship(1.0, (10.0, 20.0, 30.0), 0.5, 0.1, 25.0, 24.0)
    recorder.state(1.0, own, (track("a", 1.0), track("b", 5.0)), 0.25)
    recorder.state(1.2, own, (track("b", 6.0),), 0.5)
    recorder.decide(1.0, "swap", "first plan", 120.0, 900.0)
    recorder.plan_ms.append(120.0)
    recorder.missions.append(UploadedMission(1.0, np.zeros((2, 3)), "first plan"))
    record = recorder.record({"seed": 1})
    np.testing.assert_allclose(record.flown[0], [1.0, 10.0, 20.0, 30.0, 0.5, 0.1, 25.0])
    np.testing.assert_allclose(record.threat, [[1.0, 0.25], [1.2, 0.5]])
    np.testing.assert_allclose(record.dt_tracks[0], [[1.0, 1.0, 2.0]])
    np.testing.assert_allclose(record.dt_tracks[1], [[1.0, 5.0, 2.0], [1.2, 6.0, 2.0]])
    decision = record.decisions[0]
    assert (decision.kind, decision.plan_ms, decision.track_to_mission_ms) == ("swap", 120.0, 900.0)
    assert (record.plan_ms, len(record.missions), record.summary) == ((120.0,), 1, {"seed": 1})


def test_a_record_of_nothing_is_empty():
    record = Recorder().record({})
    assert record.flown.shape == (0, 7)
    assert record.threat.shape == (0, 2)
    assert record.dt_paths == record.dt_tracks == record.decisions == ()


def test_ten_thousand_vehicles_do_not_fill_the_memory():
    recorder = Recorder()
    own = Ownship(1.0, (10.0, 20.0, 30.0), 0.5, 0.1, 25.0, 24.0)
    for step in range(TRACK_ROWS_MAX):
        recorder.state(float(step), own, (track("same", float(step)), track(f"{step % 10_000}", 0.0)), 0.0)
        assert sum(map(len, recorder.tracks.values())) <= TRACK_ROWS_MAX
    stamps = [row[0] for row in recorder.tracks["same"]]
    assert stamps == sorted(stamps)
    assert stamps[0] <= 4.0
    assert stamps[-1] == TRACK_ROWS_MAX - 1.0
