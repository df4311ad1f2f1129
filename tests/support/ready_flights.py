"""Flights in a process in which nothing can be compiled: ``python -m tests.support.ready_flights``.

In a process of its own, since what was compiled stays with a process.
"""

import json
import sys
from dataclasses import replace

from companion.config import mission_from_text
from companion.flight.replanning.plan_maker import Planner, least_threat_request
from companion.flight.state.modes import Mode
from companion.flight.state.progress import start_by_motion
from companion.kernels.native.kernel import refuse_compiling
from companion.kernels.native.ready import make_ready
from companion.types.events import Dialect
from tests.flight.replanning.test_surprise import ahead, sighted
from tests.flight.test_app import at, both, switch
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

PARKED = "east_m: 950, north_m: 750, speed_m_s: 0, max_threat_radius_m: 250"
PURSUES = "east_m: 1500, north_m: 200, speed_m_s: 10, max_threat_radius_m: 100"
WIND = "wind_speed_m_s: 3"


def pop_up(harness):
    """A vehicle appears ahead, in the way."""
    sighted(harness, ahead(harness))


def emergency(harness):
    """A plan for an emergency, from where the flight began."""
    flight, place = harness.flight, harness.flight.mission.start
    own = flight.app.world_model.ownship.state(flight.now_s)
    own = replace(own, position_enu_m=(float(place.east_m), float(place.north_m), float(place.up_m)))
    start = start_by_motion(flight.app.state.rules, own, 2.0)
    request = least_threat_request(flight.app.state, start, flight.app.world_model.snapshot(flight.now_s))
    Planner(1).plan(replace(request, goals=flight.app.state.goals), lambda: False)


# By name: mission file, what is other in it, the autopilot, how many seconds [s], and what happens.
FLIGHTS = {
    "in the plane": ("first-flight", (), Dialect.ARDUPILOT, 100.0, ()),
    "in space": ("paper-3d", (), Dialect.ARDUPILOT, 60.0, ()),
    "two pursuers": ("two-pursuers", (), Dialect.ARDUPILOT, 60.0, ()),
    "pursued from aside": ("first-flight", ((PARKED, PURSUES),), Dialect.ARDUPILOT, 100.0, ()),
    "radars and hills": ("radar-valley", (), Dialect.ARDUPILOT, 40.0, ()),
    "in strong wind": ("first-flight", ((WIND, "wind_speed_m_s: 9"),), Dialect.ARDUPILOT, 60.0, ()),
    "PX4": ("first-flight", (), Dialect.PX4, 60.0, ()),
    "surprised": ("first-flight", (), Dialect.ARDUPILOT, 40.0, (at(15.0, pop_up),)),
    "handed back": (
        "first-flight", (), Dialect.ARDUPILOT, 60.0, (switch(15.0, "LOITER"), switch(30.0, "AUTO")),
    ),
}  # fmt: skip


def flown(kind):
    """Fly one of them; how many plans were made, and what was decided."""
    name, changes, dialect, until_s, events = FLIGHTS[kind]
    text = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    harness = SitlHarness(mission_from_text(text, f"{name}.yaml"), dialect=dialect)

    def look(harness):
        harness.is_over = harness.app.mode is Mode.ARRIVED

    harness.fly(until_s, both(look, *events))
    emergency(harness)
    return len(harness.recorder.plan_ms), sorted({entry.kind for entry in harness.recorder.decisions})


def main():
    """Have the kernels ready, refuse to compile, and fly them all."""
    make_ready()
    refuse_compiling()
    json.dump({kind: (*flown(kind), "numba" in sys.modules) for kind in FLIGHTS}, sys.stdout)


if __name__ == "__main__":
    main()
