"""Flights of a campaign: the route of methods that never replan, and the link of all."""

from __future__ import annotations

from companion.config import MissionConfig
from companion.config.compose import vehicle_of
from companion.config.offline_problem import offline_problem, offline_world
from companion.errors import CompanionError
from companion.mission.waypoints import waypoints_from_path
from companion.planning.comparators import PLAN_ONCE, STRAIGHT_LINE
from companion.planning.solver import solve
from companion.research.campaign.campaign_spec import Run
from companion.research.campaign.flown_methods import LinkFaultsConfig
from companion.types.events import Dialect
from companion.world.vehicle.guidance import default_guidance
from ..faults import FaultKind, FaultyLink, LinkFaults, random_schedule
from ..simulator import Place
from ..sitl import Flight


def flight_of(mission: MissionConfig, run: Run, dialect: Dialect, faults: LinkFaultsConfig) -> Flight:
    """Return a run's flight, ready to be flown.

    Raises
    ------
    CompanionError
        If it should fly an offline plan, and none reaches the goal.
    """
    flight = Flight(mission, run.seed, dialect=dialect, route_enu_m=route_of(mission, run, dialect))
    if not faults.is_none:
        flight.wire = faulty(flight, faults)
    return flight


def route_of(mission: MissionConfig, run: Run, dialect: Dialect) -> tuple[Place, ...]:
    """Waypoints of a method from the start to the goal [m]; empty if it replans.

    Raises
    ------
    CompanionError
        If no offline plan reaches the goal.
    """
    goals = tuple((float(goal.east_m), float(goal.north_m), float(goal.up_m)) for goal in mission.goals)
    if run.method == STRAIGHT_LINE:
        return goals
    if run.method != PLAN_ONCE:
        return ()
    plan = solve(offline_problem(mission, offline_world(mission), None, run.seed))
    if plan.path is None or not plan.reaches_goal:
        raise CompanionError(f"no plan from the start: {plan.status.value}")
    speed = float(mission.vehicle.airspeed_cruise_m_s)
    guidance = default_guidance(flies_by=dialect.flies_by, vehicle=vehicle_of(mission))
    made = waypoints_from_path(plan.path, speed, flies_by=guidance.flies_by, slope_min=guidance.slope_min)
    places = made.positions_enu_m
    return tuple((float(east), float(north), float(up)) for east, north, up in places)


def faulty(flight: Flight, faults: LinkFaultsConfig) -> FaultyLink:
    """Return the flight's simulator behind a bad link."""
    numbers = faults.model_dump(exclude={"schedule"})
    schedule = None
    if faults.schedule == "random":
        schedule = random_schedule(flight.seed, flight.limit_s, (FaultKind.DISCONNECT,))
    return FaultyLink(flight.simulator, LinkFaults(**numbers), seed=flight.seed, schedule=schedule)
