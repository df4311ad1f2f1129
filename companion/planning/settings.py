"""The planner's settings: weights, budgets and strategies, with the paper's values as defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.kernels.arrays import Limits, Search, ThreatModel
from companion.planning.comparators import METHODS, Certainty, Strategies, strategies_of
from companion.world.vehicle.vehicle_model import VehicleModel

LEVEL_SHARE = 0.9  # Plans keep this share of the limit; the flown path is judged by the whole limit.

# Comparators share what is not their subject: samples that follow the distance field, the connection to the
# goal and restarts. Their budgets are larger than the paper's, since a tree takes more samples where threats
# make paths costly.
SUB_TASK_ITERATIONS, STALL_ITERATIONS = 3_000, 1_200
ITERATIONS_SHARE = 4
STAR_ITERATIONS = 800  # Iterations of RRT* where it is the whole method: its gain has levelled off by then.


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """Parameters of the paper's sections 3 and 4, lengths in metres unless they weigh planning units.

    ``sub_task_iterations`` stands for the time horizon of a sub task, ``max_iterations`` for the
    total planning time where no clock stops the planner; ``optimise_iterations`` is the least
    of RRT*, which in space goes on while it gains, up to ``optimise_iterations_max``;
    ``smooth_iterations`` bounds the short cuts after it. ``flown_meanwhile_s``: how much of the path is
    flown while it is being optimised (a mission swap begins where the aircraft will be by then: 0).
    """

    strategies: Strategies = METHODS["safe-rrt"]
    method: str = "safe-rrt"
    tau_s: float = 1.0
    clearance_min_m: float = 15.0
    clearance_wanted_m: float = 0.0  # Clearance that a path keeps if it costs little (ours); 0: none.
    sensing_horizon_m: float = 825.0
    num_sub_goal_points: int = 60
    sub_goal_tolerance_steps: float = 8.0
    sub_goal_level_max: float = 0.5
    weights_sub_goal: tuple[float, float, float, float] = (0.3, 0.2, 0.3, 0.2)  # C_γ of (5)
    weights_obstacles_2d: tuple[float, float, float] = (0.7, 0.0, 0.3)  # L_γ of (6)
    weights_obstacles_3d: tuple[float, float, float] = (0.7, 0.15, 0.15)
    k_clear: float = 1.0  # k_c of (7)
    k_threat: float = 5.0  # k_T of (7)
    domain_steps: float = 10.0  # DD = 10·le
    weights_cost: tuple[float, float, float] = (0.5, 0.1, 0.4)  # D_γ of (9)
    goal_zoom: float = 0.3
    guided_share: float = 0.2
    guided_steps: float = 8.0  # Largest distance of these samples ahead of a node, in units of le.
    p_tid: float = 0.5
    k_pursuer: int = 3
    num_secondary: int = 10
    weight_count: float = 0.7  # ω_N of (2)
    weight_delta: float = 0.3  # ω_δ
    exponent: float = 1.0  # ω_C
    certain: float = 0.999
    adjust_collision_max: float = 0.5
    threat_level_max: float = 1.0
    quality_min: float = 0.0  # Least Q (8); no optimiser takes a path below it.
    cost_collision: float = 10.0  # Factor of −log p_c in (9): at p_c 0.9 it costs as much as two steps.
    price_seen: float = 3.0  # Price in J of a second seen by radars.
    price_pursued: float = 3.0  # Price of a second within a moving threat's reach.
    price_near: float = 6.0  # Price of a second without any clearance.
    price_energy: float = 0.35  # Price of a second at twice the power of cruise; below 1/3, fast is cheaper.
    price_collision: float = 20.0  # Price of −log p_c.
    seen_max_s: float = math.inf  # Longest uninterrupted time in radars' sight.
    pursuit_slack_s: float = 3.0  # Time by which a place is passed before a DT arrives.
    pursuit_slack_min_s: float = 0.5  # The same where no path leaves more time.
    sub_task_iterations: int = 800
    stall_iterations: int = 300
    max_iterations: int = 60_000
    optimise_iterations: int = 80
    optimise_iterations_max: int = 800
    smooth_iterations: int = 200
    flown_meanwhile_s: float = 0.0
    burst: int = 100
    tree_capacity: int = 6000

    def threat_model(self, vehicle: VehicleModel, unit_m: float) -> ThreatModel:
        """Kernel form of the A-IFS model."""
        return ThreatModel(
            weight_count=self.weight_count,
            weight_delta=self.weight_delta if self.strategies.use_uncertainty else 0.0,
            exponent=self.exponent,
            form=int(self.strategies.certainty),
            v_min=vehicle.airspeed_min_m_s,
            v_max=vehicle.airspeed_max_m_s,
            v_penetration=vehicle.penetration_speed_m_s,
            unit=unit_m,
        )

    @property
    def soft_clearance_m(self) -> float:
        """Distance from obstacles below which nearness has a price; 0 where only the least is asked."""
        is_more = self.strategies.by_objective and self.clearance_wanted_m > self.clearance_min_m
        return self.clearance_wanted_m if is_more else 0.0

    @property
    def weight_collision(self) -> float:
        """What -log p_c of a waypoint costs, in (9); nothing where uncertainty is left out."""
        return self.cost_collision if self.strategies.use_uncertainty else 0.0

    def search(self, limits: Limits, unit_m: float, tolerance_m: float, *, bars_pursued: bool) -> Search:
        """Kernel form of the local search's weights and switches."""
        chosen = self.strategies
        return Search(
            k_clear=self.k_clear,
            k_threat=self.k_threat,
            domain=self.domain_steps * limits.v_cruise * limits.tau,
            cost_distance=self.weights_cost[0],
            cost_turn=self.weights_cost[1],
            cost_threat=self.weights_cost[2],
            unit=unit_m,
            zoom=self.goal_zoom if chosen.use_goal_zoom else 0.0,
            use_k_near=int(chosen.use_k_near),
            use_domain=int(chosen.use_dynamic_domain),
            use_uncertainty=int(chosen.use_uncertainty),
            no_fly=int(chosen.dts_are_no_fly),
            secondary=self.num_secondary,
            tolerance=tolerance_m,
            certain=self.certain,
            estimator=int(chosen.estimator),
            p_tid=self.p_tid,
            k_pursuer=self.k_pursuer,
            level_max=LEVEL_SHARE * self.threat_level_max if self.threat_level_max < 1.0 else 2.0,
            straight_in=int(chosen.connect_straight),
            bars_pursued=int(bars_pursued),
            cost_collision=self.weight_collision,
        )


def settings_for(
    method: str,
    *,
    certainty: Certainty,
    clearance_min_m: float,
    sensing_horizon_m: float,
    max_iterations: int,
    threat_level_max: float = 1.0,
    quality_min: float = 0.0,
    clearance_wanted_m: float = 0.0,
) -> PlannerSettings:
    """Settings of a method, whose name was checked; prices and limits of J are the defaults."""
    strategies = strategies_of(method)
    if strategies.certainty is not Certainty.PROBABILISTIC:
        strategies = replace(strategies, certainty=certainty)
    chosen = PlannerSettings(
        strategies=strategies,
        method=method,
        clearance_min_m=clearance_min_m,
        sensing_horizon_m=sensing_horizon_m,
        max_iterations=max_iterations,
        threat_level_max=threat_level_max,
        quality_min=quality_min,
        clearance_wanted_m=clearance_wanted_m,
    )
    return chosen if strategies.by_objective else _as_comparator(chosen)


def _as_comparator(chosen: PlannerSettings) -> PlannerSettings:
    """Return the settings with the budgets of comparators."""
    star = STAR_ITERATIONS if chosen.method == "rrt-star" else chosen.optimise_iterations
    return replace(
        chosen,
        sub_task_iterations=SUB_TASK_ITERATIONS,
        stall_iterations=STALL_ITERATIONS,
        max_iterations=ITERATIONS_SHARE * chosen.max_iterations,
        optimise_iterations=star,
    )
