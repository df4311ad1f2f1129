"""A real scheduler and real workers: the rows are those of processes, whoever is killed meanwhile."""

import contextlib
import importlib.util
import io
import signal
import subprocess
import sys
import threading

import pytest
from rich.console import Console

from companion import run_places
from companion.errors import CompanionError
from companion.research.campaign.campaign_progress import run_campaign
from companion.research.campaign.campaign_spec import load_campaign
from companion.research.campaign.run_store import RunStore
from tests.research.campaign.test_campaign_run import HERE, ROOT, SPEC, num_rows, repeatable, run
from tests.service.process.processes import free_port

pytestmark = [
    pytest.mark.slow,
    # Looked for and not imported, which takes a second of every run.
    pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="Dask is not installed"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
LIMIT_S = 60.0


class Cluster:
    """A scheduler and its workers, each a process."""

    def __init__(self):
        self.address = f"tcp://127.0.0.1:{free_port()}"
        port = self.address.rpartition(":")[2]
        self.processes = []
        scheduler = self._started("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self._until(scheduler, "Scheduler at")

    def add_worker(self):
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        worker = self._started("worker", self.address, *options)
        self._until(worker, "Registered to")
        return worker

    def _started(self, kind, *options):
        program = f"from distributed.cli.dask_{kind} import main; main()"
        process = subprocess.Popen(
            [sys.executable, "-c", program, *options],
            cwd=ROOT, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        )  # fmt: skip
        self.processes.append(process)
        return process

    @staticmethod
    def _until(process, words):
        """Read what a process says up to certain words, and the rest beside, so that it never waits."""
        alarm = threading.Timer(LIMIT_S, process.kill)
        alarm.start()
        said = ""
        for line in process.stderr:
            said += line
            if words in line:
                break
        else:
            raise AssertionError(said)
        alarm.cancel()
        threading.Thread(target=process.stderr.read, daemon=True).start()

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()
            process.stderr.close()


@pytest.fixture
def cluster():
    made = Cluster()
    yield made
    made.end()


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setitem(run_places._PLACES, "plans", f"{HERE}:Quick")
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC.replace("seeds: 30", "seeds: 150"), encoding="utf-8")
    return path


def on(cluster, file, folder, resumes=False):
    console = Console(file=io.StringIO())
    return run_campaign(
        load_campaign(file), folder, jobs=1, resumes=resumes, console=console, scheduler=cluster.address
    )


def test_workers_make_the_rows_that_processes_make(cluster, file, tmp_path):
    for _ in range(2):
        cluster.add_worker()
    done = on(cluster, file, tmp_path / "dask")
    here = run(file, tmp_path / "here")
    assert (done.num_made, done.num_errors) == (here.num_made, here.num_errors) == (300, 50)
    assert repeatable(tmp_path / "dask") == repeatable(tmp_path / "here")
    store = RunStore.to_read(tmp_path / "dask")
    assert {"cores" in row.machine for row in store.rows()} == {True}
    store.close()


def test_a_worker_that_is_killed_costs_no_row(cluster, file, tmp_path):
    first = cluster.add_worker()
    cluster.add_worker()
    folder = tmp_path / "killed"

    def kill():
        while num_rows(folder) < 40 and first.poll() is None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                first.wait(timeout=0.02)
        first.send_signal(signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    done = on(cluster, file, folder)
    killer.join()
    assert first.wait() == -signal.SIGKILL
    assert done.num_made == 300
    run(file, tmp_path / "calm")
    assert repeatable(folder) == repeatable(tmp_path / "calm")


def test_what_processes_began_workers_finish(cluster, file, tmp_path, monkeypatch):
    cluster.add_worker()
    folder = tmp_path / "out"
    added, add = [], RunStore.add

    def broken_off(self, over, *more):
        add(self, over, *more)
        added.append(over)
        if len(added) == 100:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(RunStore, "add", broken_off)
        with pytest.raises(KeyboardInterrupt):
            run(file, folder)
    assert num_rows(folder) == 100
    assert on(cluster, file, folder, resumes=True).num_made == 200
    run(file, tmp_path / "calm")
    assert repeatable(folder) == repeatable(tmp_path / "calm")


def test_without_a_scheduler_that_is_told(file, tmp_path, monkeypatch):
    monkeypatch.setattr("companion.research.campaign.engines.dask_engine.CONNECT_S", 1)
    nobody = type("Nobody", (), {"address": f"tcp://127.0.0.1:{free_port()}"})
    with pytest.raises(CompanionError, match="no Dask scheduler at tcp"):
        on(nobody, file, tmp_path / "out")
