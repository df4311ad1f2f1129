"""What the planner answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from companion.frames import FloatArray
from companion.types.path import Path
from companion.types.threat import ThreatTree


class PlanStatus(Enum):
    """How a solve ended."""

    EXACT = "exact"  # the goal is reached
    APPROXIMATE = "approximate"  # a path towards the goal that does not reach it
    INVALID_START = "invalid_start"  # the start state breaks a constraint


@dataclass(frozen=True, slots=True)
class Measures:
    """The measures of the paper's tables for one plan (its section 5.3)."""

    path_search_time_s: float = 0.0  # PST
    num_collision_checks: int = 0  # NCDC
    num_tree_nodes: int = 0  # NTN
    path_cost: float = float("inf")  # PC, sum of (9), planning units
    quality: float = 0.0  # Q, (8)
    total_threat_amount: float = 0.0  # TTA
    aggregated_threat: float = 0.0  # ATP
    num_high_threat_waypoints: int = 0  # NHTW
    penetration_success: float = 0.0  # PSR, by (3) over stretches under threat

    @property
    def extension_success_rate(self) -> float:
        """ESR: tree nodes a collision check."""
        return self.num_tree_nodes / self.num_collision_checks if self.num_collision_checks else 0.0

    @property
    def search_iteration_time_s(self) -> float:
        """TSI: search time a collision check [s]."""
        return self.path_search_time_s / self.num_collision_checks if self.num_collision_checks else 0.0


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """What the search looked like, for pictures; nothing decides on it.

    Parameters
    ----------
    tree_enu_m : ndarray, shape (N, 3)
        Tree nodes [m]; ``tree_parents`` (N,) their parents, -1 at roots.
    threat_tree_enu_m : ndarray, shape (M, 2)
        Nodes of all DT trees [m]; ``threat_tree_parents`` (M,) likewise.
    reach_circles_enu_m : ndarray, shape (K, 3)
        East, north, radius of each directly reachable node's circle [m].
    sub_goals_enu_m, horizon_centres_enu_m : ndarray, shape (S, 3)
        Sub goals and the centres of the sensing horizons they were chosen on [m].
    """

    tree_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    tree_parents: np.ndarray[tuple[int], np.dtype[np.int64]] = field(
        default_factory=lambda: np.empty(0, dtype=np.int64)
    )
    threat_tree_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    threat_tree_parents: np.ndarray[tuple[int], np.dtype[np.int64]] = field(
        default_factory=lambda: np.empty(0, dtype=np.int64)
    )
    reach_circles_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    sub_goals_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    horizon_centres_enu_m: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True, slots=True)
class PursuitRisk:
    """What moving threats that knew the whole path could do (paper 2.3).

    Parameters
    ----------
    first_s : float
        t_f, the earliest moment at which one could threaten the aircraft, by the clock; infinite where none
        ever could: such a path is safe whatever they do [s].
    total_s : float
        For how long in all one could [s].
    """

    first_s: float = float("inf")
    total_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Plan:
    """The planner's answer: a status, and a path where there is one.

    ``flown_cost`` and ``flown_threat`` are the :attr:`cost` and the largest threat level of what is left
    of the path being flown, seen in the same world as the new path, where one was given.
    ``objective_s`` is J of the path, ``seen_s`` the integral of radars' membership over it, and ``bound_s``
    the least J that a path could have, where the search went by J [s].
    ``pursuit`` and ``flown_pursuit`` say what moving threats could do to either.
    ``threat_trees`` are the DTs' trees as grown, for the next plan's snapshot.
    """

    status: PlanStatus
    path: Path | None
    measures: Measures
    seed: int
    method: str
    snapshot_number: int
    trace: SearchTrace = field(default_factory=SearchTrace)
    notes: tuple[str, ...] = ()
    flown_cost: float | None = None
    flown_threat: float | None = None
    pursuit: PursuitRisk = PursuitRisk()
    flown_pursuit: PursuitRisk | None = None
    threat_trees: tuple[ThreatTree, ...] = ()
    objective_s: float = float("inf")
    seen_s: float = 0.0
    bound_s: float | None = None

    @property
    def cost(self) -> float:
        """What the plan is compared by: J where the search went by it, else the sum of (9)."""
        return self.measures.path_cost if self.bound_s is None else self.objective_s

    @property
    def gap(self) -> float | None:
        """By what share of the lower bound the path costs more at most; None where no bound is known."""
        if self.bound_s is None or not 0.0 < self.bound_s < float("inf"):
            return None
        return self.objective_s / self.bound_s - 1.0

    @property
    def reaches_goal(self) -> bool:
        """Whether the path ends at the goal."""
        return self.status is PlanStatus.EXACT
