"""Summaries of a mission file as the program understood it, as JSON and as a table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table
from rich.text import Text

from companion.config import MissionConfig
from companion.config.compose import energy_budget_of, goals_of, wind_of
from companion.config.rules import rules_of
from companion.config.sections.ground_summary import (
    ground_document,
    ground_words,
    over_ground_words,
    straight_way,
)
from companion.mission.energy_budget import EnergyBudget
from companion.mission.glide.glide_coverage import Coverage, coverage_of_legs, coverage_of_path
from companion.plain_text import printable
from companion.types.path import Path


def summary_parts(mission: MissionConfig) -> Iterator[Table | str]:
    """Yield what ``companion check`` prints of a valid mission file."""
    if mission.goals_from_autopilot:
        yield f"{mission.name}: valid; its goals are the operator's waypoints in the autopilot"
        return
    yield summary_table(mission)
    if (budget := mission_budget(mission)) is not None:
        yield energy_table(mission, budget)
    if (coverage := mission_coverage(mission)) is not None:
        yield f"glide, straight legs: {coverage.words}"


def mission_summary(mission: MissionConfig) -> dict[str, object]:
    """Return the JSON of ``companion check``; positions are east, north, up of the origin [m]."""
    start = mission.start
    summary: dict[str, object] = {
        "name": mission.name,
        "dimension": mission.dimension,
        "origin": {
            "lat_deg": mission.origin.latitude_deg,
            "lon_deg": mission.origin.longitude_deg,
            "alt_amsl_m": mission.origin.altitude_amsl_m,
        },
        "start_enu_m": [start.east_m, start.north_m, start.up_m],
        "start_course_deg": start.course_deg,
        "goals_enu_m": [[goal.east_m, goal.north_m, goal.up_m] for goal in mission.goals],
        "bounds_enu_m": [
            list(mission.bounds.east_m),
            list(mission.bounds.north_m),
            list(mission.bounds.up_m),
        ],
        "obstacles": [entry.model_dump(mode="json") for entry in mission.obstacles],
        "radars": [
            {
                "name": radar.name,
                "position_enu_m": [radar.east_m, radar.north_m, radar.up_m],
                "max_threat_radius_m": radar.max_threat_radius_m,
                "boundary_coefficient_per_m": radar.boundary_coefficient_per_m,
                "model": radar.model,
            }
            for radar in mission.radars
        ],
        "dynamic_threats": [
            {
                "name": threat.name,
                "position_enu_m": [threat.east_m, threat.north_m, threat.up_m],
                "speed_m_s": threat.speed_m_s,
                "max_threat_radius_m": threat.max_threat_radius_m,
            }
            for threat in mission.dynamic_threats
        ],
    }
    budget, coverage, ground = mission_budget(mission), mission_coverage(mission), ground_document(mission)
    if ground is not None:
        summary["ground"] = ground
    if budget is not None:
        summary["energy"] = _energy_document(mission, budget)
    if coverage is not None:
        summary["glide"] = coverage.document()
    return summary


def mission_budget(mission: MissionConfig) -> EnergyBudget | None:
    """Return the budget of the mission file's goals; None without goals or without a section ``energy``."""
    return None if mission.goals_from_autopilot else energy_budget_of(mission, goals_of(mission))


def mission_coverage(mission: MissionConfig, path: Path | None = None) -> Coverage | None:
    """Return the fields within glide along the straight legs to the goals, or along a path.

    The result is None without goals or without a section ``glide``. The wind is the mission file's, and home
    is the start's place.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    path : Path, optional
        A planned path.
    """
    options = None if mission.glide is None else rules_of(mission).glide_options()
    if options is None or (path is None and mission.goals_from_autopilot):
        return None
    if path is not None:
        return coverage_of_path(options, path, wind_of(mission))
    start = mission.start
    places = [(start.east_m, start.north_m, start.up_m)]
    places += [(goal.east_m, goal.north_m, goal.up_m) for goal in mission.goals]
    return coverage_of_legs(options, places, mission.vehicle.airspeed_cruise_m_s, wind_of(mission))


def _energy_document(mission: MissionConfig, budget: EnergyBudget) -> dict[str, object]:
    return {
        "on_board_wh": budget.on_board_wh,
        "reserve_wh": budget.reserve_wh,
        "wind_enu_m_s": [round(speed, 3) for speed in wind_of(mission)],
        "goals": [
            {
                "used_wh": round(goal.used_wh, 3),
                "left_wh": round(goal.left_wh, 3),
                "left_after_return_wh": round(goal.left_after_return_wh, 3),
            }
            for goal in budget.goals
        ],
        "margin_at_goal_wh": round(budget.margin_at_goal_wh, 3),
        "margin_after_return_wh": round(budget.margin_after_return_wh, 3),
    }


def energy_table(mission: MissionConfig, budget: EnergyBudget) -> Table:
    """Return the energy at each goal for the terminal, with the verdict as caption."""
    speed, wind_from = mission.simulation.wind_speed_m_s, mission.simulation.wind_from_deg
    air = f"wind {speed:g} m/s from {wind_from:g}°" if speed > 0.0 else "no wind"
    table = Table(
        title=f"energy: {budget.on_board_wh:g} Wh at the start, straight legs at cruise, {air}",
        caption=budget.verdict,
    )
    for column in ("goal", "used", "left", "left after a straight flight back", "beyond the reserve"):
        table.add_column(column, justify="right")
    for number, goal in enumerate(budget.goals, 1):
        beyond_wh = goal.left_after_return_wh - budget.reserve_wh
        numbers = (goal.used_wh, goal.left_wh, goal.left_after_return_wh, beyond_wh)
        table.add_row(str(number), *(f"{value:.1f} Wh" for value in numbers))
    return table


def summary_table(mission: MissionConfig) -> Table:
    """Return a short summary for the terminal."""
    title = printable(f"{mission.name}: {mission.description or 'no description'}")
    table = Table(title=Text(title, style="table.title"), show_header=False)
    start, vehicle = mission.start, mission.vehicle
    straight = float(np.hypot(*np.diff(straight_way(mission)[:, :2], axis=0).T).sum())
    table.add_row("dimension", f"{mission.dimension}")
    table.add_row("origin", f"{mission.origin.latitude_deg:.6f}, {mission.origin.longitude_deg:.6f}")
    over = over_ground_words(mission)
    where = f"{start.east_m:g} E, {start.north_m:g} N, {start.up_m:g} m up, {start.course_deg:g}°"
    table.add_row("start", where + next(over))
    for number, entry in enumerate(mission.goals, 1):
        where = f"{entry.east_m:g} E, {entry.north_m:g} N, {entry.up_m:g} m up"
        where += f", within {entry.acceptance_radius_m:g} m"
        table.add_row(f"goal {number}", where + next(over))
    way = f"{straight:.0f} m, {straight / vehicle.airspeed_cruise_m_s:.0f} s at cruise"
    table.add_row("straight way", way + next(over))
    table.add_row(
        "aircraft",
        f"{vehicle.airspeed_min_m_s:g} to {vehicle.airspeed_max_m_s:g} m/s, "
        f"turn radius {vehicle.turn_radius_min_m:g} m",
    )
    if mission.terrain is not None:
        table.add_row("ground", ground_words(mission))
    table.add_row("obstacles", str(len(mission.obstacles)))
    table.add_row("radars", str(len(mission.radars)))
    table.add_row("moving threats", str(len(mission.dynamic_threats)))
    table.add_row("planner", f"{mission.planning.method}, every {mission.planning.time_horizon_s:g} s")
    return table
