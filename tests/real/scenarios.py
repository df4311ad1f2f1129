"""What operator, pilot and computer do in each flight, one function each, and the table of them."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.rig.course import CITY_FENCE, HOLD, Item

HOLDS_S, HELD_S, RETURNED_S = 15.0, 30.0, 60.0
ONLY_GO_AROUND = 3.0  # RTL_AUTOLAND
BY_MISSION = 2  # RTL_TYPE
RETURN_AFTER_S = (12.0, 75.0)
FENCE_AHEAD_M, FENCE_HALF_M = 900.0, 45.0
KILL_AFTER_S = (3.0, 60.0)
UPLOADS_MAX = 5


def at_boot(deck):
    """The service runs since power-on; the mission comes later."""
    deck.start_service()
    deck.pause(5.0)
    deck.upload(deck.course.mission())
    deck.pause(5.0)
    deck.take_off()


def after_upload(deck):
    """The service is started when the mission is there, and before arming."""
    deck.upload(deck.course.mission())
    deck.start_service()
    deck.pause(3.0)
    deck.take_off()


def in_circle(deck):
    """The service is started while the aircraft circles where the operator has it hold."""
    deck.upload(deck.course.mission("hold"))
    deck.take_off()
    deck.wait(lambda: deck.station.sequence == 1 + deck.kind.num_home_items, 120.0, "the circle")
    deck.pause(HOLDS_S)
    deck.start_service()


def on_leg(deck):
    """The service is started on a long straight leg."""
    deck.upload(deck.course.mission("leg"))
    deck.take_off()
    deck.wait(lambda: deck.station.sequence == 4 + deck.kind.num_home_items, 240.0, "the leg")
    deck.start_service()


def killed(deck):
    """The service is killed at a random moment, and started again."""
    after_upload(deck)
    deck.wait_entered()
    deck.pause(deck.chance.uniform(*KILL_AFTER_S))
    deck.service.kill()
    deck.note("killed")
    deck.pause(1.0)
    deck.start_service()


def killed_for_good(deck):
    """The service is killed at a random moment, and not started again."""
    after_upload(deck)
    deck.wait_entered()
    deck.pause(deck.chance.uniform(*KILL_AFTER_S))
    deck.service.kill()
    deck.note("killed")


def pilot(deck):
    """The pilot holds for half a minute, and hands back."""
    after_upload(deck)
    deck.wait_entered()
    deck.pause(deck.chance.uniform(0.0, 5.0))
    deck.wait_roomy()
    deck.station.set_mode("hold")
    deck.note("pilot")
    deck.pause(HELD_S)
    deck.station.set_mode("mission")
    deck.note("handed back")


def changed_mind(deck):
    """The mission is uploaded twice on the ground, and the goals are the operator's."""
    deck.start_service()
    deck.upload(deck.course.mission(goal="paper"))
    deck.pause(4.0)
    deck.upload(deck.course.mission())
    deck.pause(8.0)
    deck.take_off()


def other_mission(deck):
    """The operator uploads another mission in the air, which leads home; again if the autopilot is busy."""
    after_upload(deck)
    deck.wait_entered()
    deck.pause(deck.chance.uniform(0.0, 3.0))
    for _ in range(UPLOADS_MAX):
        result = deck.station.upload(deck.course.return_home())
        deck.note("other mission", result=result)
        if result == mavlink.MAV_MISSION_ACCEPTED:
            break
        deck.pause(1.0)
    deck.station.set_current(0)
    if not deck.station.is_in_mission:
        deck.station.set_mode("mission")


def lossy(deck):
    """A tenth of all frames between autopilot and service is lost."""
    after_upload(deck)


def fenced(deck):
    """A fence is uploaded across the flown path."""
    after_upload(deck)
    deck.wait_entered()
    deck.pause(3.0)
    fence_off(deck, fence_ahead(deck))


def fence_off(deck, corners):
    """Upload a fence that nobody may enter, and note it; its corners are in the map's metres."""
    vertex = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    items = [Item(vertex, (4.0, 0.0, 0.0, 0.0), (east, north, 0.0)) for east, north in corners]
    result = deck.station.upload(items, mavlink.MAV_MISSION_TYPE_FENCE)
    factor = deck.course.factor
    scaled = [(factor * east, factor * north) for east, north in corners]
    deck.note("fence", result=result, polygon=scaled, clearance_m=shapely.Polygon(scaled).distance(
        shapely.Point(deck.station.here[:2])
    ))  # fmt: skip


def returned(deck):
    """Rally points are uploaded; in flight the pilot has the autopilot return to one, and hands back."""
    deck.start_service()
    deck.upload(deck.course.mission())
    rally = mavlink.MAV_CMD_NAV_RALLY_POINT
    points = [Item(rally, place=HOLD), Item(rally, place=(HOLD[0], HOLD[1] + 3500.0, HOLD[2]))]
    deck.note("rally points", result=deck.station.upload(points, mavlink.MAV_MISSION_TYPE_RALLY))
    if deck.kind.num_home_items:  # to the rally point, and not to the landing at once
        deck.station.set_parameter("RTL_AUTOLAND", ONLY_GO_AROUND)
    deck.pause(8.0)
    deck.take_off()
    deck.wait_entered()
    deck.pause(3.0)
    deck.station.set_mode("return")
    deck.note("return")
    deck.pause(RETURNED_S)
    deck.note("circled", away_m=math.dist(deck.station.here[:2], deck.course.local(HOLD)[:2]))
    deck.station.set_mode("mission")
    deck.note("handed back")


def sent_home(deck):
    """A return to launch at a random moment, by the path that the service keeps in the autopilot."""
    if deck.kind.num_home_items:
        deck.station.set_parameter("RTL_AUTOLAND", deck.autoland)
    else:
        deck.station.set_integer("RTL_TYPE", BY_MISSION if deck.autoland else 0)
    after_upload(deck)
    deck.wait_entered()
    deck.pause(deck.chance.uniform(*RETURN_AFTER_S))
    deck.station.set_mode("return")
    deck.note("return", here=deck.station.here)


def sent_home_alone(deck):
    """The same, and the service is killed in the same second."""
    sent_home(deck)
    deck.service.kill()
    deck.note("killed")


def sent_home_in_the_city(deck):
    """A return to launch at a random moment, over a city with a fence across a street."""
    fence_off(deck, square(CITY_FENCE, FENCE_HALF_M))
    sent_home(deck)


def sent_home_in_the_city_alone(deck):
    """The same, and the service is killed in the same second."""
    fence_off(deck, square(CITY_FENCE, FENCE_HALF_M))
    sent_home_alone(deck)


def square(middle, half):
    """Corners of a square, east and north."""
    east, north = middle
    return [(east - half, north - half), (east + half, north - half),
            (east + half, north + half), (east - half, north + half)]  # fmt: skip


def fence_ahead(deck):
    """Corners of a fence on the way ahead, in the paper map's metres; it leaves room on both sides."""
    (_, *before), (_, *here) = deck.station.path[-11], deck.station.path[-1]
    course = math.atan2(here[0] - before[0], here[1] - before[1])
    factor = deck.course.factor
    for away in (FENCE_AHEAD_M, 800.0, 700.0, 600.0, 1000.0, 500.0):
        for turn in (0.0, -0.3, 0.3, -0.6, 0.6):
            east = here[0] / factor + away * math.sin(course + turn)
            north = here[1] / factor + away * math.cos(course + turn)
            room = deck.course.clearance_m((factor * east, factor * north, here[2]))
            if room >= factor * (FENCE_HALF_M + 160.0) and 0.0 < east < 5000.0:
                return square((east, north), FENCE_HALF_M)
    raise AssertionError("no room for a fence")


@dataclass(frozen=True)
class Scenario:
    """A row of the table.

    Parameters
    ----------
    number : str
        As in the table of flights.
    name : str
        In words.
    act : callable
        What is done, up to where the flight goes on by itself.
    changes : dict
        Sections of the mission file, with keys to set.
    goal : str
        Where it leads.
    loss : float
        Share of frames lost.
    ends : tuple of str
        How it may end: ``landed``, ``circling``.
    """

    number: str
    name: str
    act: Callable
    changes: dict = field(default_factory=dict, hash=False)
    goal: str = "near"
    loss: float = 0.0
    ends: tuple[str, ...] = ("landed",)


HOMES = ("landed", "circling")  # where a return may end
SCENARIOS = (
    Scenario("1", "at boot", at_boot),
    Scenario("1p", "at boot, whole map", at_boot, goal="paper"),
    Scenario("2", "after upload", after_upload),
    Scenario("3", "in the circle", in_circle),
    Scenario("4", "on a leg", on_leg),
    Scenario("5", "killed", killed),
    Scenario("6", "killed for good", killed_for_good, ends=HOMES),
    Scenario("7", "pilot", pilot),
    Scenario("7k", "pilot, kept ready", pilot, {"authority": {"keep_ready": True}}),
    Scenario("8", "changed mind", changed_mind, {"goals": "from_autopilot"}),
    Scenario("9", "other mission", other_mission),
    Scenario("10", "a tenth lost", lossy, loss=0.1),
    Scenario("11", "fence", fenced),
    Scenario("12", "rally point", returned),
    Scenario("13", "sent home", sent_home, ends=HOMES),
    Scenario("13k", "sent home, killed", sent_home_alone, ends=HOMES),
    Scenario("14", "city with a fence, sent home", sent_home_in_the_city, goal="city", ends=HOMES),
    Scenario("14k", "the same, killed", sent_home_in_the_city_alone, goal="city", ends=HOMES),
)
BY_NUMBER = {scenario.number: scenario for scenario in SCENARIOS}
