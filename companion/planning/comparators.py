"""Methods by name: Safe-RRT and the comparators, each one composition of strategies (paper 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum, IntEnum

PLAN_ONCE, STRAIGHT_LINE = "plan-once", "straight-line"
FLOWN_METHODS = (PLAN_ONCE, STRAIGHT_LINE)  # Methods of flights that do not replan.
ANYTIME_METHODS = ("ompl-rrt", "ompl-rrt-star", "ompl-bit-star", "ompl-aorrtc")  # Planners of OMPL.


class Certainty(IntEnum):
    """Form of the certainty function (2); the numbers are the kernel's."""

    SHIFTED = 0
    LITERAL = 1
    PROBABILISTIC = 2  # The comparator of Table 5: ν = 0, CF = 1.


class SubGoalRule(Enum):
    """The rule that chooses a sub goal on the sensing horizon."""

    HEURISTIC = "heuristic"  # (4)–(6)
    EUCLIDEAN = "euclidean"  # EDBM: distances only


class Estimator(IntEnum):
    """Reachability-set estimator; the numbers are the kernel's."""

    EX_RRT = 0
    RRT_REACH = 1
    RRT = 2


class Optimiser(Enum):
    """The method that improves a path once the goal is reached."""

    RRT_STAR = "rrt-star"
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Strategies:
    """The strategies that Safe-RRT consists of; a comparator uses other ones (paper 5)."""

    use_dynamic_domain: bool = True
    use_uncertainty: bool = True  # δ_q in (2), p_c in (7), particles about nodes
    use_goal_zoom: bool = True
    follow_field: bool = True  # A share of the samples follows the sub goal's distance field.
    connect_straight: bool = True  # Greedy-Connect to a sub goal that lies in a new node's domain
    use_k_near: bool = True  # Otherwise the nearest node is extended.
    dts_are_no_fly: bool = False
    certainty: Certainty = Certainty.SHIFTED
    sub_goal: SubGoalRule = SubGoalRule.HEURISTIC
    estimator: Estimator = Estimator.EX_RRT
    plays_game: bool = True  # Places that a DT could threaten by then are barred (ours).
    minds_dts: bool = True  # Otherwise the planner ignores DTs.
    may_fly_fast: bool = True  # Airspeeds above cruise are tried, too (ours).
    use_safety_adjustment: bool = True
    optimiser: Optimiser = Optimiser.RRT_STAR
    by_objective: bool = True  # J decides, and the tree grows along V; else (9) and sub goals (ours)

    @property
    def uses_corners(self) -> bool:
        """Whether threat trees begin with the shortest ways round the obstacles' corners (ours)."""
        return self.estimator is Estimator.EX_RRT


# The paper's: DTs are kept away from by threat levels alone.
_PRINTED = Strategies(plays_game=False, may_fly_fast=False, by_objective=False)

_TADDRRT = replace(
    _PRINTED, use_uncertainty=False, use_goal_zoom=False, use_k_near=False, optimiser=Optimiser.NONE
)

_RRT_STAR = replace(
    _PRINTED,
    use_dynamic_domain=False,
    use_uncertainty=False,
    use_goal_zoom=False,
    use_safety_adjustment=False,
)

METHODS: dict[str, Strategies] = {
    "safe-rrt": Strategies(),
    # Ablations: blind to DTs, at cruise whatever pursues, without the game of 2.3, without uncertainty, and
    # without anything that improves a path which reaches the goal.
    "safe-rrt-blind": Strategies(minds_dts=False),
    "safe-rrt-cruise": Strategies(may_fly_fast=False),
    "safe-rrt-rs": _PRINTED,
    "safe-rrt-certain": Strategies(use_uncertainty=False),
    "safe-rrt-first": Strategies(optimiser=Optimiser.NONE),
    # With the paper's samplers.
    "safe-rrt-printed": replace(_PRINTED, follow_field=False, connect_straight=False),
    "taddrrt": _TADDRRT,
    # DTs are no-fly, by the game of 2.3.
    "nfz-ddrrt": replace(_TADDRRT, plays_game=True),
    # By the threat trees, at any speed of the DTs.
    "nfz-ddrrt-printed": replace(_TADDRRT, dts_are_no_fly=True),
    "rrt-star": _RRT_STAR,  # The cost is (9) alone.
    "edbm": replace(_PRINTED, sub_goal=SubGoalRule.EUCLIDEAN),
    "probabilistic": replace(_PRINTED, certainty=Certainty.PROBABILISTIC),
    "rrt-reach": replace(_PRINTED, estimator=Estimator.RRT_REACH),
    "rrt": replace(_PRINTED, estimator=Estimator.RRT),
}


def strategies_of(method: str) -> Strategies:
    """Return the strategies of a method; a planner of another package is measured by those of Safe-RRT."""
    return METHODS.get(method, METHODS["safe-rrt"])
