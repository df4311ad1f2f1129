"""Rules of a flight: limits, settings, obstacles and checker, from mission file and fences."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from companion.assurance.checker import Checker
from companion.assurance.exposure import Exposure
from companion.config.compose import (
    check_limits_of,
    exposure_of,
    glide_model_of,
    goals_of,
    landing_places_of,
    planner_settings_of,
    vehicle_within,
)
from companion.config.models import MissionConfig
from companion.config.sections.terrain_map import ground_heights_of
from companion.mission.glide.landing_choice import GlideOptions, Place
from companion.planning.comparators import METHODS
from companion.planning.problem import GoalRegion
from companion.planning.settings import PlannerSettings
from companion.types.state import AutopilotSettings
from companion.types.threat import Obstacle
from companion.world.vehicle.vehicle_model import VehicleModel

REPLAN_SHARE = 0.3  # A replan has this share of a first plan's iterations.
COORDINATION_CHANGE = 0.05  # An estimate that changes by less changes no rules: it varies about as much.
LEAST_THREAT_WEIGHTS = (0.1, 0.1, 0.8)  # Weights D_γ of (9) in an emergency.


@dataclass(frozen=True, slots=True)
class Rules:
    """Rules that plans and missions must follow; :func:`rules_of` makes them.

    Parameters
    ----------
    mission : MissionConfig
        Mission file in force, with the values set by the pilot.
    fences : tuple of Obstacle
        Fences of the autopilot, as obstacles.
    goals : tuple of GoalRegion
        Goals of the mission file, in order.
    obstacles : tuple of Obstacle
        Obstacles of the mission file, and the fences.
    vehicle : VehicleModel
        Performance of the aircraft.
    settings : PlannerSettings
        Settings of a plan when no path is flown that it could improve.
    replan_settings : PlannerSettings
        Settings of a plan while a path is flown; they have fewer iterations.
    least_threat_settings : PlannerSettings
        Settings of an emergency plan: threats have no limit, and the largest weight in (9). If the method is
        another package's planner, emergency plans are those of Safe-RRT.
    checker : Checker
        The independent check.
    exposure : Exposure
        Model by which the check computes threat levels.
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
        """Height of a two-dimensional mission [m]."""
        return float(self.mission.start.up_m)

    @property
    def obstacle_checker(self) -> Checker:
        """The check without the ground of a map, for what ends on the ground."""
        if self.checker.ground is None:
            return self.checker
        return Checker(self.obstacles, self.checker.limits, self.exposure)

    @property
    def time_horizon_s(self) -> float:
        """Longest time between two plans [s]."""
        return float(self.mission.planning.time_horizon_s)

    def glide_options(
        self, home_enu_m: Place | None = None, rally_points_enu_m: tuple[Place, ...] = ()
    ) -> GlideOptions | None:
        """Return what a choice of fields depends on; None if the mission file has no section ``glide``.

        Parameters
        ----------
        home_enu_m : tuple of float, optional
            Home; by default the start's place on the ground [m].
        rally_points_enu_m : tuple of tuple of float
            Rally points, at flying height [m].
        """
        model, glide = glide_model_of(self.mission), self.mission.glide
        if model is None or glide is None:
            return None
        people = tuple(np.array(area.polygon_enu_m, dtype=np.float64) for area in glide.people)
        places = landing_places_of(self.mission, home_enu_m, rally_points_enu_m)
        flat_m, ground = 0.0 if home_enu_m is None else home_enu_m[2], ground_heights_of(self.mission)
        return GlideOptions(model, places, people, self.obstacles, self.obstacle_checker, flat_m, ground)


def rules_of(
    mission: MissionConfig, fences: tuple[Obstacle, ...] = (), reported: AutopilotSettings | None = None,
    coordination: float | None = None,
) -> Rules:  # fmt: skip
    """Compose the rules of a flight.

    Parameters
    ----------
    mission : MissionConfig
        Mission file in force.
    fences : tuple of Obstacle
        Fences of the autopilot, as obstacles.
    reported : AutopilotSettings, optional
        Settings of the autopilot, whose limits of bank, airspeed, climb and descent the rules never exceed.
    coordination : float, optional
        Rate of turn as a share of that of a coordinated turn; by default that of the mission file. The check
        takes it for larger by :data:`COORDINATION_CHANGE`: flown paths pass while it changes by less.
    """
    reported = reported or AutopilotSettings()
    vehicle = vehicle_within(mission, reported, coordination)
    lenient = min(vehicle.coordination + COORDINATION_CHANGE, 1.0)
    limits = check_limits_of(mission, vehicle_within(mission, reported, lenient))
    settings, exposure = planner_settings_of(mission), exposure_of(mission)
    obstacles = (*mission.obstacle_list, *fences)
    # Another package's planner makes ordinary plans only: what is flown where its paths are refused is ours.
    emergency_settings = settings if settings.method in METHODS else planner_settings_of(mission, "safe-rrt")
    return Rules(
        mission=mission,
        fences=fences,
        goals=goals_of(mission),
        obstacles=obstacles,
        vehicle=vehicle,
        settings=settings,
        replan_settings=replace(settings, max_iterations=int(REPLAN_SHARE * settings.max_iterations)),
        least_threat_settings=replace(
            emergency_settings,
            threat_level_max=1.0,
            seen_max_s=math.inf,
            weights_cost=LEAST_THREAT_WEIGHTS,
        ),
        checker=Checker(obstacles, limits, exposure, ground_heights_of(mission)),
        exposure=exposure,
    )
