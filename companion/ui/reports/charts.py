"""Curves over a flight: altitude, threat, distance to moving threats, and how long the plans took."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from companion.config.models import MissionConfig
from companion.config.sections.terrain_map import ground_heights_of
from companion.frames import FloatArray
from companion.plain_text import printable
from companion.types.encounter import Encounter
from companion.types.record import FlightRecord
from companion.ui.reports import style
from companion.ui.reports.ground_profile import draw_ground, flown_over_ground, mark_lowest
from companion.ui.reports.threats_met import closest_text, nearest_first, seconds_text, words_of
from companion.ui.reports.vocabulary import decision_words
from companion.world.snapshot import Snapshot

# Shares of a chart's width at which its axes begin and end; narrower where labels stand next to them.
LEFT, WORDS_LEFT, RIGHT = 0.085, 0.185, 0.885
WIDTH_IN, HEIGHT_IN = 9.6, 3.1
HIGH_THREAT = 0.5  # The paper counts a waypoint as highly threatened from this level on.
LATERAL_M = 30.0
NUM_OBSTACLE_SAMPLES_MAX = 1500
# Colours of the threats that came nearest.
COLOURS = (style.DYNAMIC, style.FLOWN, style.SUB_GOAL, style.RADAR)
NAME_CHARACTERS = 14  # Largest number of characters of a name in a legend.
REACHES_SHOWN = 4.0  # Distances are shown up to this many reaches.
KINDS_MAX, OTHERS = 40, "others"  # The program has fewer kinds of decisions.


def altitude_chart(
    mission: MissionConfig, snapshot: Snapshot, record: FlightRecord, start_s: float
) -> Figure:
    """Return the height over time between its bounds, with the obstacles and the ground under the path."""
    figure, axes = _new_chart()
    low, high = snapshot.bounds[4:6]
    flown, heights = record.flown, ground_heights_of(mission)
    times = flown[:, 0] - start_s
    over_ground = flown_over_ground(mission, flown)
    if heights is not None and len(over_ground):
        stamps, up_m, ground_m = over_ground.T
        draw_ground(axes, stamps - start_s, ground_m, heights)
        mark_lowest(axes, stamps - start_s, up_m, ground_m)
    if snapshot.dimension == 3 and len(flown):
        instants, tops = obstacle_tops(snapshot, flown)
        axes.fill_between(
            instants - start_s, np.full(len(tops), -1e5), tops, where=np.isfinite(tops).tolist(), step="mid",
            color=style.OBSTACLE, alpha=0.75, lw=0, label=f"obstacle below or within {LATERAL_M:.0f} m",
        )  # fmt: skip
    for bound, name in ((low, "floor"), (high, "ceiling")):
        axes.axhline(
            bound,
            color=style.GOAL,
            lw=1.1,
            ls=(0, (5, 3)),
            label="altitude bounds" if name == "floor" else None,
        )
        _write_right(axes, bound, f"{name} {bound:.0f} m", style.GOAL)
    axes.plot(times, flown[:, 3], color=style.FLOWN, lw=2.0, label="flown")
    if record.missions:
        axes.plot([], [], color=style.MUTED, lw=0.8, ls=":", label="mission uploaded")
    margin = 0.08 * (high - low)
    lowest = float(np.nanmin(np.append(flown[:, 3], over_ground[:, 2]), initial=low))
    highest = float(np.nanmax(flown[:, 3], initial=high))
    axes.set_ylim(min(low, lowest) - margin, max(high, highest) + margin)
    axes.set_ylabel(f"up [m], 0 is {mission.origin.altitude_amsl_m:g} m AMSL")
    _finish(axes, record, start_s, "Altitude over the ground" if len(over_ground) else "Altitude")
    return figure


def threat_chart(record: FlightRecord, start_s: float) -> Figure:
    """Return the threat level along the flown path over time."""
    figure, axes = _new_chart()
    times, level = record.threat[:, 0] - start_s, record.threat[:, 1]
    axes.axhspan(HIGH_THREAT, 1.0, color=style.GOAL, alpha=0.06, lw=0)
    axes.axhline(HIGH_THREAT, color=style.GOAL, lw=1.0, ls=(0, (5, 3)))
    _write_right(axes, HIGH_THREAT, "high", style.GOAL)
    axes.fill_between(times, 0.0, level, color=style.RADAR, alpha=0.22, lw=0)
    axes.plot(times, level, color=style.RADAR, lw=1.8, label="threat level")
    if record.missions:
        axes.plot([], [], color=style.MUTED, lw=0.8, ls=":", label="mission uploaded")
    axes.set_ylim(0.0, 1.0)
    axes.set_ylabel("threat level TI [0–1]")
    _finish(axes, record, start_s, "Threat level")
    return figure


def energy_chart(record: FlightRecord, start_s: float) -> Figure:
    """Return what was left on board over time, and what the way home and the reserve needed of it."""
    figure, axes = _new_chart()
    times, left, needed = record.energy[:, 0] - start_s, record.energy[:, 1], record.energy[:, 2]
    axes.plot(times, left, color=style.FLOWN, lw=2.0, label="left on board")
    axes.plot(times, needed, color=style.GOAL, lw=1.6, label="needed for the way home and the reserve")
    if record.missions:
        axes.plot([], [], color=style.MUTED, lw=0.8, ls=":", label="mission uploaded")
    axes.set_ylim(0.0, 1.08 * float(np.nanmax(record.energy[:, 1:], initial=1.0)))
    axes.set_ylabel("energy [Wh]")
    _finish(axes, record, start_s, "Energy")
    return figure


def encounter_chart(record: FlightRecord, start_s: float) -> Figure:
    """Return the distances to the moving threats over time, with reach, sight and closest approach."""
    figure, axes = _new_chart()
    drawn = nearest_first(record)[: len(COLOURS)]
    for (entry, closest), colour in zip(drawn, COLOURS, strict=False):
        _draw_encounter(axes, entry, colour, start_s)
        at = closest.stamp_s - start_s
        axes.plot(at, closest.distance_m, "v", ms=7, color=colour, mec="white", mew=0.8, zorder=4)
        name = f"{printable(entry.name)[:NAME_CHARACTERS]}: {seconds_text(entry)}"
        axes.plot([], [], color=colour, lw=1.6, label=f"{name}; closest {closest_text(closest, start_s)}")
    tops = [max(REACHES_SHOWN * entry.reach_m, 1.3 * closest.distance_m) for entry, closest in drawn]
    axes.set_ylim(0.0, max(tops, default=1.0))
    axes.set_ylabel("slant distance [m]")
    if not drawn:
        axes.set_yticks([])
        axes.text(
            0.5, 0.5, "no moving threat was known", ha="center", va="center", color=style.MUTED,
            transform=axes.transAxes,
        )  # fmt: skip
    _finish(axes, record, start_s, f"Distance to moving threats, {words_of(record)}", num_columns=2)
    return figure


def _draw_encounter(axes: Axes, entry: Encounter, colour: str, start_s: float) -> None:
    """Draw one threat's distance, its reach, and when it had the aircraft there and in sight."""
    axes.plot(entry.times_s - start_s, entry.distances_m, color=colour, lw=1.6)
    axes.axhline(entry.reach_m, color=colour, lw=1.0, ls=(0, (5, 3)))
    _write_right(axes, entry.reach_m, f"reach {entry.reach_m:.0f} m", colour)
    for stretches, alpha in ((entry.in_reach_s, 0.12), (entry.in_sight_s, 0.3)):
        bars = [(begin - start_s, end - begin) for begin, end in stretches]
        axes.broken_barh(bars, (0.0, entry.reach_m), color=colour, alpha=alpha, lw=0)


def decision_chart(record: FlightRecord, start_s: float) -> Figure:
    """Return when which kind of decision was made."""
    figure, axes = _new_chart(WORDS_LEFT)
    heads = [printable(decision_words(entry.kind).head) for entry in record.decisions]
    kinds = [kind for kind, _ in Counter(heads).most_common(KINDS_MAX)]  # Stable for ties.
    rows = {kind: row for row, kind in enumerate(sorted(kinds, key=heads.index))}
    if len(set(heads)) > len(rows):
        rows[OTHERS] = len(rows)
    times = [entry.stamp_s - start_s for entry in record.decisions]
    axes.scatter(
        times, [rows.get(kind, len(rows) - 1) for kind in heads], s=34, color=style.FLOWN, zorder=3,
        label="decision",
    )  # fmt: skip
    if record.missions:
        axes.plot([], [], color=style.MUTED, lw=0.8, ls=":", label="mission uploaded")
    axes.set_yticks(range(len(rows)), list(rows))
    axes.set_ylim(max(len(rows), 1) - 0.5, -0.5)
    axes.margins(x=0.02)
    _finish(axes, record, start_s, "Decisions")
    return figure


def latency_chart(record: FlightRecord) -> Figure:
    """Return how long each plan took, with median and 95th percentile."""
    figure, axes = _new_chart()
    values = np.array(record.plan_ms, dtype=np.float64)
    axes.set_title("Computing time of the plans", pad=22)
    axes.set_xlabel("plan number")
    axes.set_ylabel("time [ms]")
    if values.size == 0:
        axes.text(
            0.5,
            0.5,
            "no plan was recorded",
            ha="center",
            va="center",
            color=style.MUTED,
            transform=axes.transAxes,
        )
        axes.set_xticks([])
        axes.set_yticks([])
        return figure
    number = np.arange(1, len(values) + 1)
    axes.bar(number, values, width=0.72 if len(values) < 200 else 1.0, color=style.TREE, label="plan")
    middle, late = (float(np.nanpercentile(values, share)) for share in (50, 95))
    axes.axhline(middle, color=style.INK, lw=1.2, label=f"median {middle:.0f} ms")
    axes.axhline(late, color=style.GOAL, lw=1.2, ls=(0, (5, 3)), label=f"95th percentile {late:.0f} ms")
    axes.set_xlim(0.3, len(values) + 0.7)
    axes.set_ylim(0.0, 1.12 * float(np.nanmax(values, initial=1.0)))
    axes.xaxis.set_major_locator(MaxNLocator(min(12, len(values) + 1), integer=True))
    _legend(axes)
    return figure


def obstacle_tops(snapshot: Snapshot, flown: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the highest obstacle below the path or just beside it.

    Parameters
    ----------
    snapshot : Snapshot
        World whose obstacles are looked for.
    flown : ndarray, shape (N, 7)
        The flown path, columns as in ``FlightRecord``.

    Returns
    -------
    stamps_s, tops_m : ndarray, shape (K,)
        An even sample of the path, and the top there; NaN where there is none.
    """
    rows = flown[:: max(1, len(flown) // NUM_OBSTACLE_SAMPLES_MAX)]
    points = shapely.points(rows[:, 1], rows[:, 2])
    tops = np.full(len(rows), np.nan)
    for obstacle in snapshot.obstacle_list:
        near = shapely.dwithin(points, shapely.Polygon(obstacle.polygon_enu_m), LATERAL_M)
        tops[near] = np.fmax(tops[near], obstacle.top_m)
    return rows[:, 0], tops


def _new_chart(left: float = LEFT) -> tuple[Figure, Axes]:
    figure = style.new_figure(WIDTH_IN, HEIGHT_IN)
    axes = figure.add_axes((left, 0.17, RIGHT - left, 0.62))
    axes.grid(visible=True, axis="y")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _finish(axes: Axes, record: FlightRecord, start_s: float, title: str, num_columns: int = 5) -> None:
    """Set title, time axis, upload times and legend."""
    ends = [float(rows[-1, 0]) for rows in (record.flown, record.threat) if len(rows)]
    end = max(ends, default=start_s + 1.0) - start_s
    for upload in record.missions:
        axes.axvline(upload.stamp_s - start_s, color=style.MUTED, lw=0.8, ls=":", zorder=0.8)
    style.clock_axis(axes, 0.0, end if math.isfinite(end) and end > 0.0 else 1.0)
    num_rows = math.ceil(len(axes.get_legend_handles_labels()[1]) / num_columns)
    axes.set_title(title, pad=22 + 13 * max(0, num_rows - 1))
    if num_rows:
        _legend(axes, num_columns)


def _legend(axes: Axes, num_columns: int = 5) -> None:
    """Put the legend between title and curves, where it covers nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.01, 0.99),
        ncols=num_columns,
        columnspacing=1.4,
        handlelength=1.8,
        borderpad=0.2,
    )


def _write_right(axes: Axes, value: float, text: str, colour: str) -> None:
    """Name a level right of the curves."""
    axes.annotate(
        text, (1.0, value), xycoords=("axes fraction", "data"), xytext=(5, 0), textcoords="offset points",
        va="center", fontsize=8, color=colour, annotation_clip=False,
    )  # fmt: skip
