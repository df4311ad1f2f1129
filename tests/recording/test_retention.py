"""The oldest flights go first, and nothing but flights."""

import os

from companion.recording.retention import NEWS_S, prune

NOW_S = 1_800_000_000.0


def flight(flights, name, size=1_000, age_s=3_600.0, tlog=True):
    folder = flights / name
    folder.mkdir(parents=True)
    for file, length in (("flight.tlog" if tlog else "notes.txt", size), ("mission.yaml", 0)):
        (folder / file).write_bytes(bytes(length))
        os.utime(folder / file, (NOW_S - age_s, NOW_S - age_s))
    return folder


def test_the_oldest_go_until_the_rest_fits(tmp_path):
    made = [flight(tmp_path, f"2026010{day}T000000Z-a") for day in range(1, 6)]
    assert prune(tmp_path, 2_500, made[-1], NOW_S) == made[:3]
    assert sorted(tmp_path.iterdir()) == made[3:]
    assert prune(tmp_path, 2_500, made[-1], NOW_S) == []


def test_the_running_one_stays_though_it_alone_is_too_large(tmp_path):
    old = flight(tmp_path, "20260101T000000Z-a")
    running = flight(tmp_path, "20260102T000000Z-a", size=10_000)
    assert prune(tmp_path, 5_000, running, NOW_S) == [old]
    assert running.exists()


def test_one_that_is_still_written_to_stays(tmp_path):
    other = flight(tmp_path, "20260101T000000Z-b", age_s=NEWS_S / 2)
    running = flight(tmp_path, "20260102T000000Z-a")
    assert prune(tmp_path, 0, running, NOW_S) == []
    assert other.exists()


def test_what_is_no_flight_is_neither_counted_nor_deleted(tmp_path):
    notes = flight(tmp_path, "20260101T000000Z-notes", tlog=False)
    named = flight(tmp_path, "archive")
    target = flight(tmp_path / "elsewhere", "20260101T000000Z-a")
    (tmp_path / "20260101T000001Z-link").symlink_to(target)
    (tmp_path / "a.goals.json").write_text("{}")
    running = flight(tmp_path, "20260102T000000Z-a")
    assert prune(tmp_path, 0, running, NOW_S) == []
    assert notes.exists()
    assert named.exists()
    assert target.exists()


def test_a_folder_that_cannot_be_read_is_told_and_no_more(tmp_path, caplog):
    assert prune(tmp_path / "nowhere", 0, tmp_path, NOW_S) == []
    assert "cannot be deleted" in caplog.text
