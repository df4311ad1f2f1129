"""A return to launch in the simulator, and the judge of what became of it.

The judge knows nothing of the service: it sees the true track, the map's obstacles and the fences in the
autopilot, and where the return was said to end.
"""

import asyncio
import json
import math
from dataclasses import asdict, dataclass

import numpy as np
from shapely.geometry import LineString, Point, Polygon

from companion.clock import ManualClock
from companion.config import load_mission, mission_from_text
from companion.flight.tasks.app import stop
from companion.link.wire.memory_transport import MemoryTransport
from companion.types.events import Dialect
from companion.types.mission import Command, MavFrame, MissionItem
from sim.mission_types import MissionKind
from tests.sim.client import CONFIGS, PLAIN
from tests.support.operator_places import put
from tests.support.sitl_harness import SitlHarness

SHIPPED = ("paper-2d", "paper-3d", "valley", "city-block", "radar-valley")
SIDE_M = 3000.0
FENCE_OUT = 5004  # NAV_FENCE_CIRCLE_EXCLUSION
STRAIGHT = {Dialect.ARDUPILOT: ("RTL_AUTOLAND", 0.0), Dialect.PX4: ("RTL_TYPE", 0.0)}
BY_PATH = {Dialect.ARDUPILOT: ("RTL_AUTOLAND", 4.0), Dialect.PX4: ("RTL_TYPE", 2.0)}
MISSION_MODES = ("AUTO", "MISSION")
BEGINS_S = (15.0, 90.0)  # When the return begins.
RETURN_MAX_S = 700.0
CIRCLED_S = 60.0  # A circle is held for so long before the flight is over.
PLACES = (Command.NAV_WAYPOINT, Command.NAV_LAND, Command.NAV_LOITER_TO_ALT)
NO_FENCE_M = 150.0  # No fence is so near to the operator's landing.
NEAR_M = 60.0  # A circle or touchdown this near to where it was said is there.


@dataclass
class ReturnFlight:
    """What became of one return."""

    seed: int
    world: str
    dialect: str
    begun_s: float
    is_killed: bool
    is_with_path: bool
    has_path: bool = False
    touched: str = ""
    crossed: str = ""
    ended: str = ""
    clearance_m: float = math.inf
    lasted_s: float = 0.0
    was_flying: bool = True


def random_world(rng):
    """A mission on a random map in the plane or in space, with wind."""
    boxes = []
    for number in range(int(rng.integers(5, 16))):
        width, height = rng.uniform(80.0, 450.0, 2)
        west, south = rng.uniform(0.0, SIDE_M - width), rng.uniform(0.0, SIDE_M - height)
        middle, radius = (west + 0.5 * width, south + 0.5 * height), 0.5 * math.hypot(width, height)
        ends = (300.0, 300.0), (SIDE_M - 250.0, SIDE_M - 250.0)
        if min(math.dist(middle, end) for end in ends) < radius + 300.0:
            continue
        corners = [(0, 0), (width, 0), (width, height), (0, height)]
        polygon = [[round(float(west + x), 1), round(float(south + y), 1)] for x, y in corners]
        top = round(float(rng.uniform(90.0, 500.0)), 1)
        boxes.append(f"  - {{name: box_{number}, polygon_enu_m: {polygon}, base_m: 0, top_m: {top}}}")
    is_space = rng.random() < 0.5
    text = PLAIN.replace("dimension: 2", "dimension: 3") if is_space else PLAIN
    replaced = ("bounds", "start", "goals", "  - {east")
    lines = [line for line in text.splitlines() if not line.startswith(replaced)]
    up = "[60, 450]" if is_space else "[0, 400]"
    lines += [
        f"bounds: {{east_m: [0, {SIDE_M:g}], north_m: [0, {SIDE_M:g}], up_m: {up}}}",
        "start: {east_m: 300, north_m: 300, up_m: 120, course_deg: 45}",
        "goals:",
        f"  - {{east_m: {SIDE_M - 250:g}, north_m: {SIDE_M - 250:g}, up_m: 120, acceptance_radius_m: 60}}",
        "obstacles:", *boxes,
        f"simulation: {{wind_speed_m_s: {rng.uniform(0.0, 8.0):.1f}, "
        f"wind_from_deg: {rng.uniform(0.0, 359.0):.0f}, turbulence: light}}",
    ]  # fmt: skip
    return mission_from_text("\n".join(lines) + "\n", "random.yaml")


def scenario(seed):
    """Mission, world's name, dialect, begin of the return [s], whether the service is killed, and fences."""
    rng = np.random.default_rng(seed)
    dialect = list(Dialect)[seed % 2]
    name = SHIPPED[int(rng.integers(len(SHIPPED)))] if rng.random() < 0.4 else "random"
    mission = load_mission(CONFIGS / f"{name}.yaml") if name != "random" else random_world(rng)
    begun_s, is_killed = float(rng.uniform(*BEGINS_S)), bool(seed // 2 % 2)
    return mission, name, dialect, begun_s, is_killed, fences(mission, rng)


def fences(mission, rng):
    """Up to two circles to stay out of, east, north, radius [m], away from both ends and from obstacles."""
    found = []
    walls = [Polygon(entry.polygon_enu_m) for entry in mission.obstacle_list]
    start, goal = mission.start, mission.goals[-1]
    (west, east), (south, north) = mission.bounds.east_m, mission.bounds.north_m
    for _ in range(int(rng.integers(0, 3))):
        centre = float(rng.uniform(west, east)), float(rng.uniform(south, north))
        radius = float(rng.uniform(60.0, 180.0))
        ends = ((start.east_m, start.north_m), (goal.east_m, goal.north_m))
        away = min(math.dist(centre, (float(x), float(y))) for x, y in ends)
        gap = min((wall.distance(Point(centre)) for wall in walls), default=math.inf)
        if away > radius + 700.0 and gap > radius + 250.0:
            found.append((*centre, radius))
    return found


def set_fences(harness, circles):
    """Put the circles into the autopilot."""
    degrees = harness.simulator.autopilot.projection.degrees
    items = []
    for number, (east, north, radius) in enumerate(circles):
        latitude, longitude = degrees(east, north)
        place = round(latitude * 1e7), round(longitude * 1e7), 0.0
        frame = MavFrame.GLOBAL_RELATIVE_ALT
        items.append(MissionItem(number, FENCE_OUT, frame, (radius, 0.0, 0.0, 0.0), *place))
    if items:
        put(harness, MissionKind.FENCE, items)


def fly(seed, *, is_with_path=True, autoland=4, begun_s=None):
    """Fly one seed with this RTL_AUTOLAND if it is an ArduPlane, and return at a chosen time if one is given.

    ``is_with_path`` false: the autopilot returns straight, as without the service.
    """
    mission, name, dialect, drawn_s, is_killed, circles = scenario(seed)
    begun_s = begun_s or drawn_s
    harness = SitlHarness(mission, seed=seed, dialect=dialect)
    parameter, value = (BY_PATH if is_with_path else STRAIGHT)[dialect]
    is_chosen = is_with_path and dialect is Dialect.ARDUPILOT
    harness.simulator.autopilot.parameters[parameter] = float(autoland) if is_chosen else value
    circles = [circle for circle in circles if not _holds_landing(harness, circle)]
    set_fences(harness, circles)
    flight = ReturnFlight(seed, name, dialect.value, begun_s, is_killed, is_with_path)
    asyncio.run(_flown(harness, flight))
    _judge(harness, flight, circles)
    return flight


def _holds_landing(harness, circle):
    """Whether a fence is too near to an item of the operator's: nobody draws one over his landing."""
    east, north, radius = circle
    autopilot = harness.simulator.autopilot
    items = (item for item in autopilot.mission_items if item.command in PLACES)
    places = [autopilot._position(item) for item in items]
    return any(math.dist((east, north), place[:2]) < radius + NO_FENCE_M for place in places)


async def _flown(harness, flight):
    """Fly up to the return, and until it is over."""
    clock = ManualClock()
    ours, theirs = MemoryTransport.pair()
    theirs.set_receiver(harness._receive)
    await theirs.open()
    running = harness._started(ours, clock)
    autopilot, is_alive = harness.simulator.autopilot, True
    try:
        while harness.now_s < flight.begun_s and not harness.simulator.truth.collision:
            await harness.flight._step(clock, theirs, running)
        flight.was_flying = autopilot.mode in MISSION_MODES
        flight.has_path = _has_path(autopilot)
        autopilot.fail_safe("RTL")
        if flight.is_killed:
            await stop(running)
            is_alive = False
        circled_s = 0.0
        while harness.now_s < flight.begun_s + RETURN_MAX_S and circled_s < CIRCLED_S:
            if is_alive:
                await harness.flight._step(clock, theirs, running)
            else:
                harness.simulator.step(0.02)
            circled_s += 0.02 * _is_circling(autopilot)
            has_hit = harness.simulator.truth.collision and autopilot.active_command != Command.NAV_LAND
            if has_hit or autopilot.flight.is_standing:
                break
    finally:
        if is_alive:
            await stop(running)
        harness.recorder.close()
    flight.lasted_s = harness.now_s - flight.begun_s


def _has_path(autopilot):
    """Whether the list holds a return path, by its items alone."""
    items = autopilot.mission_items
    placed = [item.command for item in items if item.latitude_e7 != 0]  # The operator's landing has no place.
    if any(item.command == Command.DO_RETURN_PATH_START for item in items) or Command.DO_LAND_START in placed:
        return True
    has_landing = any(item.command == Command.NAV_LAND for item in items)
    return "RTL_TYPE" in autopilot.parameters.names and has_landing


def _is_circling(autopilot):
    """Whether the aircraft is on the circle that it steers round."""
    steering = autopilot.flight.steering
    if not hasattr(steering, "radius_m"):
        return False
    east, north = autopilot.flight.position
    return math.dist((east, north), steering.centre) < 1.3 * steering.radius_m


def _judge(harness, flight, circles):
    """What was touched or crossed after the return began, and where it ended."""
    truth, autopilot = harness.simulator.truth, harness.simulator.autopilot
    rows = np.array(truth.path)
    rows = rows[rows[:, 0] >= flight.begun_s]
    is_landing = autopilot.active_command == Command.NAV_LAND or autopilot.flight.is_standing
    track = LineString(rows[:, 1:3])
    for entry in truth.obstacles:
        low, high = min(entry.base_m, entry.top_m), max(entry.base_m, entry.top_m)
        within = (rows[:, 3] >= low) & (rows[:, 3] <= high)
        if within.sum() < 2:
            continue
        shape = Polygon(entry.polygon_enu_m)
        away = min(shape.distance(Point(*row[1:3])) for row in rows[within])
        flight.clearance_m = min(flight.clearance_m, float(away))
        if away <= 0.0:
            flight.touched = entry.name
    if rows[:, 3].min() <= 0.0 and not is_landing:
        flight.touched = flight.touched or "the ground"
    for number, (east, north, radius) in enumerate(circles, 1):
        if track.distance(Point(east, north)) <= radius:
            flight.crossed = f"fence {number}"
    if autopilot.flight.is_standing:
        home = autopilot.home
        away = math.dist(autopilot.flight.position, (home.east_m, home.north_m))
        flight.ended = "landed" if away < 4.0 * NEAR_M else f"landed {away:.0f} m from home"
    else:
        flight.ended = "circles" if _is_circling(autopilot) else f"under way, {autopilot.mode}"


def is_bad(flight):
    """Whether something was touched or crossed, or the return did not end."""
    return bool(flight.touched or flight.crossed) or flight.ended not in ("landed", "circles")


def line_of(flight):
    """One line of JSON."""
    return json.dumps(asdict(flight))
