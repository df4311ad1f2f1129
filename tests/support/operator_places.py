"""Where an operator has put home and rally points of a simulated autopilot."""

from dataclasses import replace

from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from sim.autopilot.px4.px4_store import stored
from sim.mission_types import MissionKind


def home_at(harness, east_m, north_m):
    """Move home, before anything of it is told."""
    autopilot = harness.simulator.autopilot
    latitude, longitude = autopilot.projection.degrees(east_m, north_m)
    home = replace(
        autopilot.home, east_m=east_m, north_m=north_m, latitude_e7=round(latitude * 1e7),
        longitude_e7=round(longitude * 1e7),
    )  # fmt: skip
    autopilot.home = autopilot.telemetry._home = home


def rally_points(harness, *places, frame=MavFrame.GLOBAL_RELATIVE_ALT):
    """Put rally points into the autopilot: east, north, height above home [m]."""
    autopilot = harness.simulator.autopilot
    items = []
    for number, (east, north, up) in enumerate(places):
        latitude, longitude = autopilot.projection.degrees(east, north)
        place = round(latitude * 1e7), round(longitude * 1e7)
        items.append(MissionItem(number, Command.NAV_RALLY_POINT, frame, (0.0,) * 4, *place, up))
    put(harness, MissionKind.RALLY, items)


def put(harness, kind, items):
    """Put a list into the autopilot, as if it had been uploaded."""
    autopilot = harness.simulator.autopilot
    if harness.flight.dialect is Dialect.PX4:
        autopilot.switch(kind, stored(items), None)
        return
    autopilot.store.truncate(kind, 0)
    for item in items:
        autopilot.store.put(kind, item)
