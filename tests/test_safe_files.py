"""What the service writes goes where it says, whole, for the right eyes; what it reads has a known size."""

import asyncio
import contextlib
import errno
import os
import threading

import pytest

from companion import safe_files
from companion.config import load_mission
from companion.config.compose import world_of
from companion.config.parameters.pilot_parameters import Parameters
from companion.errors import RecordError
from companion.flight.state.checkpoint import Checkpoint
from companion.link.wire.signing import Timestamps
from companion.link.wire.tlog import TlogWriter
from companion.recording.mcap_writer import FlightLog
from companion.recording.recorder import About, Recorder
from companion.safe_files import (
    StateFile,
    make_folder,
    open_to_write,
    read_file,
    rename_damaged,
    replace_file,
)
from companion.service.process import service
from companion.ui.reports.plots import plot_mission
from tests.sim.client import CONFIGS


@pytest.fixture(autouse=True)
def usual_mask():
    before = os.umask(0o022)
    yield
    os.umask(before)


def mode_of(path):
    return path.stat().st_mode & 0o777


def mission():
    return load_mission(CONFIGS / "first-flight.yaml")


def by_checkpoint(folder):
    Checkpoint(folder / "flight").note_reached([(1.0, 2.0, 3.0)], 1)


def by_parameters(folder):
    parameters = Parameters(mission(), folder / "parameters.json")
    parameters.set("SRRT_ENABLE", 0.0, (255, 190))
    parameters.keep()


def by_times(folder):
    Timestamps(folder / "key.times", lambda: 1.79e9).next()


def by_tlog(folder):
    writer = TlogWriter(folder / "flight.tlog")
    writer.write(1e9, b"frame")
    writer.close()


def by_mcap(folder):
    FlightLog(folder / "flight.mcap", 1e9).close()


def by_recorder(folder):
    Recorder(folder, about=About(mission(), 1)).close()


def by_picture(folder):
    plot_mission(folder / "map.png", mission(), world_of(mission(), none_known=False))


def by_crash_log(folder):
    async def nothing(_):
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOGS_DIRECTORY", str(folder))
        patch.setattr(service, "Service", lambda *_, **__: type("Idle", (), {"run": nothing})())
        asyncio.run(service.serve(None, "", folder))


REPLACED = [  # a file that is written whole, by whom, and the mode it has
    ("flight.goals.json", by_checkpoint, 0o600),
    ("parameters.json", by_parameters, 0o600),
    ("key.times", by_times, 0o600),
    ("mission.yaml", by_recorder, 0o640),
    ("map.png", by_picture, 0o640),
]
GROWING = [("flight.tlog", by_tlog), ("flight.mcap", by_mcap), ("crash.log", by_crash_log)]


@pytest.mark.parametrize(("name", "write", "mode"), REPLACED, ids=[name for name, *_ in REPLACED])
def test_symlinks_in_the_way_are_replaced_and_what_they_lead_to_stays(tmp_path, name, write, mode):
    victim, folder = tmp_path / "victim", tmp_path / "folder"
    folder.mkdir()
    victim.write_text("precious")
    (folder / name).symlink_to(victim)
    (folder / f"{name}.part").symlink_to(victim)
    write(folder)
    assert victim.read_text() == "precious"
    assert not (folder / name).is_symlink()
    assert mode_of(folder / name) == mode
    assert not os.path.lexists(folder / f"{name}.part")


@pytest.mark.parametrize(("name", "write"), GROWING, ids=[name for name, *_ in GROWING])
def test_a_log_is_not_written_through_a_symlink_nor_does_a_pipe_hold_it_up(tmp_path, name, write, caplog):
    victim, folder = tmp_path / "victim", tmp_path / "folder"
    folder.mkdir()
    victim.write_text("precious")
    for plant in (lambda: (folder / name).symlink_to(victim), lambda: os.mkfifo(folder / name)):
        plant()
        with contextlib.suppress(RecordError):
            write(folder)
        assert victim.read_text() == "precious"
        (folder / name).unlink()
    write(folder)
    assert mode_of(folder / name) == 0o640


def test_the_folder_of_a_flight_is_not_for_everybody(tmp_path):
    Recorder(tmp_path / "flights" / "one", about=About(mission(), 1)).close()
    assert mode_of(tmp_path / "flights") == mode_of(tmp_path / "flights" / "one") == 0o750
    tmp_path.chmod(0o755)
    make_folder(tmp_path)
    assert mode_of(tmp_path) == 0o755
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="Not a directory"):
        make_folder(tmp_path / "file")


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    file = tmp_path / "state"
    replace_file(file, b"old")
    synced = []
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(file.read_bytes()))
    replace_file(file, b"new")
    assert (synced, file.read_bytes()) == ([b"old"], b"new")

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(file, b"newer")
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]
    assert file.read_bytes() == b"new"


def test_only_plain_files_of_a_known_size_are_read(tmp_path):
    file = tmp_path / "file"
    file.write_bytes(b"12345")
    assert read_file(file, 5) == b"12345"
    with pytest.raises(OSError, match="More than 4 bytes"):
        read_file(file, 4)
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(OSError, match="Not a plain file"):
            read_file(name, 5, follow=True)
    with pytest.raises(IsADirectoryError):
        read_file(tmp_path, 5)
    (tmp_path / "link").symlink_to(file)
    assert read_file(tmp_path / "link", 5, follow=True) == b"12345"
    with pytest.raises(OSError, match="symbolic links"):
        read_file(tmp_path / "link", 5)


def test_descriptors_are_not_lost_over_what_cannot_be_read(tmp_path):
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(5):
        with pytest.raises(IsADirectoryError):
            read_file(tmp_path, 5)
    assert len(os.listdir("/proc/self/fd")) == before


def test_what_is_open_is_not_inherited(tmp_path):
    with open_to_write(tmp_path / "file") as file:
        assert not os.get_inheritable(file.fileno())


def test_a_damaged_file_is_set_aside(tmp_path):
    file = tmp_path / "state"
    file.write_text("bad")
    (tmp_path / "state.damaged").write_text("worse, of before")
    assert rename_damaged(file) == tmp_path / "state.damaged"
    assert [entry.read_text() for entry in tmp_path.iterdir()] == ["bad"]
    assert rename_damaged(file) is None


def test_a_slow_disk_holds_up_nobody_and_only_the_newest_content_is_written(tmp_path, monkeypatch):
    free, written = threading.Event(), []

    def slow(path, data):
        free.wait(10.0)
        written.append(data)
        replace_file(path, data)

    monkeypatch.setattr(safe_files, "replace_file", slow)
    file = StateFile(tmp_path / "state", pytest.fail, is_threaded=True)
    for number in range(5):
        file.replace(b"%d" % number)
    assert written == []
    free.set()
    file.wait()
    assert (tmp_path / "state").read_bytes() == b"4"
    assert written in ([b"4"], [b"0", b"4"])  # The first may have begun.
    file.replace(b"")
    file.wait()
    assert not (tmp_path / "state").exists()


def test_what_a_thread_cannot_write_is_told(tmp_path):
    (tmp_path / "a file").write_text("")
    failures = []
    file = StateFile(tmp_path / "a file" / "state", failures.append, is_threaded=True)
    file.replace(b"content")
    file.wait()
    assert [type(error) for error in failures] == [NotADirectoryError]
