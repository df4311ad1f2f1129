"""What survives a restart, and what of it is believed."""

import io
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from companion.flight.state.checkpoint import Checkpoint, key_of
from tests.mission.made import item, path_along

GOALS = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]


def test_goals_are_remembered_of_their_own_list_only(tmp_path):
    memory = Checkpoint(tmp_path / "flight")
    assert memory.reached(GOALS) == 0
    memory.note_reached(GOALS, 1)
    assert memory.reached(GOALS) == 1
    assert memory.reached(GOALS[:1]) == 0
    assert Checkpoint(tmp_path / "flight").reached(GOALS) == 1


def test_the_path_is_remembered_of_its_own_mission_only(tmp_path):
    memory, path = Checkpoint(tmp_path / "flight"), path_along((500.0, 20))
    key = key_of([item(1), item(2)])
    assert memory.flown(key) is None
    memory.note_flown(key, path, 12.5)
    for again in (memory, Checkpoint(tmp_path / "flight"), Checkpoint(contents=memory.contents)):
        kept, until_s = again.flown(key)
        assert until_s == 12.5
        for name in path.__slots__:
            np.testing.assert_array_equal(getattr(kept, name), getattr(path, name))
    assert memory.flown(key_of([item(1), item(3)])) is None


def test_what_was_cut_off_counts_for_nothing(tmp_path):
    Checkpoint(tmp_path / "flight").note_flown(1, path_along((500.0, 20)), 12.5)
    file = tmp_path / "flight.flown.npz"
    data = file.read_bytes()
    assert Checkpoint(tmp_path / "flight").flown(1) is not None
    for length in (0, 10, 200, len(data) // 2):
        file.write_bytes(data[:length])
        assert Checkpoint(tmp_path / "flight").flown(1) is None
        assert not file.exists()


def good_goals(**changes):
    return json.dumps({"goals": GOALS, "reached": 1, "boot_s": 1.0} | changes).encode()


STRANGE_GOALS = {
    "nothing": b"",
    "a list": b"[]",
    "no text": bytes(range(256)),
    "deep": b"[" * 100_000,
    "no number": good_goals(reached="x"),
    "more than there are": good_goals(reached=3),
    "less than none": good_goals(reached=-1),
    "infinity": good_goals(boot_s=float("inf")),
    "infinitely many": good_goals(reached=float("inf")),
    "five thousand digits": b'{"goals": [], "reached": 0, "boot_s": ' + b"9" * 5_000 + b"}",
    "too many digits for a float": b'{"goals": [[' + b"9" * 400 + b']], "reached": 0, "boot_s": 0}',
    "large": b" " * 5_000_000 + good_goals(),
    "a goal that is none": good_goals(goals=[1]),
}


def told(caplog):
    return [record.getMessage() for record in caplog.records]


@pytest.mark.parametrize("content", STRANGE_GOALS.values(), ids=STRANGE_GOALS)
def test_damaged_goals_are_set_aside_and_told_once(tmp_path, content, caplog):
    file = tmp_path / "flight.goals.json"
    file.write_bytes(content)
    memory = Checkpoint(tmp_path / "flight")
    assert (memory.reached(GOALS), memory.boot_s, dict(memory.contents)) == (0, 0.0, {})
    assert (tmp_path / "flight.goals.json.damaged").read_bytes() == content
    assert [line.startswith(str(file)) and "goals.json.damaged" in line for line in told(caplog)] == [True]
    Checkpoint(tmp_path / "flight").note_reached(GOALS, 1)
    assert Checkpoint(tmp_path / "flight").reached(GOALS) == 1
    assert len(told(caplog)) == 1
    given = Checkpoint(contents={".goals.json": content})
    assert (given.boot_s, given.reached([])) == (0.0, 0)


def archive(**arrays):
    """An npz, compressed, of arrays or of an entry's bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, array in arrays.items():
            entry = io.BytesIO()
            if not isinstance(array, bytes):
                np.save(entry, array)
            file.writestr(f"{name}.npy", array if isinstance(array, bytes) else entry.getvalue())
    return buffer.getvalue()


def flown(**changes):
    path = path_along((500.0, 20))
    arrays = {name: getattr(path, name) for name in path.__slots__}
    return archive(**(arrays | {"key": np.array(1), "until_s": np.array(2.0)} | changes))


def header(text):
    line = text.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(line).to_bytes(2, "little") + line


NUMBERS = "{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }"
STRANGE_PATHS = {
    "nothing": b"",
    "no archive": b"PK\x03\x04" + bytes(100),
    "an array missing": archive(key=np.array(1)),
    "a gigabyte of zeros": lambda: flown(times_s=bytes(2**30)),
    "a terabyte claimed": flown(times_s=header(NUMBERS % 2**37)),
    "less than nothing": flown(times_s=header(NUMBERS % -1)),
    "objects": flown(times_s=header(NUMBERS.replace("<f8", "|O") % 1)),
    "code": flown(times_s=header("__import__('os').abort()")),
    "a deep header": flown(times_s=header("(" * 100)),
    "another version": flown(times_s=b"\x93NUMPY\x02\x00" + bytes(200)),
    "other lengths": flown(times_s=np.zeros(3)),
    "other shapes": flown(positions_enu_m=np.zeros((20, 2))),
    "other kinds": flown(times_s=np.zeros(20, dtype="S8")),
    "places that are none": flown(positions_enu_m=np.full((len(path_along((500.0, 20))), 3), np.nan)),
    "a key that is none": flown(key=np.array([1.0, 2.0])),
    "an end that is none": flown(until_s=np.array(np.inf)),
}


@pytest.mark.parametrize("content", STRANGE_PATHS.values(), ids=STRANGE_PATHS)
def test_a_damaged_path_is_set_aside_and_told_once(tmp_path, content, caplog):
    content = content() if callable(content) else content
    (tmp_path / "flight.flown.npz").write_bytes(content)
    memory = Checkpoint(tmp_path / "flight")
    assert memory.flown(1) is None
    assert (tmp_path / "flight.flown.npz.damaged").read_bytes() == content
    assert len(told(caplog)) == 1
    assert Checkpoint(contents={".flown.npz": content}).flown(1) is None


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_archive_that_is_sound_is_one(tmp_path, order):
    path = path_along((500.0, 20))
    places = np.asarray(path.positions_enu_m, order=order)
    (tmp_path / "flight.flown.npz").write_bytes(flown(positions_enu_m=places))
    kept, until_s = Checkpoint(tmp_path / "flight").flown(1)
    np.testing.assert_array_equal(kept.positions_enu_m, path.positions_enu_m)
    assert until_s == 2.0


def test_a_small_archive_does_not_fill_the_memory(tmp_path):
    code = (
        "import base64, resource, sys\n"
        "from pathlib import Path\n"
        "from companion.flight.state.checkpoint import Checkpoint\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "assert Checkpoint(Path(sys.argv[1])).flown(1) is None\n"
        "sys.stdout.write(str((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024))\n"
    )
    (tmp_path / "flight.flown.npz").write_bytes(flown(times_s=bytes(2**30)))
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "flight")],
        cwd=Path(__file__).parents[3], capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 60


def test_neither_a_pipe_nor_a_link_is_read(tmp_path, caplog):
    os.mkfifo(tmp_path / "flight.goals.json")
    (tmp_path / "sound").write_bytes(flown())
    (tmp_path / "flight.flown.npz").symlink_to(tmp_path / "sound")
    memory = Checkpoint(tmp_path / "flight")
    assert dict(memory.contents) == {}
    assert len(told(caplog)) == 2
    memory.note_reached(GOALS, 1)
    assert Checkpoint(tmp_path / "flight").reached(GOALS) == 1


def test_a_place_that_cannot_be_written_costs_the_memory_of_a_restart_and_not_the_flight(tmp_path, caplog):
    (tmp_path / "a file").write_text("")
    memory = Checkpoint(tmp_path / "a file" / "flight")
    memory.note_reached(GOALS, 1)
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    assert caplog.text.count("cannot be written") == 2
    assert Checkpoint(tmp_path / "a file" / "flight").contents == {}


def test_without_files_a_process_remembers_and_the_next_does_not():
    memory = Checkpoint()
    memory.note_reached(GOALS, 1)
    assert memory.reached(GOALS) == 1
    assert Checkpoint().reached(GOALS) == 0


def test_a_flight_that_is_over_is_forgotten_with_its_files(tmp_path):
    memory = Checkpoint(tmp_path / "flight")
    memory.note_reached(GOALS, 1)
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    assert len(list(tmp_path.iterdir())) == 2
    memory.forget()
    assert list(tmp_path.iterdir()) == []
    assert (memory.reached(GOALS), memory.flown(1), dict(memory.contents)) == (0, None, {})
    memory.forget()  # nothing is left to forget


def test_how_long_the_autopilot_had_run_is_remembered_with_the_goals(tmp_path):
    memory = Checkpoint(tmp_path / "flight")
    assert memory.boot_s == 0.0
    memory.note_reached(GOALS, 1, 321.5)
    assert Checkpoint(tmp_path / "flight").boot_s == 321.5
    assert Checkpoint(contents={".goals.json": b"[]"}).boot_s == 0.0
