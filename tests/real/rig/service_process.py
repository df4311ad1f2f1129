"""The service as the process that it is, started, killed and started again."""

import json
import os
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path

ROOT = Path(__file__).parents[3]
PATIENCE_S = 900.0  # kernels may have to be compiled


def entries_of(path):
    """Lines of a log in JSON, with their time in seconds since the epoch."""
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        entry["stamp_s"] = datetime.fromisoformat(entry["time"]).timestamp()
        yield entry


class ServiceProcess:
    """``companion run``, as often as it is started.

    Parameters
    ----------
    folder : Path
        Of the mission file, the logs and the recordings.
    port : int
        On which it listens.
    """

    def __init__(self, folder, port):
        self.folder, self.port = folder, port
        self.process = None
        self.num_starts = 0

    @property
    def log(self):
        return self.folder / f"service-{self.num_starts}.log"

    @property
    def logs(self):
        return sorted(self.folder.glob("service-*.log"))

    def start(self):
        self.num_starts += 1
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [
                    sys.executable, "-m", "companion", "run", str(self.folder / "mission.yaml"),
                    "--link", f"udpin://127.0.0.1:{self.port}", "--record", str(self.folder / "recordings"),
                    "--log", "json",
                ],
                env={**os.environ, "PYTHONPATH": str(ROOT)}, cwd=ROOT, stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=log,
            )  # fmt: skip

    def is_running(self):
        return self.process is not None and self.process.poll() is None

    def decisions(self, kind=None):
        """What was decided so far, over all starts."""
        entries = [entry for log in self.logs for entry in entries_of(log)]
        return [entry for entry in entries if entry.get("decision", "") == kind or kind is None]

    def wait_ready(self):
        """Wait until its kernels are there."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            assert self.is_running(), self.log.read_text()[-2000:]
            if any(entry["message"] == "ready to plan" for entry in entries_of(self.log)):
                return
            time.sleep(0.2)
        raise AssertionError("the service did not become ready")

    def kill(self):
        """As a crash, or a loss of power."""
        if self.is_running():
            self.process.kill()
            self.process.wait()

    def stop(self):
        """In order."""
        if self.is_running():
            self.process.terminate()
            try:
                self.process.wait(10.0)
            except subprocess.TimeoutExpired:
                self.kill()
