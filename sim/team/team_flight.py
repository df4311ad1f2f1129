"""Several aircraft, autopilots and services in one simulated world, with a radio between them.

Odd members fly from the mission's start to its goal, even ones the other way, so that they meet. Starts and
goals lie side by side: no two circles overlap at the goals, or before the first plan.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely

from companion.config import MissionConfig
from companion.config.sections.team_section import TeamConfig
from companion.errors import CompanionError
from companion.frames import FloatArray
from companion.types.events import Dialect
from ..autopilot.operator_missions import ground_of, safe_loiter
from ..sitl import LINGER_S, Flight
from .simulated_radio import Radio

SPOTS_M = 60.0  # Starts and goals are sought on a grid of this size.
SPOTS_MAX = 5_000
Circled = Callable[[FloatArray, int], FloatArray]


class NoPlaceError(CompanionError):
    """There is no free place for a member's start or goal."""


@dataclass
class TeamFlight:
    """A flight of a team, and its measures.

    Parameters
    ----------
    mission : MissionConfig
        The mission that all missions are made of.
    num : int
        Number of aircraft, at least two.
    seed : int
        Seed of everything random.
    dialect : Dialect
        Which autopilots fly.
    folder : Path or None
        Folder of the recordings, one for each member.
    shares : bool
        Whether they share their plans; otherwise each flies as if it were alone.
    speed : float
        Simulated seconds a second.
    gone_s : dict of int to float
        Members whose aircraft, autopilot, radio and service are gone from a time on [s].
    linger_s : float
        How long the flight goes on after the last member has arrived [s].

    Attributes
    ----------
    flights : list of Flight
        The members' flights.
    radio : Radio
        The radio between them.
    least_m : dict of (int, int) to tuple of float
        For each two members their distances when nearest, horizontally and vertically [m], and when [s].
    arrived_s, hit_s : dict of int to float
        When each member arrived, and when it touched something before that [s].
    """

    mission: MissionConfig
    num: int
    seed: int
    dialect: Dialect = Dialect.ARDUPILOT
    folder: Path | None = None
    shares: bool = True
    speed: float = math.inf
    gone_s: dict[int, float] = field(default_factory=dict)
    linger_s: float = LINGER_S
    flights: list[Flight] = field(init=False)
    radio: Radio = field(init=False)
    least_m: dict[tuple[int, int], tuple[float, float, float]] = field(init=False, default_factory=dict)
    arrived_s: dict[int, float] = field(init=False, default_factory=dict)
    hit_s: dict[int, float] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        missions = self.missions()
        self._team = missions[0].team or TeamConfig(members=(1, 2))
        self.flights = [
            Flight(
                mission if self.shares else mission.model_copy(update={"team": None}),
                self.seed + 1000 * number, self._folder_of(number), self.dialect,
                self.speed if number == 1 else math.inf, system_id=number,
            )
            for number, mission in enumerate(missions, 1)
        ]  # fmt: skip
        self._set_return_heights()
        weather = self.mission.simulation
        self.radio = Radio(
            [flight.simulator for flight in self.flights], range_m=weather.radio_range_m,
            loss=weather.radio_loss if self.shares else 1.0, delay_s=weather.radio_delay_s, seed=self.seed,
        )  # fmt: skip

    def _set_return_heights(self) -> None:
        """Give each member a return height of its own; some share one where the bounds have too few."""
        apart_m, most_m = self._team.paths_apart_up_m, self.mission.bounds.up_m[1]
        name = self.dialect.parameter_names["return_height_m"]
        for number, flight in enumerate(self.flights):
            parameters = flight.simulator.autopilot.parameters
            room = max(int((most_m - parameters[name]) // apart_m) + 1, 1)
            parameters[name] += number % room * apart_m

    def missions(self) -> list[MissionConfig]:
        """Return the missions of all members."""
        return team_missions(self.mission, self.num)

    def _folder_of(self, number: int) -> Path | None:
        return None if self.folder is None else self.folder / f"{number}"

    @property
    def is_separate(self) -> bool:
        """Whether no two members ever came closer than both distances of the team."""
        config = self._team
        return all(flat >= config.apart_m or up >= config.apart_up_m for flat, up, _ in self.least_m.values())

    async def fly(self) -> None:
        """Fly until all have arrived, or the time limit of the slowest has passed."""
        limit_s = max(flight.limit_s for flight in self.flights)
        async with contextlib.AsyncExitStack() as stack:
            advances = [await stack.enter_async_context(flight.running()) for flight in self.flights]
            now_s, end_s = 0.0, limit_s
            while now_s < end_s:
                there = self.members_there(now_s)
                for number in there:
                    await advances[number - 1]()
                now_s = max(self.flights[number - 1].now_s for number in there)
                self.radio.step(now_s)
                self._measure(now_s)
                self._note(now_s)
                if self.arrived_s and all(number in self.arrived_s for number in there):
                    end_s = min(end_s, max(self.arrived_s.values()) + self.linger_s)

    def members_there(self, now_s: float) -> list[int]:
        """Return the members that are not gone at a time [s]."""
        return [n for n in range(1, len(self.flights) + 1) if now_s < self.gone_s.get(n, math.inf)]

    def flown_by(self) -> list[list[tuple[int, float]]]:
        """Return who truly flew each goal of the mission within its radius, and when first [s]."""
        found: list[list[tuple[int, float]]] = []
        paths = [np.array(flight.simulator.truth.path) for flight in self.flights]
        for goal in self.mission.goals:
            place, passed = (goal.east_m, goal.north_m, goal.up_m), []
            for number, rows in enumerate(paths, 1):
                near = np.linalg.norm(rows[:, 1:4] - place, axis=1) <= goal.acceptance_radius_m
                if near.any():
                    passed.append((number, float(rows[near.argmax(), 0])))
            found.append(passed)
        return found

    def _note(self, now_s: float) -> None:
        """Note who has arrived, and who has touched something before that.

        Afterwards some fly the operator's landing, which is made for one aircraft at the mission's start.
        """
        for number in self.members_there(now_s):
            flight = self.flights[number - 1]
            if number in self.arrived_s:
                continue
            if flight.simulator.truth.collision:
                self.hit_s.setdefault(number, now_s)
            if flight.has_arrived():
                self.arrived_s[number] = now_s

    def _measure(self, now_s: float) -> None:
        """Note how near any two members are, once both have taken off."""
        places = np.array([flight.simulator.truth.path[-1][1:4] for flight in self.flights])
        config, there = self._team, [number - 1 for number in self.members_there(now_s)]
        for one, other in itertools.combinations(there, 2):
            away = places[one] - places[other]
            flat, up = math.hypot(away[0], away[1]), abs(float(away[2]))
            near = max(flat / config.apart_m, up / config.apart_up_m)
            before = self.least_m.get((one + 1, other + 1))
            if before is None or near < max(before[0] / config.apart_m, before[1] / config.apart_up_m):
                self.least_m[one + 1, other + 1] = (flat, up, now_s)

    def summary(self) -> dict[str, object]:
        """Return what happened, for people and for JSON."""
        nearest = min(self.least_m.values(), default=(math.inf, math.inf, 0.0))
        shared = {"goals_flown_by": self.flown_by()} if self.mission.shares_goals else {}
        return {
            **shared,
            "mission": self.mission.name,
            "seed": self.seed,
            "aircraft": len(self.flights),
            "is_separate": self.is_separate,
            "collision": bool(self.hit_s),
            "arrived": len(self.arrived_s),
            "arrived_s": {str(number): round(s, 1) for number, s in sorted(self.arrived_s.items())},
            "nearest_m": round(nearest[0], 1),
            "nearest_up_m": round(nearest[1], 1),
            "nearest_at_s": round(nearest[2], 1),
            "bytes_s": [
                round(sent / max(flight.now_s, 1.0), 1)
                for sent, flight in zip(self.radio.bytes_sent, self.flights, strict=True)
            ],
        }


@dataclass
class FreePlace:
    """The conditions on which a place is free for a member.

    Parameters
    ----------
    clear_m : float
        A circle of this radius about it is inside the bounds and clear of all obstacles [m].
    apart_m : float
        The way from it to its circle is this far from those of other members [m].
    taken : list of shapely.LineString
        The paths of the members that have a place.
    """

    clear_m: float
    apart_m: float
    taken: list[shapely.LineString] = field(default_factory=list)


def fly_team(flight: TeamFlight) -> None:
    """Fly a team to its end."""
    asyncio.run(flight.fly())


def team_missions(mission: MissionConfig, num: int) -> list[MissionConfig]:
    """Return the missions of all members.

    Raises
    ------
    NoPlaceError
        If there is no free place for all starts and goals.
    """
    start, goal = mission.start, mission.goals[-1]
    team = mission.team or TeamConfig(members=tuple(range(1, num + 1)))
    circle_m = 1.3 * float(mission.vehicle.turn_radius_min_m)
    free_m, separation_m = circle_m + team.tolerance_m, team.apart_m + 2.0 * team.tolerance_m
    ends = [np.array([place.east_m, place.north_m]) for place in (start, goal)]
    goals_free = FreePlace(free_m, 2.0 * circle_m + separation_m)
    starts_free = FreePlace(free_m, 2.0 * float(mission.vehicle.turn_radius_min_m) + separation_m)
    if mission.shares_goals:
        return _missions_of_shared_goals(mission, team, num, starts_free)
    num_of = [(num + 1) // 2, num // 2]
    goals = [
        _spots(mission, end, count, goals_free, lambda place, _: place)
        for end, count in zip(ends, num_of[::-1], strict=True)
    ]

    def circled_from(way: int) -> Circled:
        return lambda place, index: _circle_before_the_first_plan(mission, place, goals[1 - way][index])

    starts = [
        _spots(mission, end, count, starts_free, circled_from(way))
        for way, (end, count) in enumerate(zip(ends, num_of, strict=True))
    ]
    missions = []
    for number in range(num):
        way, index = number % 2, number // 2
        finish = goals[1 - way][index]
        own_goal = goal.model_copy(update={"east_m": float(finish[0]), "north_m": float(finish[1])})
        member = _mission_of_member(mission, team, (number + 1, num), starts[way][index], finish)
        missions.append(member.model_copy(update={"goals": (own_goal,)}))
    return missions


def _missions_of_shared_goals(
    mission: MissionConfig, team: TeamConfig, num: int, free: FreePlace
) -> list[MissionConfig]:
    """Return the missions of members that start side by side and share the mission's goals."""
    start, first = mission.start, np.array([mission.goals[0].east_m, mission.goals[0].north_m])
    places = _spots(
        mission, np.array([start.east_m, start.north_m]), num, free,
        lambda place, _: _circle_before_the_first_plan(mission, place, first),
    )  # fmt: skip
    return [
        _mission_of_member(mission, team, (number, num), place, first)
        for number, place in enumerate(places, 1)
    ]


def _mission_of_member(
    mission: MissionConfig,
    team: TeamConfig,
    member_of: tuple[int, int],
    begin: FloatArray,
    toward: FloatArray,
) -> MissionConfig:
    """Return a member's mission, which begins at ``begin`` (2,) towards ``toward`` (2,) [m]."""
    number, num = member_of
    east_m, north_m = toward - begin
    start = {
        "east_m": float(begin[0]),
        "north_m": float(begin[1]),
        "course_deg": math.degrees(math.atan2(east_m, north_m)) % 360.0,
    }
    return mission.model_copy(
        update={
            "name": f"{mission.name}-{number}",
            "start": mission.start.model_copy(update=start),
            "dynamic_threats": (),
            "team": team.model_copy(update={"members": tuple(range(1, num + 1))}),
        }
    )


def _circle_before_the_first_plan(mission: MissionConfig, place: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the centre (2,) of the circle of the operator's mission [m].

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    place, goal : ndarray, shape (2,)
        Start and goal of the member, east and north [m].
    """
    east, north = float(place[0]), float(place[1])
    course_rad = math.atan2(goal[0] - east, goal[1] - north)
    start = (east, north, float(mission.start.up_m))
    return np.array(safe_loiter(mission, start, course_rad, ground_of(mission)[0]))


def _spots(
    mission: MissionConfig, near: FloatArray, num: int, free: FreePlace, circled: Circled
) -> list[FloatArray]:
    """Return the ``num`` free places, each (2,), nearest to ``near`` (2,), with circles that keep clear.

    ``circled`` gives the centre of the circle that is flown to from a place with its number.
    """
    walls = shapely.union_all([shapely.Polygon(wall.polygon_enu_m) for wall in mission.obstacle_list])
    area = shapely.box(
        mission.bounds.east_m[0],
        mission.bounds.north_m[0],
        mission.bounds.east_m[1],
        mission.bounds.north_m[1],
    ).buffer(-free.clear_m)
    steps = np.arange(-60, 61) * SPOTS_M
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    grid = grid[np.argsort(np.hypot(*grid.T), kind="stable")][:SPOTS_MAX]
    found: list[FloatArray] = []
    for place in near + grid:
        point = shapely.Point(place)
        if not area.contains(point) or walls.distance(point) < free.clear_m:
            continue
        way = shapely.LineString([place, circled(place, len(found))])
        if all(way.distance(other) >= free.apart_m for other in free.taken):
            found.append(place)
            free.taken.append(way)
            if len(found) == num:
                return found
    raise NoPlaceError(
        f"no free places for {num} circles {free.apart_m:.0f} m apart near {near[0]:.0f}, {near[1]:.0f}"
    )
