"""Planning problems: start, goals, world and settings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.planning.settings import PlannerSettings
from companion.world.snapshot import Snapshot
from companion.world.vehicle.vehicle_model import VehicleModel


@dataclass(frozen=True, slots=True)
class StartState:
    """The start of a plan.

    Parameters
    ----------
    stamp_s : float
        Clock reading at which the aircraft is there.
    position_enu_m : tuple of float
        East, north, up [m].
    direction_rad : float
        Counter-clockwise from east [rad].
    climb_rad : float
        Flight-path angle [rad].
    airspeed_m_s : float
        Within the vehicle's limits.
    error_covariance, estimate_covariance : ndarray, shape (6, 6)
        P and Λ at the start.
    """

    stamp_s: float
    position_enu_m: tuple[float, float, float]
    direction_rad: float
    climb_rad: float
    airspeed_m_s: float
    error_covariance: FloatArray
    estimate_covariance: FloatArray


@dataclass(frozen=True, slots=True)
class GoalRegion:
    """A point to pass within a radius of [m]."""

    position_enu_m: tuple[float, float, float]
    acceptance_radius_m: float


@dataclass(frozen=True, slots=True)
class Problem:
    """Everything a plan depends on; equal problems give equal plans."""

    start: StartState
    goals: tuple[GoalRegion, ...]
    snapshot: Snapshot
    vehicle: VehicleModel
    settings: PlannerSettings
    seed: int


def rows_at_goals(states: FloatArray, goals: Sequence[GoalRegion]) -> list[int]:
    """Return the rows of a path at which it comes to goals in their order, of as many as it comes to.

    Parameters
    ----------
    states : ndarray, shape (N, ≥ 3)
        Positions of its rows in the first three columns [m].
    goals : sequence of GoalRegion
        In the order in which they are to be passed.
    """
    rows: list[int] = []
    for goal in goals:
        first = rows[-1] if rows else 0
        away = np.linalg.norm(states[first:, :3] - np.asarray(goal.position_enu_m), axis=1)
        near = np.flatnonzero(away <= goal.acceptance_radius_m)
        if not len(near):
            break
        rows.append(first + int(near[0]))
    return rows


def goals_on_the_way(goals: Sequence[GoalRegion]) -> FloatArray:
    """Return all goals but the last, in order.

    Returns
    -------
    ndarray, shape (G, 4)
        East, north, up and radius [m].
    """
    rows = [[*goal.position_enu_m, goal.acceptance_radius_m] for goal in goals[:-1]]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def initial_covariances(vehicle: VehicleModel, horizontal_std_m: float, vertical_std_m: float) -> FloatArray:
    """Diagonal P of a start whose position accuracy is known; Λ starts at zero.

    Returns
    -------
    ndarray, shape (6, 6)
        Variances of position [m²], course, climb angle [rad²] and airspeed [m²/s²].
    """
    return np.diag(
        [
            horizontal_std_m**2,
            horizontal_std_m**2,
            vertical_std_m**2,
            vehicle.course_std_rad**2,
            vehicle.climb_std_rad**2,
            0.5**2,  # airspeed: pitot noise of a small aircraft, m/s
        ]
    )
