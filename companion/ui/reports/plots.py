"""Maps of a mission, a plan and a flight; with the elements of the paper's Figs. 7 and 8."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Circle

from companion.config.models import MissionConfig
from companion.config.sections.ground_summary import straight_way
from companion.config.sections.terrain_map import ground_heights_of
from companion.frames import FloatArray
from companion.types.plan import Plan
from companion.types.record import FlightRecord
from companion.ui.reports import style
from companion.ui.reports.basemap import MapSheet, clock_colours, new_sheet
from companion.ui.reports.ground_profile import add_profile
from companion.ui.reports.perspective import draw_perspective
from companion.ui.reports.threats_met import closest_text, nearest_first
from companion.world.snapshot import Snapshot
from companion.world.threat_field import flight_height

NUM_TIME_MARKS = 8
NUM_REACH_CIRCLES_MAX = 400
NUM_BOLD_HORIZONS_MAX = 12


def plot_mission(
    path: Path, mission: MissionConfig, snapshot: Snapshot, items_enu_m: FloatArray | None = None
) -> None:
    """Draw what a mission file describes, as a PNG.

    Over ground a profile shows the straight way, or the operator's items if their positions are given.

    Parameters
    ----------
    path : Path
        The picture.
    mission : MissionConfig
        The mission file.
    snapshot : Snapshot
        The mission file's world.
    items_enu_m : ndarray, shape (N, 3), optional
        Positions of the operator's items [m].
    """
    with style.drawing():
        height = min(max(float(mission.start.up_m), snapshot.bounds[4]), snapshot.bounds[5])
        sheet = new_sheet(mission, snapshot, height, mission.name)
        _draw_mission_threats(sheet, mission)
        line, name = straight_way(mission), "straight way"
        if items_enu_m is not None:
            line, name = items_enu_m, "operator's items"
            sheet.axes.plot(line[:, 0], line[:, 1], color=style.FLOWN, lw=1.8, zorder=8)
            sheet.entry(name, color=style.FLOWN, lw=1.8)
        sheet.finish()
        if (heights := ground_heights_of(mission)) is not None:
            add_profile(sheet, heights, line, name, style.FLOWN)
        style.write_picture(path, sheet.figure)


def plot_plan(
    path: Path, mission: MissionConfig, snapshot: Snapshot, plan: Plan, dpi: int = style.DPI
) -> None:
    """Draw a plan with its search, as a PNG; in three dimensions in plan view and in perspective."""
    with style.drawing():
        ups = np.empty(0) if plan.path is None else plan.path.positions_enu_m[:, 2]
        height = flight_height(snapshot, ups, float(mission.start.up_m))
        title = f"{mission.name}: {plan.method}, seed {plan.seed}, {plan.status.value.replace('_', ' ')}"
        sheet = new_sheet(mission, snapshot, height, title)
        _draw_search(sheet, mission, snapshot, plan)
        if plan.path is not None:
            line = plan.path.positions_enu_m
            sheet.axes.plot(line[:, 0], line[:, 1], color="white", lw=4.2, zorder=8.9)
            sheet.axes.plot(line[:, 0], line[:, 1], color=style.GOAL, lw=2.4, zorder=9)
            sheet.entry("path", color=style.GOAL, lw=2.4)
        sheet.finish()
        if snapshot.dimension == 3:
            _add_perspective(sheet, mission, snapshot, plan)
        if (heights := ground_heights_of(mission)) is not None and plan.path is not None:
            add_profile(sheet, heights, plan.path.positions_enu_m, "path", style.GOAL)
        style.write_picture(path, sheet.figure, dpi)


def flight_map(mission: MissionConfig, snapshot: Snapshot, record: FlightRecord) -> Figure:
    """Return the map of a flight: what was flown, what was uploaded, and where the threats moved."""
    height = flight_height(snapshot, record.flown[:, 3], float(mission.start.up_m))
    sheet = new_sheet(mission, snapshot, height, f"{mission.name}: the flight")
    start_s = flight_start(record)
    _draw_uploads(sheet, record, start_s)
    _draw_moving(sheet, record)
    flown = record.flown
    if len(flown):
        sheet.axes.plot(flown[:, 1], flown[:, 2], color="white", lw=4.6, zorder=8.9)
        sheet.axes.plot(flown[:, 1], flown[:, 2], color=style.FLOWN, lw=2.8, zorder=9)
        sheet.entry("flown path, time marked", color=style.FLOWN, lw=2.8)
        _draw_aircraft(sheet, flown)
    _draw_closest(sheet, record, start_s)
    moving = [path[:, :3] for path in record.dt_paths or record.dt_tracks]
    for line in [flown[:, :3], *moving]:
        sheet.labels.reserve_line(line[:, 1:])
    _mark_times(sheet, flown[:, :3], start_s, mark_step(record), style.FLOWN)
    for line in moving:
        _mark_times(sheet, line, start_s, mark_step(record), style.DYNAMIC)
    sheet.finish()
    return sheet.figure


def flight_start(record: FlightRecord) -> float:
    """Return the stamp that counts as 00:00: the record's, else the first of the flown path [s]."""
    if record.begin_s is not None:
        return record.begin_s
    return float(record.flown[0, 0]) if len(record.flown) else 0.0


def mark_step(record: FlightRecord) -> float:
    """Return the time between marks on the map [s]."""
    span = float(record.flown[-1, 0] - record.flown[0, 0]) if len(record.flown) else 60.0
    return style.time_step(span, NUM_TIME_MARKS)


def _add_perspective(sheet: MapSheet, mission: MissionConfig, snapshot: Snapshot, plan: Plan) -> None:
    """Widen the sheet and put the perspective left of the map."""
    width, height = sheet.figure.get_size_inches()
    extra = 1.05 * height
    total = width + extra
    for axes in (sheet.axes, sheet.side):
        box = axes.get_position(original=True)
        axes.set_position(((box.x0 * width + extra) / total, box.y0, box.width * width / total, box.height))
    sheet.figure.set_size_inches(total, height)
    grid = GridSpec(1, 1, figure=sheet.figure, left=0.0, right=(extra - 0.45) / total, bottom=0.02, top=0.93)
    draw_perspective(sheet.figure, grid[0], mission, snapshot, plan)
    title = sheet.figure._suptitle  # type: ignore[attr-defined]
    if title is not None:
        title.set_x(0.3 / total)


def _draw_mission_threats(sheet: MapSheet, mission: MissionConfig) -> None:
    for threat in mission.dynamic_threat_list:
        place = threat.position_enu_m[:2]
        sheet.axes.add_patch(
            Circle(place, threat.max_threat_radius_m, fc=style.DYNAMIC, alpha=0.08, ec="none", zorder=2.4)
        )
        sheet.axes.add_patch(
            Circle(place, threat.max_threat_radius_m, fill=False, ec=style.DYNAMIC, lw=1.0, zorder=2.6)
        )
        sheet.axes.plot(*place, "s", ms=7, color=style.DYNAMIC, mec="white", mew=0.8, zorder=7)
        sheet.labels.reserve(*place)
        moves = f"{threat.speed_m_s:g} m/s" if threat.speed_m_s else "parked"
        sheet.labels.put(*place, f"{threat.name}, {moves}", style.DYNAMIC)
    if mission.dynamic_threats:
        sheet.entry("moving threat and its reach", marker="s", color=style.DYNAMIC, lw=1.0, ms=6)
    start = mission.start
    horizon = float(mission.planning.sensing_horizon_m)
    sheet.axes.add_patch(
        Circle((start.east_m, start.north_m), horizon, fill=False, ec=style.TREE, lw=1.0, zorder=2.6)
    )
    sheet.entry("sensing horizon at the start", color=style.TREE, lw=1.0)
    stops = [(start.east_m, start.north_m), *((goal.east_m, goal.north_m) for goal in mission.goals)]
    sheet.axes.plot(*np.array(stops, dtype=np.float64).T, color=style.MUTED, lw=1.0, ls=":", zorder=2.7)
    sheet.entry("order of the goals", color=style.MUTED, lw=1.0, ls=":")


def _draw_search(sheet: MapSheet, mission: MissionConfig, snapshot: Snapshot, plan: Plan) -> None:
    """Draw trees, reach circles, sensing horizons and sub goals."""
    trace = plan.trace
    for nodes, parents, colour, label in (
        (trace.threat_tree_enu_m, trace.threat_tree_parents, style.DYNAMIC, "tree of the moving threats"),
        (trace.tree_enu_m[:, :2], trace.tree_parents, style.TREE, "search tree"),
    ):
        if len(nodes):
            style.add_lines(
                sheet.axes, style.tree_lines(nodes, parents), colors=colour, linewidths=0.6, zorder=4.5
            )
            sheet.entry(label, color=colour, lw=1.2)
    _draw_reach(sheet, trace.reach_circles_enu_m)
    for track in snapshot.tracks:
        sheet.axes.plot(
            *track.position_enu_m[:2], "s", ms=7, color=style.DYNAMIC, mec="white", mew=0.8, zorder=8
        )
        sheet.labels.reserve(*track.position_enu_m[:2])
        sheet.labels.put(*track.position_enu_m[:2], track.identity, style.DYNAMIC)
    if snapshot.tracks:
        sheet.entry("moving threat as tracked", marker="s", color=style.DYNAMIC, ls="none", ms=6)
    if len(trace.horizon_centres_enu_m):
        radius = float(mission.planning.sensing_horizon_m)
        crowded = len(trace.horizon_centres_enu_m) > NUM_BOLD_HORIZONS_MAX
        look = {"lw": 0.6, "alpha": 0.4} if crowded else {"lw": 0.9, "alpha": 0.8}
        for east, north, _ in trace.horizon_centres_enu_m:
            circle = Circle((east, north), radius, fill=False, ec=style.HORIZON, zorder=2.8, **look)
            sheet.axes.add_patch(circle)
        sheet.entry("sensing horizon", color=style.HORIZON, lw=0.8)
    if len(trace.sub_goals_enu_m):
        goals = trace.sub_goals_enu_m
        sheet.axes.plot(
            goals[:, 0],
            goals[:, 1],
            "*",
            ms=11,
            color=style.SUB_GOAL,
            mec="white",
            mew=0.7,
            ls="none",
            zorder=9.5,
        )
        sheet.entry("sub goal", marker="*", color=style.SUB_GOAL, ls="none", ms=9)


def _draw_reach(sheet: MapSheet, circles: FloatArray) -> None:
    """Draw ``circles`` (K, 3), east, north, radius [m], about reachable nodes; a sample if there are many."""
    if len(circles) == 0:
        return
    step = -(-len(circles) // NUM_REACH_CIRCLES_MAX)
    shown = circles[::step]
    sheet.axes.add_collection(
        EllipseCollection(
            2.0 * shown[:, 2],
            2.0 * shown[:, 2],
            np.zeros(len(shown)),
            units="xy",
            offsets=shown[:, :2],
            transOffset=sheet.axes.transData,
            facecolor="none",
            edgecolor=style.REACH,
            linewidth=0.35,
            alpha=0.35,
            zorder=4,
        ),
        autolim=False,
    )
    sheet.axes.plot(circles[:, 0], circles[:, 1], "*", ms=3.5, color=style.REACH, mew=0, ls="none", zorder=6)
    part = "" if step == 1 else f" (1 in {step} drawn)"
    sheet.entry("node a threat can reach", marker="*", color=style.REACH, ls="none", ms=6)
    sheet.entry(f"its reach circle{part}", color=style.REACH, lw=0.6, alpha=0.7)


def _draw_uploads(sheet: MapSheet, record: FlightRecord, start_s: float) -> None:
    if not record.missions:
        return
    stamps = np.array([upload.stamp_s - start_s for upload in record.missions])
    colours = clock_colours(float(stamps.min()), float(stamps.max()))
    sheet.axes.add_collection(
        LineCollection(
            [upload.positions_enu_m[:, :2] for upload in record.missions],
            array=stamps,
            cmap=style.MISSION_MAP,
            norm=Normalize(*colours.get_clim()),
            linewidths=8.0,  # wider than the flown path, which mostly lies on it
            alpha=0.55,
            zorder=6.5,
        ),
        autolim=False,
    )
    entries = np.array([upload.positions_enu_m[0, :2] for upload in record.missions])
    sheet.axes.scatter(
        entries[:, 0],
        entries[:, 1],
        s=34,
        c=colours.to_rgba(stamps),
        edgecolors="white",
        linewidths=1.0,
        zorder=9.4,
    )
    if len(record.missions) > 1:
        sheet.bar(colours, f"uploaded missions ({len(stamps)}), by time of upload", is_clock=True)
    middle = colours.to_rgba(stamps)[len(stamps) // 2]
    sheet.entry("uploaded mission", color=middle, lw=8.0, alpha=0.55)
    sheet.entry("its first waypoint", marker="o", color=middle, mec="white", ls="none")


def _draw_moving(sheet: MapSheet, record: FlightRecord) -> None:
    """Draw true paths and tracks of the moving threats."""
    for track in record.dt_tracks:
        sheet.axes.plot(
            track[:, 1], track[:, 2], ".", ms=3.0, color=style.DYNAMIC, alpha=0.55, mew=0, zorder=7
        )
    if record.dt_tracks:
        sheet.entry("moving threat as tracked", marker=".", color=style.DYNAMIC, ls="none", alpha=0.7)
    for path in record.dt_paths:
        if len(path):
            sheet.axes.plot(path[:, 1], path[:, 2], color="white", lw=3.0, zorder=7.4)
            sheet.axes.plot(path[:, 1], path[:, 2], color=style.DYNAMIC, lw=1.6, zorder=7.5)
            sheet.axes.plot(*path[0, 1:], "s", ms=7, color=style.DYNAMIC, mec="white", mew=0.8, zorder=8)
            sheet.labels.reserve(*path[0, 1:])
    if record.dt_paths:
        sheet.entry("its true path, time marked", marker="s", ms=6, color=style.DYNAMIC, lw=1.6)


def _mark_times(sheet: MapSheet, line: FloatArray, start_s: float, step_s: float, colour: str) -> None:
    """Mark ``line`` (K, 3), time [s], east, north [m], at whole steps; with the time, where there is room."""
    if len(line) == 0:
        return
    first = np.ceil((line[0, 0] - start_s) / step_s) * step_s
    instants = np.arange(max(first, 0.0), line[-1, 0] - start_s + 1e-6, step_s)
    east, north = (np.interp(instants + start_s, line[:, 0], line[:, axis]) for axis in (1, 2))
    sheet.axes.plot(east, north, "o", ms=4.5, mfc="white", mec=colour, mew=1.3, ls="none", zorder=10)
    for x, y in zip(east, north, strict=True):
        sheet.labels.reserve(float(x), float(y), 3.0)
    previous = (np.inf, np.inf)
    for instant, x, y in zip(instants, east, north, strict=True):
        moved = float(np.hypot(x - previous[0], y - previous[1]))
        if moved > 0.015 * (sheet.axes.get_xlim()[1] - sheet.axes.get_xlim()[0]):  # parked: once is enough
            sheet.labels.put(float(x), float(y), style.clock_text(float(instant)), colour)
            previous = (float(x), float(y))


def _draw_aircraft(sheet: MapSheet, flown: FloatArray) -> None:
    """Draw the aircraft where ``flown``, shape (N, 7), ends, pointing along its course."""
    last = flown[-1]
    sheet.axes.plot(
        last[1],
        last[2],
        marker=(3, 0, -float(np.degrees(last[4]))),
        ms=12,
        color=style.FLOWN,
        mec="white",
        mew=1.0,
        zorder=12,
    )


def _draw_closest(sheet: MapSheet, record: FlightRecord, start_s: float) -> None:
    """Draw the closest approach to a moving threat, and how far that threat reaches."""
    for nearest, closest in nearest_first(record)[:1]:
        own, other = closest.own_enu_m, closest.other_enu_m
        reach = Circle(
            other[:2], nearest.reach_m, fill=False, ec=style.DYNAMIC, lw=1.0, ls=(0, (1, 2)), zorder=6
        )
        sheet.axes.add_patch(reach)
        sheet.entry("its reach at the closest approach", color=style.DYNAMIC, lw=1.0, ls=(0, (1, 2)))
        line = np.array([own, other])
        sheet.axes.plot(line[:, 0], line[:, 1], color=style.INK, lw=1.2, ls=(0, (2, 2)), zorder=9.6)
        sheet.axes.plot(line[:, 0], line[:, 1], "o", ms=4, color=style.INK, ls="none", zorder=9.7)
        text = f"closest approach: {closest_text(closest, start_s)}"
        sheet.entry(text, color=style.INK, lw=1.2, ls=(0, (2, 2)), marker="o", ms=3)
