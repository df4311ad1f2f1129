"""What a mission file and the autopilot's fences come to: limits, settings, obstacles, and their checker."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.assurance.checker import Checker
from companion.assurance.exposure import Exposure
from companion.config.compose import check_limits_of, exposure_of, goals_of, planner_settings_of, vehicle_of
from companion.config.models import MissionConfig
from companion.planning.problem import GoalRegion
from companion.planning.settings import PlannerSettings
from companion.types.state import AutopilotSettings
from companion.types.threat import Obstacle
from companion.world.vehicle.vehicle_model import VehicleModel

REPLAN_SHARE = 0.3  # of a first plan's iterations
LEAST_THREAT_WEIGHTS = (0.1, 0.1, 0.8)  # D_γ of (9) in an emergency


@dataclass(frozen=True, slots=True)
class Rules:
    """What plans and missions are held to; made by :func:`rules_of`.

    Parameters
    ----------
    mission : MissionConfig
        The mission file in force, with what the pilot has set.
    fences : tuple of Obstacle
        The autopilot's fences as obstacles.
    goals : tuple of GoalRegion
        The mission file's goals, in order.
    obstacles : tuple of Obstacle
        The mission file's obstacles and the fences.
    vehicle : VehicleModel
        What the aircraft can do.
    settings : PlannerSettings
        How to make a plan where nothing is flown that could be improved on.
    replan_settings : PlannerSettings
        How to make a plan beside a flown path: a search that finds nothing better is not worth the whole
        budget.
    least_threat_settings : PlannerSettings
        How to make an emergency plan: threats have no limit, and in (9) they weigh most.
    checker : Checker
        The independent check.
    exposure : Exposure
        How it works threat levels out.
    """

    mission: MissionConfig
    fences: tuple[Obstacle, ...]
    goals: tuple[GoalRegion, ...]
    obstacles: tuple[Obstacle, ...]
    vehicle: VehicleModel
    settings: PlannerSettings
    replan_settings: PlannerSettings
    least_threat_settings: PlannerSettings
    checker: Checker
    exposure: Exposure

    @property
    def level_m(self) -> float:
        """Height at which a mission in the plane is flown [m]."""
        return float(self.mission.start.up_m)

    @property
    def time_horizon_s(self) -> float:
        """Longest time between two plans [s]."""
        return float(self.mission.planning.time_horizon_s)


def rules_of(
    mission: MissionConfig, fences: tuple[Obstacle, ...] = (), told: AutopilotSettings | None = None
) -> Rules:
    """Compose the rules of a flight.

    Parameters
    ----------
    mission : MissionConfig
        The mission file in force.
    fences : tuple of Obstacle
        The autopilot's fences as obstacles.
    told : AutopilotSettings, optional
        The autopilot's: turns are banked no more and nothing is flown faster, whatever the mission file says.
    """
    vehicle, told = vehicle_of(mission), told or AutopilotSettings()
    if told.bank_max_deg:
        vehicle = replace(vehicle, bank_max_rad=min(vehicle.bank_max_rad, math.radians(told.bank_max_deg)))
    if told.airspeed_max_m_s:
        fast = min(vehicle.airspeed_fast_m_s, told.airspeed_max_m_s)
        vehicle = replace(vehicle, airspeed_fast_m_s=fast)
    limits = replace(check_limits_of(mission), bank_max_rad=vehicle.bank_max_rad)
    settings, exposure = planner_settings_of(mission), exposure_of(mission)
    obstacles = (*mission.obstacle_list, *fences)
    return Rules(
        mission=mission,
        fences=fences,
        goals=goals_of(mission),
        obstacles=obstacles,
        vehicle=vehicle,
        settings=settings,
        replan_settings=replace(settings, max_iterations=int(REPLAN_SHARE * settings.max_iterations)),
        least_threat_settings=replace(
            settings,
            threat_level_max=1.0,
            seen_max_s=math.inf,
            weights_cost=LEAST_THREAT_WEIGHTS,
        ),
        checker=Checker(obstacles, limits, exposure),
        exposure=exposure,
    )
