"""Campaigns run, killed, resumed, in one process and in several: the rows are the same."""

import contextlib
import io
import os
import random
import signal
import sqlite3
import subprocess
import sys

import pytest
from rich.console import Console

from companion import run_places
from companion.errors import CompanionError, ConfigError, RecordError
from companion.research.campaign.campaign_progress import run_campaign
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.run_store import DATABASE, RunStore
from tests.cli.calls import FIRST_FLIGHT
from tests.sim.client import CONFIGS

ROOT = CONFIGS.parent
HERE = "tests.research.campaign.made_runs"
SPEC = f"""\
name: small
kind: plans
missions: [{FIRST_FLIGHT}]
methods: [safe-rrt, rrt]
seeds: 30
"""
LIMIT_S = 120.0
REPEATABLE = (
    "number", "mission", "mission_sha256", "setting", "method", "seed", "error", "measures", "paths"
)  # fmt: skip


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC, encoding="utf-8")
    return path


@pytest.fixture
def made_by(monkeypatch):
    def offered(name):
        monkeypatch.setitem(run_places._PLACES, "plans", f"{HERE}:{name}")

    return offered


def run(file, folder, jobs=1, resumes=False):
    console = Console(file=io.StringIO())
    return run_campaign(load_campaign(file), folder, jobs=jobs, resumes=resumes, console=console)


def repeatable(folder):
    """The rows, without what depends on time and place."""
    with sqlite3.connect(folder / DATABASE) as connection:
        rows = connection.execute(f"SELECT {', '.join(REPEATABLE)} FROM runs ORDER BY number").fetchall()
    connection.close()
    return rows


def test_one_process_and_two_give_the_same_rows(file, made_by, tmp_path):
    made_by("Quick")
    one, two = run(file, tmp_path / "one"), run(file, tmp_path / "two", jobs=2)
    assert (one.num_rows, one.num_made, one.num_errors) == (60, 60, 10) == (
        two.num_rows, two.num_made, two.num_errors,
    )  # fmt: skip
    assert repeatable(tmp_path / "one") == repeatable(tmp_path / "two")


def test_a_fault_is_a_row_and_what_is_no_number_was_not_measured(file, made_by, tmp_path):
    made_by("Quick")
    run(file, tmp_path / "out")
    store = RunStore.to_read(tmp_path / "out")
    rows = list(store.rows())
    store.close()
    faults = {row.seed: row.error for row in rows if row.error is not None}
    assert faults.keys() == set(range(3, 31, 3))
    assert faults[6] == "ValueError: no plan of seed 6 (made_runs.py, outcome)"
    good = next(row for row in rows if row.error is None)
    assert good.measures["Q"] is None
    assert 0.0 <= good.measures["PC"] <= 100.0
    assert good.measures["PST"] > 0.0
    assert "cores" in good.machine


@pytest.mark.thorough
def test_a_run_that_takes_its_process_with_it_is_tried_twice_and_then_a_row(file, made_by, tmp_path):
    made_by("Deadly")
    file.write_text(SPEC.replace("safe-rrt, ", "").replace("seeds: 30", "seeds: 5"), encoding="utf-8")
    done = run(file, tmp_path / "out", jobs=2)
    assert done.num_made == 5
    with sqlite3.connect(tmp_path / "out" / DATABASE) as connection:
        chosen = "SELECT seed, error, attempts FROM runs WHERE attempts > 1 ORDER BY number"
        rows = connection.execute(chosen).fetchall()
    connection.close()
    died = "the process that made it was ended by signal 9"
    left = "the process that made it ended with code 7"
    assert rows == [("2", died, 2), ("3", left, 2)]


def test_processes_that_never_get_ready_end_the_campaign(file, made_by, tmp_path):
    made_by("Unready")
    with pytest.raises(CompanionError, match="could not get ready for the campaign: it ended with code 5"):
        run(file, tmp_path / "out")


def test_rows_are_not_added_to_without_being_asked_nor_to_another_campaign(file, made_by, tmp_path):
    made_by("Quick")
    file.write_text(SPEC.replace("seeds: 30", "seeds: 2"), encoding="utf-8")
    run(file, tmp_path / "out")
    before = repeatable(tmp_path / "out")
    with pytest.raises(ConfigError, match=r"--out: got 4 rows of 'small'; expected .* --resume"):
        run(file, tmp_path / "out")
    file.write_text(SPEC.replace("seeds: 30", "seeds: 3"), encoding="utf-8")
    with pytest.raises(
        ConfigError, match=r"seeds: got \[1, 2, 3\]; expected \[1, 2\], as the rows in .* have"
    ):
        run(file, tmp_path / "out", resumes=True)
    assert repeatable(tmp_path / "out") == before
    file.write_text(SPEC.replace("seeds: 30", "seeds: 2"), encoding="utf-8")
    assert run(file, tmp_path / "out", resumes=True).num_made == 0


def test_two_campaigns_do_not_write_to_one_folder(file, tmp_path):
    campaign = load_campaign(file)
    first = RunStore.to_write(tmp_path / "out", campaign, resumes=False)
    with pytest.raises(ConfigError, match="got a campaign that is running"):
        RunStore.to_write(tmp_path / "out", campaign, resumes=True)
    first.close()
    RunStore.to_write(tmp_path / "out", campaign, resumes=True).close()


def test_a_full_disk_is_told_and_gone_on_from(file, made_by, tmp_path, monkeypatch):
    made_by("Quick")
    run(file, tmp_path / "whole")
    prepare = RunStore._prepare

    def with_little_room(self, *arguments, **named):
        prepare(self, *arguments, **named)
        pages = self._connection.execute("PRAGMA page_count").fetchone()[0]
        self._connection.execute(f"PRAGMA max_page_count = {pages + 2}")

    with monkeypatch.context() as patched:
        patched.setattr(RunStore, "_prepare", with_little_room)
        with pytest.raises(
            RecordError, match=r"full; what was written before is whole: make room, .*--resume"
        ):
            run(file, tmp_path / "out")
    kept = repeatable(tmp_path / "out")
    assert 0 < len(kept) < 60
    assert run(file, tmp_path / "out", resumes=True).num_made == 60 - len(kept)
    assert repeatable(tmp_path / "out") == repeatable(tmp_path / "whole")


def test_a_file_that_is_no_database_is_told(file, tmp_path):
    with pytest.raises(ConfigError, match="nothing of a campaign"):
        RunStore.to_read(tmp_path)
    (tmp_path / DATABASE).write_bytes(b"no database at all, but more than a hundred bytes " * 9)
    with pytest.raises(RecordError, match="not a database"):
        RunStore.to_read(tmp_path)
    with pytest.raises(RecordError, match="not a database"):
        RunStore.to_write(tmp_path, load_campaign(file), resumes=True)


def started(file, folder, place):
    offered = "" if place is None else f"from companion import run_places as r; r.offer('plans', '{place}'); "
    program = f"{offered}from companion.cli import main; main()"
    options = ["--out", str(folder), "--jobs", "2", "--resume"]
    return subprocess.Popen(
        [sys.executable, "-c", program, "campaign", str(file), *options],
        cwd=ROOT, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def ended_by_a_full_disk(file, folder, size):
    """A campaign whose files cannot grow beyond a size, as on a disk that has no more room."""
    program = (
        f"import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size})); "
        f"from companion import run_places as r; r.offer('plans', '{HERE}:Quick'); "
        f"from companion.cli import main; main()"
    )
    return subprocess.run(
        [sys.executable, "-c", program, "campaign", str(file), "--out", str(folder), "--resume"],
        cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_S, check=False,
    )  # fmt: skip


@pytest.mark.slow
def test_a_disk_that_is_really_full_ends_a_campaign_that_goes_on_where_there_is_room(file, tmp_path, made_by):
    made_by("Quick")
    file.write_text(SPEC.replace("seeds: 30", "seeds: 200"), encoding="utf-8")
    done = ended_by_a_full_disk(file, tmp_path / "out", 60_000)
    assert done.returncode == 2, done.stderr
    assert "what was written before is whole" in done.stderr.replace("\n", " ")
    kept = repeatable(tmp_path / "out")
    assert 0 < len(kept) < 400
    assert run(file, tmp_path / "out", resumes=True).num_made == 400 - len(kept)
    run(file, tmp_path / "whole")
    assert repeatable(tmp_path / "out") == repeatable(tmp_path / "whole")


def num_rows(folder):
    try:
        file = f"file:{folder / DATABASE}?mode=ro"
        with contextlib.closing(sqlite3.connect(file, uri=True, timeout=5.0)) as connection:
            return connection.execute("SELECT count(*) FROM runs").fetchone()[0]
    except sqlite3.OperationalError:
        return 0  # it is not made yet


def killed_after(process, folder, rows, only_parent):
    """Kill a campaign, or its first process alone, at so many rows; whether it was still at it."""
    while process.poll() is None and num_rows(folder) < rows:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=0.02)
    was_running = process.poll() is None
    if was_running:
        (os.kill if only_parent else os.killpg)(process.pid, signal.SIGKILL)
    process.wait(timeout=LIMIT_S)
    return was_running


def undisturbed_and_killed(file, tmp_path, place, kills, step):
    rng = random.Random(5)
    calm = started(file, tmp_path / "calm", place)
    assert calm.wait(timeout=10 * LIMIT_S) == 0
    folder, rows, num_kills = tmp_path / "killed", 0, 0
    for kill in range(kills):
        process = started(file, folder, place)
        num_kills += killed_after(process, folder, rows + rng.randint(0, step), kill % 2 == 1)
        rows = num_rows(folder)
    last = started(file, folder, place)
    assert last.wait(timeout=10 * LIMIT_S) == 0
    assert num_kills >= kills - 1
    return repeatable(tmp_path / "calm"), repeatable(folder)


@pytest.mark.slow
def test_a_campaign_killed_ten_times_has_the_rows_of_an_undisturbed_one(file, tmp_path):
    file.write_text(SPEC.replace("seeds: 30", "seeds: 200"), encoding="utf-8")
    calm, killed = undisturbed_and_killed(file, tmp_path, f"{HERE}:Quick", kills=10, step=30)
    assert len(calm) == 400
    assert killed == calm


@pytest.mark.slow
@pytest.mark.compiled
def test_real_plans_killed_three_times_are_those_of_an_undisturbed_campaign(file, tmp_path):
    calm, killed = undisturbed_and_killed(file, tmp_path, None, kills=3, step=12)
    assert len(calm) == 60
    assert not any(row[REPEATABLE.index("error")] for row in calm)
    assert killed == calm
