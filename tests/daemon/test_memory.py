"""What survives a restart, and what of it is believed."""

import numpy as np

from companion.daemon.memory import Memory, key_of
from tests.mission.made import item, path_along

GOALS = [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]


def test_goals_are_remembered_of_their_own_list_only(tmp_path):
    memory = Memory(tmp_path / "flight")
    assert memory.reached(GOALS) == 0
    memory.note_reached(GOALS, 1)
    assert memory.reached(GOALS) == 1
    assert memory.reached(GOALS[:1]) == 0
    (tmp_path / "flight.goals.json").write_text("{broken")
    assert memory.reached(GOALS) == 0


def test_the_path_is_remembered_of_its_own_mission_only(tmp_path):
    memory, path = Memory(tmp_path / "flight"), path_along((500.0, 20))
    key = key_of([item(1), item(2)])
    assert memory.flown(key) is None
    memory.note_flown(key, path, 12.5)
    kept, until_s = memory.flown(key)
    assert until_s == 12.5
    for name in path.__slots__:
        np.testing.assert_array_equal(getattr(kept, name), getattr(path, name))
    assert memory.flown(key_of([item(1), item(3)])) is None


def test_what_was_cut_off_counts_for_nothing(tmp_path):
    memory = Memory(tmp_path / "flight")
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    file = tmp_path / "flight.flown.npz"
    for length in (0, 10, 200, len(file.read_bytes()) // 2):
        data = file.read_bytes()
        file.write_bytes(data[:length])
        assert memory.flown(1) is None
        file.write_bytes(data)


def test_a_place_that_cannot_be_written_costs_the_memory_and_not_the_flight(tmp_path):
    (tmp_path / "a file").write_text("")
    memory = Memory(tmp_path / "a file" / "flight")
    memory.note_reached(GOALS, 1)
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    assert memory.reached(GOALS) == 0
    assert memory.flown(1) is None


def test_nowhere_to_remember():
    memory = Memory(None)
    memory.note_reached(GOALS, 1)
    memory.note_flown(1, path_along((500.0, 20)), 12.5)
    assert (memory.reached(GOALS), memory.flown(1)) == (0, None)
