"""Flights whose engine stops at a random second, over random fields, and the judge of where they end."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from companion.config import load_mission
from companion.config.sections.glide_section import FieldConfig, GlideConfig, PeopleConfig
from companion.flight.state.modes import Mode
from companion.types.events import Dialect
from sim.autopilot.operator_missions import ground_of
from tests.sim.client import CONFIGS
from tests.support.sitl_harness import SitlHarness

WORLDS = ("valley", "first-flight", "paper-3d", "city-block")
OVER_GROUND = ("ridge", "jacksboro", "hills", "leeward")
LEVEL_M, LEVEL_SIDES = 8.0, 12  # Fields over ground are drawn where heights on their edge differ by less.
RATIO = 10.5  # The simulated aircraft glides 10.7 m per metre of height at 18 m/s true, the propeller away.
AIRSPEED_M_S = 18.0
WIND_MAX_M_S = 6.0
FIELDS = (3, 6)  # Fewest and most fields.
FIELD_RADII_M = (60.0, 100.0)
FIELD_CLEAR_M = 120.0  # Fields lie at least this far from obstacles.
PEOPLE_SIDE_M = 250.0
BESIDE_MAX_M = 50.0  # A touchdown counts at the field up to this far beside it.
FIRST_S, LAST_SHARE = 25.0, 0.9  # The engine stops after this time, and before this share of the flight.
DOWN_MAX_S = 700.0  # An aircraft without thrust is down after this time, from 600 m as well.


@dataclass
class Outcome:
    """What became of a flight."""

    number: int
    world: str
    dialect: str
    wind_m_s: float
    stop_s: float = math.nan
    place: str = ""
    beside_m: float = math.nan
    is_named_stretch: bool = False
    touched: str = ""
    told_after_s: float = math.nan
    chosen_after_s: float = math.nan
    end_enu_m: tuple = ()
    verdict: str = ""


def mission_of(number, worlds=WORLDS):
    """The mission, the autopilot and the share of the flight at which the engine stops, by number."""
    draw = np.random.default_rng([number, 71])
    name = worlds[number % len(worlds)]
    dialect = (Dialect.ARDUPILOT, Dialect.PX4)[number // len(worlds) % 2]
    mission = load_mission(CONFIGS / f"{name}.yaml")
    ground, _ = ground_of(mission)
    walls = shapely.unary_union([shapely.Polygon(entry.polygon_enu_m) for entry in mission.obstacles])
    (east0, east1), (north0, north1) = mission.bounds.east_m, mission.bounds.north_m
    fields, people = [], []
    wanted = int(draw.integers(*FIELDS, endpoint=True))
    for _ in range(500):
        east, north = float(draw.uniform(east0, east1)), float(draw.uniform(north0, north1))
        if len(fields) < wanted and walls.distance(shapely.Point(east, north)) >= FIELD_CLEAR_M:
            radius = float(round(draw.uniform(*FIELD_RADII_M)))
            up_m = 0.0 if ground is None else None
            if ground is None or _is_level(ground, east, north, radius):
                fields.append(
                    FieldConfig(
                        name=f"F{len(fields)}", east_m=east, north_m=north, up_m=up_m, radius_m=radius
                    )
                )
    for index in range(2):
        east, north = float(draw.uniform(east0, east1)), float(draw.uniform(north0, north1))
        square = shapely.box(east, north, east + PEOPLE_SIDE_M, north + PEOPLE_SIDE_M)
        if all(square.distance(shapely.Point(at.east_m, at.north_m)) > at.radius_m + 60.0 for at in fields):
            corners = tuple((float(x), float(y)) for x, y in square.exterior.coords[:4])
            people.append(PeopleConfig(name=f"P{index}", polygon_enu_m=corners))
    glide = GlideConfig(ratio=RATIO, airspeed_m_s=AIRSPEED_M_S, fields=tuple(fields), people=tuple(people))
    weather = mission.simulation.model_copy(
        update={
            "wind_speed_m_s": round(float(draw.uniform(0.0, WIND_MAX_M_S)), 1),
            "wind_from_deg": float(round(draw.uniform(0.0, 360.0))),
        }
    )
    authority = mission.authority.model_copy(update={"glide": True})
    changes = {"glide": glide, "simulation": weather, "authority": authority}
    return mission.model_copy(update=changes), dialect, float(draw.uniform(0.0, 1.0))


def _is_level(ground, east, north, radius):
    """Whether the ground on the edge of a field is level."""
    angles = np.linspace(0.0, 2.0 * math.pi, LEVEL_SIDES)
    return (
        float(np.ptp(ground.ups_m(east + radius * np.sin(angles), north + radius * np.cos(angles)))) < LEVEL_M
    )


class GlideHarness(SitlHarness):
    """A flight whose engine stops."""

    def __init__(self, mission, seed, dialect, stop_s):
        super().__init__(mission, seed=seed, dialect=dialect)
        self.stop_s, self.stopped_s = stop_s, math.nan
        self.stretches, self.path_begin_s = (), math.nan
        self.told_s, self.told_mode = math.nan, None

    def act(self, _harness):
        """Stop the engine when it is time, and end the flight on the ground."""
        flight, app = self.simulator._scenario.flight, self.app
        if math.isnan(self.stopped_s):
            if app.mode is Mode.ARRIVED:
                self.is_over = True
            elif self.now_s >= self.stop_s and app.mode is Mode.ACTIVE and app.state.flown is not None:
                flight.has_thrust, self.stopped_s = False, self.now_s
                self._note_stretches()
            return
        if math.isnan(self.told_s) and not app.replanning.performance.has_thrust:
            self.told_s, self.told_mode = self.now_s, app.mode
        is_down = flight.is_standing or self.simulator.truth.collision
        self.is_over = is_down or self.now_s > self.stopped_s + DOWN_MAX_S

    def _note_stretches(self):
        """Remember what was named of the path that is flown."""
        swaps = [entry for entry in self.recorder.decisions if entry.kind in ("swap", "ready")]
        named = [entry.why["no_field_stretches_s"] for entry in swaps if "no_field_stretches_s" in entry.why]
        self.stretches = named[-1] if named else ()
        self.path_begin_s = float(self.app.state.flown.path.times_s[0])

    @property
    def is_in_named_stretch(self):
        """Whether the engine stopped, or was missed, in a stretch that was named as without a field.

        In a descent nobody misses an engine that has stopped: the path is flown on.
        """
        first = max(0.0, self.stopped_s - self.path_begin_s)
        last = first if math.isnan(self.told_s) else self.told_s - self.path_begin_s
        return any(begin <= last and first < end for begin, end in self.stretches)


def duration_s(mission):
    """About how long the flight takes [s]."""
    places = [mission.start, *mission.goals]
    way = sum(math.dist((a.east_m, a.north_m), (b.east_m, b.north_m)) for a, b in pairwise(places))
    return way / mission.vehicle.airspeed_cruise_m_s


def flown(number, worlds=WORLDS):
    """Fly a number; return its outcome and the harness."""
    mission, dialect, share = mission_of(number, worlds)
    last_s = max(FIRST_S + 5.0, LAST_SHARE * duration_s(mission))
    harness = GlideHarness(mission, number, dialect, FIRST_S + share * (last_s - FIRST_S))
    harness.fly(harness.stop_s + 60.0 + DOWN_MAX_S, harness.act)
    return judged(number, mission, dialect, harness), harness


def judged(number, mission, dialect, harness):
    """The outcome of a flight that has ended."""
    told = Outcome(number, mission.name, dialect.value, mission.simulation.wind_speed_m_s)
    truth = harness.simulator.truth
    if math.isnan(harness.stopped_s):
        told.verdict = "hit before" if truth.collision else "arrived"
        return told
    told.stop_s, told.is_named_stretch = harness.stopped_s, harness.is_in_named_stretch
    _, east, north, up, *_ = truth.path[-1]
    told.end_enu_m = round(east, 1), round(north, 1), round(up, 1)
    told.touched = _touched(mission, truth, (east, north))
    glides = [
        entry for entry in harness.recorder.decisions
        if entry.kind == "engine" and entry.stamp_s >= harness.stopped_s
    ]  # fmt: skip
    lost = [entry.stamp_s for entry in glides if entry.text.startswith("no thrust")]
    told.told_after_s = lost[0] - harness.stopped_s if lost else math.nan
    chosen = [entry for entry in glides if entry.text.startswith(("glide to", "no field"))]
    if chosen and lost:
        told.chosen_after_s = chosen[0].stamp_s - lost[0]
    place = harness.app._departure.glide._choice
    if place is not None:
        told.place = place.place.name
        away = math.dist((east, north), place.place.position_enu_m[:2])
        told.beside_m = round(away - place.place.radius_m, 1)
    ground_m = 0.0 if truth.ground is None else truth.ground.up_m(east, north)
    is_down = harness.simulator._scenario.flight.is_standing or up <= ground_m + 1.0
    if told.touched:
        told.verdict = "touched"
    elif not is_down:
        told.verdict = "not down"
    elif told.place not in ("", "open ground") and told.beside_m <= BESIDE_MAX_M:
        told.verdict = "at the field"
    elif harness.told_mode is not Mode.ACTIVE:
        told.verdict = "not flown by the service"
    elif told.is_named_stretch:
        told.verdict = "in a named stretch"
    else:
        told.verdict = "elsewhere"
    return told


def _touched(mission, truth, end):
    """The obstacle or the people that a flight has touched; '' for none."""
    rows = np.array(truth.path)[:, 1:4]
    for obstacle in mission.obstacles:
        polygon = shapely.Polygon(obstacle.polygon_enu_m)
        is_level = (rows[:, 2] >= obstacle.base_m) & (rows[:, 2] <= obstacle.top_m)
        inside = rows[is_level]
        if len(inside) and shapely.contains_xy(polygon, inside[:, 0], inside[:, 1]).any():
            return obstacle.name
    for area in mission.glide.people:
        if shapely.Polygon(area.polygon_enu_m).covers(shapely.Point(end)):
            return area.name
    return ""
