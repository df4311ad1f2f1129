"""Where an operator has put home and rally points of a simulated autopilot."""

from dataclasses import replace

from companion.types.events import Dialect
from companion.types.mission import MavFrame, MissionItem
from sim.autopilot.px4.px4_store import stored
from sim.mission_types import MissionKind

RALLY_POINT = 5100


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
        items.append(MissionItem(number, RALLY_POINT, frame, (0.0,) * 4, *place, up))
    if harness.flight.dialect is Dialect.PX4:
        autopilot.switch(MissionKind.RALLY, stored(items), None)
        return
    autopilot.store.truncate(MissionKind.RALLY, 0)
    for item in items:
        autopilot.store.put(MissionKind.RALLY, item)
