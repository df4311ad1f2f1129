"""A flight of the service itself, by the computer's clock and over TCP, replayed by the command."""

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.cli.calls import Caller
from tests.sim.client import CONFIGS

MISSION = CONFIGS / "first-flight.yaml"
ROOT = Path(__file__).parents[3]
ARRIVES_S = 400.0


def started(*arguments):
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, arguments)], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.slow  # flies a minute in real time
def test_plans_that_the_clock_ended_and_threads_made_come_out_the_same(tmp_path, monkeypatch, capsys):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    service = started("companion", "run", MISSION, "--link", url, "--record", tmp_path)
    simulator = None
    try:
        until, lines = time.monotonic() + ARRIVES_S, []
        for line in service.stderr:
            lines.append(line)
            assert time.monotonic() < until, lines
            if simulator is None and "ready to plan" in line:
                simulator = started("sim", MISSION, "--listen", url)
            if "arrived:" in line:
                break
        service.send_signal(signal.SIGTERM)
        service.communicate(timeout=60)
    finally:
        for process in (service, simulator):
            if process is not None:
                process.kill()
                process.communicate()
    [folder] = tmp_path.glob("2*-first-flight")
    companion = Caller(monkeypatch, capsys)
    done = companion("replay", folder / "flight.tlog", folder / "mission.yaml", "--expect", folder)
    assert done.code == 0, done.out + done.err
    assert " missions" in done.out
