"""The paper's map, or a city, for an aircraft of another size, and the operator's missions on it.

Places are told in the map's own metres (:data:`PAPER`, :data:`CITY`); an aircraft that flies at half the
speed flies a map of half the size, in the same time.
"""

import copy
from dataclasses import dataclass, field

import shapely
import yaml
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.frames import LocalFrame
from tests.sim.client import CONFIGS

PAPER, CITY = CONFIGS / "paper-3d.yaml", CONFIGS / "city-block.yaml"
CITY_SIZE = 1.5  # The city is made for turns of 60 m; ArduPlane's aircraft flies them of 90.
KEPT = {"altitude_amsl_m", "clearance_min_m", "position_std_m", "altitude_std_m", "initial_position_std_m"}
HOME = (4750.0, 100.0, 0.0)
GOALS = {"near": (4700.0, 3900.0, 200.0), "paper": (250.0, 4750.0, 500.0), "city": (2250.0, 1850.0, 120.0)}
LANDINGS = {  # the circle in which height is lost, and the place to touch down
    "near": ((4700.0, 4100.0, 60.0), (4700.0, 4955.0, 0.0)),
    "paper": ((250.0, 4550.0, 60.0), (250.0, 5405.0, 0.0)),
    "home": ((4650.0, 1000.0, 60.0), (4750.0, 150.0, 0.0)),
    "city": ((2230.0, 1800.0, 90.0), (2230.0, 3100.0, 0.0)),
}
TAKEOFF = (4750.0, 900.0, 150.0)
CITY_HOME, CITY_TAKEOFF = (110.0, -500.0, 0.0), (110.0, 250.0, 120.0)
CITY_FENCE = (725.0, 625.0)  # the middle of a street; room is left on both sides
HOLD = (4650.0, 1000.0, 150.0)
HOLD_RADIUS_M, DESCENT_RADIUS_M = 125.0, 100.0
LEG = ((4850.0, 1250.0, 150.0), (4850.0, 300.0, 160.0), (4650.0, 200.0, 160.0), (2750.0, 220.0, 170.0))
CLEAR_M = 30.0  # between the operator's own way and any obstacle

Place = tuple[float, float, float]


@dataclass(frozen=True)
class Item:
    """An item of the operator's mission, with its place in the paper map's metres."""

    command: int
    parameters: tuple = (0.0, 0.0, 0.0, 0.0)
    place: Place | None = None
    frame: int | None = None


def scaled(value, factor, key=""):
    """A mission file's values for a map of another size: lengths and speeds scaled, times as they are."""
    if isinstance(value, dict):
        return {name: scaled(entry, factor, name) for name, entry in value.items()}
    if isinstance(value, list):
        return [scaled(entry, factor, key) for entry in value]
    if isinstance(value, bool) or not isinstance(value, int | float) or key in KEPT:
        return value
    if key.endswith("_per_m"):
        return value / factor
    is_length = key.endswith(("_m", "_m_s", "_m_s2")) and not key.startswith(("wind", "acceleration_std"))
    return round(value * factor, 4) if is_length else value


@dataclass
class Course:
    """A map, its mission file and the operator's missions.

    Parameters
    ----------
    factor : float
        Size of the map against the one whose places are told; that of the city is multiplied.
    goal : str
        Which of :data:`GOALS` is flown to.
    changes : dict
        Sections of the mission file with keys to set, in the aircraft's metres.
    """

    factor: float = 1.0
    goal: str = "near"
    changes: dict = field(default_factory=dict)

    def __post_init__(self):
        self.is_city = self.goal == "city"
        self.factor *= CITY_SIZE if self.is_city else 1.0
        path = CITY if self.is_city else PAPER
        document = scaled(yaml.safe_load(path.read_text(encoding="utf-8")), self.factor)
        east, north, up = GOALS[self.goal]
        goal = {"east_m": east, "north_m": north, "up_m": up, "acceptance_radius_m": 60.0}
        document["goals"] = [scaled(goal, self.factor)]
        document["simulation"] = {}
        for section, keys in copy.deepcopy(self.changes).items():
            if isinstance(keys, dict):
                document.setdefault(section, {}).update(keys)
            else:
                document[section] = keys
        vehicle = document["vehicle"]  # The city is larger, and its aircraft no faster.
        fast = min(vehicle["penetration_speed_m_s"], vehicle["airspeed_max_m_s"])
        vehicle["penetration_speed_m_s"] = fast
        self.document = document
        origin = document["origin"]
        self.frame = LocalFrame(origin["latitude_deg"], origin["longitude_deg"], origin["altitude_amsl_m"])
        self.prisms = [
            (entry["name"], shapely.Polygon(entry["polygon_enu_m"]), entry["base_m"], entry["top_m"])
            for entry in document["obstacles"]
        ]

    @property
    def text(self):
        """The mission file."""
        return yaml.safe_dump(self.document, sort_keys=False)

    @property
    def home(self):
        """Latitude, longitude [deg] and altitude [m] of the runway's end."""
        return self.globally(CITY_HOME if self.is_city else HOME)

    def local(self, place):
        """A place of the paper's map in the aircraft's metres."""
        return tuple(self.factor * value for value in place)

    def globally(self, place):
        """Latitude, longitude [deg] and altitude above the sea [m] of a place of the paper's map."""
        return self.frame.global_from_local(*self.local(place))

    def clearance_m(self, place_m, name_too=False):
        """Distance of a place, in the aircraft's metres, to the nearest obstacle that reaches its height."""
        here = shapely.Point(place_m[0], place_m[1])
        found = [
            (polygon.distance(here), name)
            for name, polygon, base, top in self.prisms
            if base <= place_m[2] <= top
        ]
        nearest = min(found, default=(float("inf"), ""))
        return nearest if name_too else nearest[0]

    def clearance_of_way_m(self, places_m):
        """Smallest distance of a way, in the aircraft's metres, to obstacles at its heights."""
        line = shapely.LineString([place[:2] for place in places_m])
        low = min(place[2] for place in places_m)
        return min(
            (polygon.distance(line) for _, polygon, _, top in self.prisms if top >= low), default=float("inf")
        )

    # --- the operator's missions

    def mission(self, kind="straight", goal=None, up_m=0.0):
        """Items of an operator's mission: to the goal ``straight``, over a ``hold`` or a long ``leg``."""
        goal = goal or self.goal
        begin = CITY_TAKEOFF if self.is_city else TAKEOFF
        way = [Item(mavlink.MAV_CMD_NAV_TAKEOFF, (12.0, 0.0, 0.0, 0.0), begin)]
        if kind == "hold":
            circle = (0.0, 0.0, self.factor * HOLD_RADIUS_M, 0.0)
            way.append(Item(mavlink.MAV_CMD_NAV_LOITER_UNLIM, circle, HOLD))
        elif kind == "leg":
            way += [Item(mavlink.MAV_CMD_NAV_WAYPOINT, place=place) for place in LEG]
        east, north, up = GOALS[goal]
        way.append(Item(mavlink.MAV_CMD_NAV_WAYPOINT, place=(east, north, up + up_m)))
        return way + self.landing(goal)

    def landing(self, where):
        """Items that lose height in a circle and land."""
        circle, touchdown = LANDINGS[where]
        down = (0.0, self.factor * DESCENT_RADIUS_M, 0.0, 1.0)
        return [
            Item(mavlink.MAV_CMD_DO_LAND_START),
            Item(mavlink.MAV_CMD_NAV_LOITER_TO_ALT, down, circle),
            Item(mavlink.MAV_CMD_NAV_LAND, place=touchdown),
        ]

    def return_home(self):
        """Another mission, uploaded in the air: back to the runway."""
        return [Item(mavlink.MAV_CMD_NAV_WAYPOINT, place=HOLD), *self.landing("home")]

    def check_departure(self, items):
        """See that the operator's own way, up to the goal's leg, keeps clear of everything."""
        placed = [CITY_HOME if self.is_city else HOME] + [
            item.place for item in items if item.place is not None
        ]
        before = placed[: placed.index(GOALS[self.goal])] if GOALS[self.goal] in placed else placed[:2]
        clear = self.clearance_of_way_m([(*self.local(place)[:2], 0.0) for place in before])
        if len(before) > 2 and items[1].command == mavlink.MAV_CMD_NAV_LOITER_UNLIM:
            clear -= self.factor * HOLD_RADIUS_M
        assert clear >= CLEAR_M * self.factor, f"the operator's way passes {clear:.0f} m from an obstacle"
