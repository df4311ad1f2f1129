"""A plan seen at a slant: prisms, tree and path in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from companion.config.models import MissionConfig
from companion.frames import FloatArray
from companion.types.plan import Plan
from companion.types.threat import Obstacle
from companion.ui.reports import style
from companion.world.snapshot import Snapshot

ELEVATION_DEG, AZIMUTH_DEG = 42.0, -62.0
CIRCLE_POINTS = 73


def prism_faces(obstacle: Obstacle) -> list[FloatArray]:
    """Walls and roof of a prism, each of shape (K, 3)."""
    ring = obstacle.polygon_enu_m
    low = np.column_stack([ring, np.full(len(ring), obstacle.base_m)])
    high = np.column_stack([ring, np.full(len(ring), obstacle.top_m)])
    following = np.roll(np.arange(len(ring)), -1)
    walls = [np.array([low[i], low[j], high[j], high[i]]) for i, j in enumerate(following)]
    return [*walls, high]


def draw_perspective(
    figure: Figure, place: SubplotSpec, mission: MissionConfig, snapshot: Snapshot, plan: Plan
) -> None:
    """Draw the plan in perspective into a part of a figure."""
    axes: Any = figure.add_subplot(place, projection="3d", computed_zorder=False)
    bounds = snapshot.bounds
    _set_box(axes, bounds)
    faces = [face for obstacle in snapshot.obstacle_list for face in prism_faces(obstacle)]
    if faces:
        axes.add_collection3d(
            Poly3DCollection(
                faces,
                facecolor=style.OBSTACLE_CLEAR,
                edgecolor=style.MUTED,
                linewidth=0.3,
                alpha=0.45,
                zorder=2,
            )
        )
    ground = max(bounds[4], 0.0)
    for radar in snapshot.radar_list:
        ring = circle(radar.position_enu_m[:2], radar.max_threat_radius_m)
        inside = (
            (ring[:, 0] >= bounds[0])
            & (ring[:, 0] <= bounds[1])
            & (ring[:, 1] >= bounds[2])
            & (ring[:, 1] <= bounds[3])
        )
        ring[~inside] = np.nan
        axes.plot(ring[:, 0], ring[:, 1], ground, color=style.RADAR, lw=0.9, ls=(0, (5, 3)), zorder=1)
        axes.plot(*radar.position_enu_m[:2], ground, "^", color=style.RADAR, ms=6, mec="white", zorder=3)
    trace = plan.trace
    threat_nodes = np.column_stack([trace.threat_tree_enu_m, np.full(len(trace.threat_tree_enu_m), ground)])
    for nodes, parents, colour, width in (
        (threat_nodes, trace.threat_tree_parents, style.DYNAMIC, 0.4),
        (trace.tree_enu_m, trace.tree_parents, style.TREE, 0.5),
    ):
        if len(nodes):
            lines = style.tree_lines(nodes, parents)
            axes.add_collection3d(
                Line3DCollection(lines, colors=colour, linewidths=width, alpha=0.75, zorder=4)
            )
    _draw_path(axes, mission, plan, ground)


def circle(centre_m: tuple[float, float], radius_m: float) -> FloatArray:
    """Points, shape (K, 2), of a closed circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS)
    return np.column_stack([centre_m[0] + radius_m * np.cos(angle), centre_m[1] + radius_m * np.sin(angle)])


def _draw_path(axes: Any, mission: MissionConfig, plan: Plan, ground_m: float) -> None:  # noqa: ANN401
    """Draw the path, its shadow on the ground and plumb lines between them: they show its height."""
    if plan.path is not None:
        path = plan.path.positions_enu_m
        axes.plot(path[:, 0], path[:, 1], ground_m, color=style.MUTED, lw=1.0, ls=":", zorder=4)
        step = max(1, len(path) // 24)
        plumb = [np.array([[*p[:2], ground_m], p]) for p in path[::step]]
        axes.add_collection3d(
            Line3DCollection(plumb, colors=style.MUTED, linewidths=0.5, alpha=0.7, zorder=5)
        )
        axes.plot(path[:, 0], path[:, 1], path[:, 2], color=style.GOAL, lw=2.4, zorder=6)
    if len(plan.trace.sub_goals_enu_m):
        axes.plot(
            *plan.trace.sub_goals_enu_m.T, "*", color=style.SUB_GOAL, ms=9, mec="white", mew=0.5, zorder=7
        )
    start = mission.start
    axes.plot(
        [start.east_m], [start.north_m], [start.up_m], "D", color=style.START, mec="white", ms=8, zorder=8
    )
    for goal in mission.goals:
        axes.plot(
            [goal.east_m], [goal.north_m], [goal.up_m], "D", color=style.GOAL, mec="white", ms=8, zorder=8
        )


def _set_box(axes: Any, bounds: tuple[float, ...]) -> None:  # noqa: ANN401
    """Set limits, proportions and labels; heights are drawn larger than they are, and the title says so."""
    width, depth, height = bounds[1] - bounds[0], bounds[3] - bounds[2], bounds[5] - bounds[4]
    long = max(width, depth)
    tall = max(height, 0.3 * long)
    axes.set_box_aspect((width, depth, tall), zoom=1.05)
    axes.set_xlim(bounds[0], bounds[1])
    axes.set_ylim(bounds[2], bounds[3])
    axes.set_zlim(bounds[4], bounds[5])
    axes.view_init(elev=ELEVATION_DEG, azim=AZIMUTH_DEG)
    axes.set_xlabel("east [m]", labelpad=8)
    axes.set_ylabel("north [m]", labelpad=8)
    axes.set_zlabel("up [m]", labelpad=4)
    axes.tick_params(labelsize=7.5, pad=1)
    axes.locator_params(nbins=5)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 1.0))
    if tall > height * 1.05:
        axes.set_title(
            f"heights drawn {tall / height:.1f} times too tall", fontsize=8, fontweight="normal", loc="left"
        )
