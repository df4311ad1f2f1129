"""The planner's answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from companion.frames import FloatArray
from companion.types.path import Path
from companion.types.threat import ThreatTree


class PlanStatus(Enum):
    """Result of a search."""

    EXACT = "exact"  # The path reaches the goal.
    APPROXIMATE = "approximate"  # The path leads towards the goal and does not reach it.
    REFUSED = "refused"  # The path reaches the goal, and the independent check refuses it.
    INVALID_START = "invalid_start"  # The start state violates a constraint.


@dataclass(frozen=True, slots=True)
class Measures:
    """Measures of one plan in the paper's tables (section 5.3)."""

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
        """ESR: tree nodes per collision check."""
        return self.num_tree_nodes / self.num_collision_checks if self.num_collision_checks else 0.0

    @property
    def search_iteration_time_s(self) -> float:
        """TSI: search time per collision check [s]."""
        return self.path_search_time_s / self.num_collision_checks if self.num_collision_checks else 0.0


@dataclass(frozen=True, slots=True)
class SearchTrace:
    """The search as drawn in pictures; no decision depends on it.

    Parameters
    ----------
    tree_enu_m : ndarray, shape (N, 3)
        Tree nodes [m]; ``tree_parents`` (N,) are their parents, -1 at roots.
    threat_tree_enu_m : ndarray, shape (M, 2)
        Nodes of all trees of dynamic threats [m]; ``threat_tree_parents`` (M,) likewise.
    reach_circles_enu_m : ndarray, shape (K, 3)
        East, north and radius of each directly reachable node's circle [m].
    sub_goals_enu_m, horizon_centres_enu_m : ndarray, shape (S, 3)
        Sub goals, and the centres of the sensing horizons on which they were chosen [m].
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
    """The risk from moving threats that know the whole path (paper 2.3).

    Parameters
    ----------
    first_s : float
        t_f, the earliest clock reading at which a threat could threaten the aircraft; infinite if none ever
        could, so that the path is safe whatever they do [s].
    total_s : float
        Total time during which a threat could [s].
    """

    first_s: float = float("inf")
    total_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Plan:
    """The planner's answer: a status, and a path if there is one.

    ``flown_cost`` and ``flown_threat`` are the :attr:`cost` and the highest threat level of the rest of the
    flown path in the same world as the new path, if a flown path was given. ``objective_s`` is J of the path,
    ``seen_s`` the integral of radars' membership over it, and ``bound_s`` a lower bound of J, if the search
    minimises J [s]. ``pursuit`` and ``flown_pursuit`` are the risk from moving threats on the two paths.
    ``threat_trees`` are the trees of dynamic threats, for the next plan's snapshot.
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
        """Value by which plans are compared: J if the search minimises it, else the sum of (9)."""
        return self.measures.path_cost if self.bound_s is None else self.objective_s

    @property
    def gap(self) -> float | None:
        """Largest relative excess of the cost over the lower bound; None if no bound is known."""
        if self.bound_s is None or not 0.0 < self.bound_s < float("inf"):
            return None
        return self.objective_s / self.bound_s - 1.0

    @property
    def reaches_goal(self) -> bool:
        """Whether the path ends at the goal."""
        return self.status is PlanStatus.EXACT
