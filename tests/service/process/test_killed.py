"""Killed in flight, at random moments: it goes on from what the autopilot flies."""

import json
import math
import random
import sys
import time
from datetime import datetime

import pytest

from tests.service.process.client import Client
from tests.service.process.processes import FIRST_FLIGHT, Manager, free_port, service, simulator

KILLS = 3
SPEED = 1.0  # simulated seconds a second: a start takes its seconds of the computer's time
AUTO = 10
PLANNING = {"restart", "swap", "keep", "rejected", "no plan"}


def mode_flown(port):
    with Client(port) as client:
        return client.hear("HEARTBEAT", lambda message: message.get_srcComponent() == 1).custom_mode


def lines_of(said):
    for line in said.splitlines():
        entry = json.loads(line)
        yield datetime.fromisoformat(entry["time"]).timestamp(), entry.get("decision", ""), entry["message"]


def seconds_to_planning(said):
    """From being ready until the mission is known or a plan was decided on; None if it never was."""
    lines = list(lines_of(said))
    ready_s = next(stamp for stamp, _, message in lines if message == "ready to plan")
    return next((stamp - ready_s for stamp, kind, _ in lines if kind in PLANNING and stamp >= ready_s), None)


@pytest.mark.slow  # more than a minute a flight, in the computer's time
@pytest.mark.parametrize("seed", range(3))
def test_it_goes_on_from_what_the_autopilot_flies_and_reaches_the_goal(tmp_path, seed, record_property):
    port, chance, said = free_port(), random.Random(seed), []
    with simulator(port, FIRST_FLIGHT, SPEED):
        for turn in range(KILLS + 1):
            manager = Manager()
            with service(port, tmp_path, "--log", "json", environment=manager.environment) as running:
                manager.hear_until(lambda words: "READY" in words)
                if turn < KILLS:
                    end_s = time.monotonic() + chance.uniform(1.0, 5.0)
                    while (left_s := end_s - time.monotonic()) > 0.0:
                        manager.hear(left_s)
                    running.kill()
                    said.append(running.communicate()[0])
                    assert mode_flown(port) == AUTO
                else:
                    manager.hear_until(lambda words: words.get("STATUS", "").startswith("arrived"))
                    running.terminate()
                    said.append(running.communicate()[0])
            manager.close()
    decisions = [[kind for _, kind, _ in lines_of(output)] for output in said]
    first = next(turn for turn, kinds in enumerate(decisions) if "swap" in kinds)
    assert all("restart" in kinds for kinds in decisions[first + 1 :]), decisions
    assert "arrived" in decisions[-1]
    record_property("seconds_to_planning", [seconds_to_planning(output) for output in said])
    sys.stdout.write(f"\nseed {seed}: seconds from ready to planning at each start: ")
    sys.stdout.write(", ".join(f"{seconds_to_planning(output) or math.nan:.2f}" for output in said) + "\n")
