"""What survives a restart, and what of it is believed."""

import numpy as np

from companion.flight.checkpoint import Checkpoint, key_of
from tests.mission.made import item, path_along

GOALS = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]


def test_goals_are_remembered_of_their_own_list_only(tmp_path):
    memory = Checkpoint(tmp_path / "flight")
    assert memory.reached(GOALS) == 0
    memory.note_reached(GOALS, 1)
    assert memory.reached(GOALS) == 1
    assert memory.reached(GOALS[:1]) == 0
    assert Checkpoint(tmp_path / "flight").reached(GOALS) == 1
    (tmp_path / "flight.goals.json").write_text("{broken")
    assert Checkpoint(tmp_path / "flight").reached(GOALS) == 0


def test_the_path_is_remembered_of_its_own_mission_only(tmp_path):
    memory, path = Checkpoint(tmp_path / "flight"), path_along((500.0, 20))
    key = key_of([item(1), item(2)])
    assert memory.flown(key) is None
    memory.note_flown(key, path, 12.5)
    for again in (memory, Checkpoint(tmp_path / "flight"), Checkpoint(kept=memory.kept)):
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


def test_a_place_that_cannot_be_written_costs_the_memory_of_a_restart_and_not_the_flight(tmp_path, caplog):
    (tmp_path / "a file").write_text("")
    memory = Checkpoint(tmp_path / "a file" / "flight")
    memory.note_reached(GOALS, 1)
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    assert caplog.text.count("not remembered") == 2
    assert Checkpoint(tmp_path / "a file" / "flight").kept == {}


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
    assert (memory.reached(GOALS), memory.flown(1), dict(memory.kept)) == (0, None, {})
    memory.forget()  # nothing is left to forget


def test_how_long_the_autopilot_had_run_is_remembered_with_the_goals(tmp_path):
    memory = Checkpoint(tmp_path / "flight")
    assert memory.boot_s == 0.0
    memory.note_reached(GOALS, 1, 321.5)
    assert Checkpoint(tmp_path / "flight").boot_s == 321.5
    assert Checkpoint(kept={".goals.json": b"[]"}).boot_s == 0.0
