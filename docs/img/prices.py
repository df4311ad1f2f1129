"""Draw one map at five prices of a second in radars' sight, to ``prices.png`` beside this file."""

import math
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.patches import Circle, Polygon

from companion.config.load import load_mission
from companion.config.offline_problem import offline_problem, offline_world
from companion.planning.solver import solve

HERE = Path(__file__).parent
MAP = HERE.parents[1] / "mission_configs" / "paper-2d.yaml"
PRICES = 0.0, 1.0, 3.0, 10.0, 30.0


def main() -> None:
    """Plan at each price on the paper's planar map without its pursuer, every radar known."""
    mission = load_mission(MAP)
    problem = offline_problem(mission, offline_world(mission).with_tracks(0.0, ()), None, seed=1)
    threats = problem.snapshot.threats
    problem = replace(problem, snapshot=problem.snapshot.with_known(np.ones_like(threats.known)))
    figure, axes = pyplot.subplots(figsize=(7.0, 7.0))
    for radar in mission.radar_list:
        circle = Circle(
            radar.position_enu_m[:2], radar.max_threat_radius_m, color="tab:red", alpha=0.08, lw=0
        )
        axes.add_patch(circle)
        axes.plot(*radar.position_enu_m[:2], "^", color="tab:red", ms=8)
    for obstacle in mission.obstacle_list:
        axes.add_patch(Polygon(obstacle.polygon_enu_m, color="0.35"))
    for price, colour in zip(PRICES, pyplot.cm.viridis(np.linspace(0.0, 0.9, len(PRICES))), strict=True):
        plan = solve(replace(problem, settings=replace(problem.settings, price_seen=price)))
        if plan.path is None:
            continue
        places, took_s = plan.path.positions_enu_m, plan.path.times_s[-1] - plan.path.times_s[0]
        gap = math.ceil(100.0 * (plan.gap or 0.0))
        label = f"price {price:g}: {took_s:.0f} s, {plan.seen_s:.1f} s seen, J within {gap} % of the least"
        axes.plot(places[:, 0], places[:, 1], color=colour, lw=2, label=label)
    axes.plot(*problem.start.position_enu_m[:2], "o", color="black")
    axes.plot(*problem.goals[0].position_enu_m[:2], "*", color="black", ms=12)
    axes.set(xlim=(0, 2500), ylim=(0, 2500), aspect="equal", xlabel="east, m", ylabel="north, m")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), frameon=False, fontsize=9)
    axes.set_title("paper-2d without its pursuer: five prices of a second in radars' sight", fontsize=10)
    figure.savefig(HERE / "prices.png", dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    main()
