"""The map under every picture: obstacles, threat field, radars, start and goals, north and scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Polygon
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from companion.config.models import MissionConfig
from companion.plain_text import printable
from companion.types.threat import Obstacle
from companion.ui.reports import style
from companion.world.ground.cell_lookup import has_ground
from companion.world.snapshot import Snapshot
from companion.world.threat_field import threat_field

MAP_LONG_IN = 8.4
SIDE_IN = 3.0
GROUND_CONTOURS = 10  # Approximate number of contours of the ground.
NUM_RADAR_LABELS_MAX = 24


@dataclass
class MapSheet:
    """A map, and the panel beside it that holds what would cover the map.

    Parameters
    ----------
    figure : Figure
        The whole sheet.
    axes, side : Axes
        Map in metres east and north; empty panel for legend and colour bars.
    labels : style.Labels
        Texts on the map.
    height_m : float
        Height at which the world is cut [m, up].
    handles : list
        Legend entries so far.
    """

    figure: Figure
    axes: Axes
    side: Axes
    labels: style.Labels
    height_m: float
    handles: list[Line2D | Patch]
    num_bars: int = 0

    def entry(self, label: str, **look: Any) -> None:  # noqa: ANN401
        """Add a line or marker to the legend."""
        self.handles.append(Line2D([], [], label=label, **look))

    def bar(self, colours: ScalarMappable, label: str, *, is_clock: bool = False) -> None:
        """Add a colour bar to the panel."""
        place = self.side.inset_axes((0.06, 0.05 + 0.115 * self.num_bars, 0.86, 0.022))
        bar = self.figure.colorbar(colours, cax=place, orientation="horizontal")
        outline: Any = bar.outline
        outline.set_linewidth(0.4)
        if is_clock:
            low, high = colours.get_clim()
            ticks = np.linspace(float(low or 0.0), float(high or 0.0), 5)
            bar.set_ticks(list(ticks), labels=[style.clock_text(float(t)) for t in ticks])
        place.tick_params(labelsize=7.5, length=2)
        place.set_title(label, fontsize=8.5, fontweight="normal", pad=4)
        self.num_bars += 1

    def finish(self) -> None:
        """Write the legend; call once, last."""
        self.side.legend(
            handles=self.handles,
            loc="upper left",
            bbox_to_anchor=(0.0, 1.01),
            labelspacing=0.75,
            handlelength=2.2,
        )


def new_sheet(mission: MissionConfig, snapshot: Snapshot, height_m: float, title: str) -> MapSheet:
    """Return a sheet with the world drawn on it."""
    east_low, east_high, north_low, north_high = snapshot.bounds[:4]
    ratio = (north_high - north_low) / (east_high - east_low)
    width = MAP_LONG_IN / max(ratio, 1.0)
    height = min(max(MAP_LONG_IN * min(ratio, 1.0), 4.6), MAP_LONG_IN)
    figure = style.new_figure(width + SIDE_IN + 1.0, height + 1.25)
    left = 0.75 / (width + SIDE_IN + 1.0)
    grid = GridSpec(
        1, 2, figure=figure, width_ratios=(width, SIDE_IN), wspace=0.04,
        left=left, right=0.995, bottom=0.55 / (height + 1.25), top=1.0 - 0.7 / (height + 1.25),
    )  # fmt: skip
    axes, side = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    side.axis("off")
    axes.set_anchor("W")
    draw_frame(axes, snapshot)
    axes.apply_aspect()  # This fixes the map's size, on which the labels depend.
    figure.suptitle(printable(title), x=left, y=0.985, ha="left", fontsize=13, fontweight="bold")
    sheet = MapSheet(figure, axes, side, style.Labels(axes), height_m, [])
    draw_world(sheet, mission, snapshot)
    return sheet


def draw_frame(axes: Axes, snapshot: Snapshot) -> None:
    """Set limits, grid, axis labels, north arrow and scale."""
    east_low, east_high, north_low, north_high = snapshot.bounds[:4]
    axes.set_xlim(east_low, east_high)
    axes.set_ylim(north_low, north_high)
    axes.set_aspect("equal")
    axes.grid(visible=True)
    axes.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 2.5, 5, 10]))
    axes.set_xlabel("east [m]")
    axes.set_ylabel("north [m]")
    span = east_high - east_low
    length = style.round_step(span, 6)
    above = axes.get_xaxis_transform()
    axes.plot([east_high - length, east_high], [1.018] * 2, color=style.INK, lw=2.2, transform=above,
              clip_on=False, solid_capstyle="butt")  # fmt: skip
    text = f"{length / 1000.0:g} km" if length >= 1000.0 else f"{length:g} m"
    axes.text(east_high - 0.5 * length, 1.024, text, ha="center", va="bottom", fontsize=8, transform=above)
    arrow = east_high - length - 0.035 * span
    axes.annotate(
        "", xy=(arrow, 1.055), xytext=(arrow, 1.006), xycoords=above, annotation_clip=False,
        arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.2, "mutation_scale": 11},
    )  # fmt: skip
    axes.text(
        arrow - 0.012 * span,
        1.03,
        "N",
        ha="right",
        va="center",
        fontsize=9,
        fontweight="bold",
        transform=above,
    )


def draw_world(sheet: MapSheet, mission: MissionConfig, snapshot: Snapshot) -> None:
    """Draw the threat field, obstacles, radars, start and goals."""
    if snapshot.radar_list:
        east, north, level = threat_field(snapshot, sheet.height_m)
        half = 0.5 * float(east[1] - east[0])
        limits = sheet.axes.get_xlim(), sheet.axes.get_ylim()
        image = sheet.axes.imshow(
            level, cmap=style.THREAT_MAP, vmin=0.0, vmax=1.0, origin="lower", interpolation="bilinear",
            extent=(east[0] - half, east[-1] + half, north[0] - half, north[-1] + half), zorder=0.5,
        )  # fmt: skip
        sheet.axes.set(xlim=limits[0], ylim=limits[1])
        sheet.bar(image, f"radar threat μ at {sheet.height_m:.0f} m up, masked")
    _draw_ground(sheet, snapshot)
    draw_obstacles(sheet, snapshot)
    _draw_radars(sheet, snapshot)
    _draw_ends(sheet, mission)


def _draw_ground(sheet: MapSheet, snapshot: Snapshot) -> None:
    """Draw contours of the ground, where it is known, with their heights."""
    ground = snapshot.obstacles.ground
    if not has_ground(ground):
        return
    east, north = (
        ground.grid[axis] + ground.grid[2] * (0.5 + np.arange(ground.high.shape[axis])) for axis in range(2)
    )
    limits = sheet.axes.get_xlim(), sheet.axes.get_ylim()
    lines = sheet.axes.contour(
        east, north, 0.5 * (ground.high + ground.low).T, GROUND_CONTOURS, colors=style.GROUND, linewidths=0.5,
        zorder=0.8,
    )  # fmt: skip
    sheet.axes.clabel(lines, fmt="%.0f", fontsize=5)
    sheet.axes.set(xlim=limits[0], ylim=limits[1])


def draw_obstacles(sheet: MapSheet, snapshot: Snapshot) -> None:
    """Draw prisms; those clear of the section's height lighter; with their tops where there is room."""
    for blocks, colour, label in (
        (True, style.OBSTACLE, "obstacle at this height" if snapshot.dimension == 3 else "obstacle"),
        (False, style.OBSTACLE_CLEAR, "obstacle above or below it"),
    ):
        group = [o for o in snapshot.obstacle_list if (o.base_m <= sheet.height_m <= o.top_m) == blocks]
        if not group:
            continue
        patches = [Polygon(o.polygon_enu_m) for o in group]
        sheet.axes.add_collection(
            PatchCollection(patches, facecolor=colour, edgecolor="white", linewidth=0.4, zorder=3),
            autolim=False,
        )
        sheet.handles.append(Patch(facecolor=colour, edgecolor="none", label=label))
        if snapshot.dimension == 3:
            for obstacle in group:
                _write_top(sheet, obstacle, "white" if blocks else style.INK)


def _write_top(sheet: MapSheet, obstacle: Obstacle, colour: str) -> None:
    """Write a prism's top into it, if it is wide enough for the figures."""
    low, high = obstacle.polygon_enu_m.min(axis=0), obstacle.polygon_enu_m.max(axis=0)
    corners = sheet.axes.transData.transform([low, high])
    width, height = (corners[1] - corners[0]) * 72.0 / sheet.figure.dpi
    if min(width, height) < 9.0 or max(width, height) < 20.0 or len(obstacle.polygon_enu_m) != 4:
        return
    middle = 0.5 * (low + high)
    text: Text = sheet.axes.text(
        middle[0], middle[1], f"{obstacle.top_m:.0f}", ha="center", va="center", fontsize=6.5, color=colour,
        rotation=0 if width >= 20.0 else 90, zorder=4,
    )  # fmt: skip
    text.set_clip_on(True)


def _draw_radars(sheet: MapSheet, snapshot: Snapshot) -> None:
    for radar in snapshot.radar_list:
        east, north, _ = radar.position_enu_m
        sheet.axes.add_patch(
            Circle(
                (east, north),
                radar.max_threat_radius_m,
                fill=False,
                ls=(0, (5, 3)),
                lw=0.9,
                ec=style.RADAR,
                zorder=2.5,
            )
        )
        sheet.axes.plot(east, north, "^", ms=7, color=style.RADAR, mec="white", mew=0.8, zorder=6)
        sheet.labels.reserve(east, north)
    if len(snapshot.radar_list) <= NUM_RADAR_LABELS_MAX:
        for radar in snapshot.radar_list:
            sheet.labels.put(*radar.position_enu_m[:2], radar.name, style.RADAR)
    if snapshot.radar_list:
        sheet.entry(
            "radar and its largest range", marker="^", color=style.RADAR, ls=(0, (5, 3)), lw=0.9, ms=6
        )


def _draw_ends(sheet: MapSheet, mission: MissionConfig) -> None:
    start = mission.start
    course = math.radians(start.course_deg)
    reach = 0.035 * (sheet.axes.get_xlim()[1] - sheet.axes.get_xlim()[0])
    sheet.axes.annotate(
        "", xy=(start.east_m + reach * math.sin(course), start.north_m + reach * math.cos(course)),
        xytext=(start.east_m, start.north_m), zorder=7,
        arrowprops={"arrowstyle": "->", "color": style.START, "lw": 1.6},
    )  # fmt: skip
    sheet.axes.plot(
        start.east_m, start.north_m, "D", ms=8, color=style.START, mec="white", mew=1.0, zorder=11
    )
    sheet.labels.reserve(start.east_m, start.north_m, 7.0)
    sheet.entry("start and its course", marker="D", color=style.START, ls="none", ms=7)
    for number, goal in enumerate(mission.goals, 1):
        place = (float(goal.east_m), float(goal.north_m))
        sheet.axes.add_patch(
            Circle(place, goal.acceptance_radius_m, fc=style.GOAL, alpha=0.18, ec="none", zorder=2.6)
        )
        sheet.axes.add_patch(
            Circle(place, goal.acceptance_radius_m, fill=False, ec=style.GOAL, lw=1.2, zorder=7)
        )
        sheet.axes.plot(*place, "D", ms=8, color=style.GOAL, mec="white", mew=1.0, zorder=11)
        sheet.labels.reserve(*place, 7.0)
        if len(mission.goals) > 1:
            sheet.labels.put(*place, f"goal {number}", style.GOAL, offset_pt=9.0)
    sheet.entry("goal and its acceptance circle", marker="D", color=style.GOAL, ls="none", ms=7)


def clock_colours(low_s: float, high_s: float) -> ScalarMappable:
    """Return the colours of mission times."""
    return ScalarMappable(norm=Normalize(low_s, max(high_s, low_s + 1.0)), cmap=style.MISSION_MAP)
