"""Kernels that a flight compiles after all: ``python -m tests.support.signatures MISSION [SECONDS]``.

In a process of its own, since compiled signatures stay with a process.
"""

import importlib
import pkgutil
import sys
from dataclasses import replace

from numba.core.dispatcher import Dispatcher

import companion.kernels
from companion.config import load_mission
from companion.flight.modes import Mode
from companion.flight.progress import start_by_motion
from companion.service.warm_up import warm_up
from companion.tasks.plan_maker import Planner, least_threat_request
from tests.support.sitl_harness import SitlHarness


def compiled():
    """Signatures by kernel, of those that are called from Python."""
    found = {}
    for info in pkgutil.walk_packages(companion.kernels.__path__, "companion.kernels."):
        for value in vars(importlib.import_module(info.name)).values():
            if isinstance(value, Dispatcher):
                found[value.py_func.__qualname__] = set(map(str, value.signatures))
    return found


def emergency(flight):
    """A plan for an emergency, from where the flight began."""
    state, now_s = flight.app.state, flight.now_s
    ownship = flight.app.situation.ownship.state(now_s)
    start = start_by_motion(state.rules, replace(ownship, position_enu_m=place(flight.mission.start)), 2.0)
    request = least_threat_request(state, start, flight.app.situation.snapshot(now_s))
    Planner(1).plan(replace(request, goals=state.goals), lambda: False)


def place(start):
    return float(start.east_m), float(start.north_m), float(start.up_m)


def main():
    """Warm up, fly to the goal or for some seconds, compare."""
    mission = load_mission(sys.argv[1])
    warm_up(mission)
    before = compiled()
    harness = SitlHarness(mission)
    flight = harness.flight

    def look(harness):
        harness.is_over = harness.app.mode is Mode.ARRIVED

    harness.fly(min([flight.limit_s, *map(float, sys.argv[2:])]), look)
    emergency(flight)
    after = compiled()
    late = sorted(name for name in after if after[name] - before[name])
    sys.stdout.write(
        f"{sum(map(bool, before.values()))} kernels, {len(flight.recorder.plan_ms)} plans, late: {late}\n"
    )


if __name__ == "__main__":
    main()
