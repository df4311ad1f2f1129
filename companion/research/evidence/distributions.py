"""Distributions of measures: cumulative curves over all runs, and violins."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from companion.research.evidence.samples import GROUPS, Case, Measure
from companion.ui.reports import style

DRAWN = {
    "plans": ("PST", "NCDC", "PC", "Q", "TTA", "TDTA"),
    "flights": (
        "seconds_in_reach_and_sight", "miss_distance_m", "TDTA", "TTA", "min_obstacle_clearance_m",
        "flight_s",
    ),
    "encounters": ("miss_m", "severity", "detour_s"),
    "anytime": ("first_s", "cost_0.1_s", "cost_1_s", "cost_10_s"),
}  # fmt: skip
LOGARITHMIC = {"PST", "NCDC", "first_s"}
COLOURS = (
    style.FLOWN, style.GOAL, style.SUB_GOAL, style.DYNAMIC, "#e08a00", "#00838f", "#6b4fb3", "#7a5c2e",
    style.MUTED, "#000000",
)  # fmt: skip
DASHES: tuple[str | tuple[int, tuple[int, ...]], ...] = ("-", (0, (5, 2)), (0, (1, 1)))
NUM_COLUMNS = 3
WIDTH_IN, PANEL_IN = 10.4, 2.5
LEGEND_COLUMNS, LEGEND_ROW_IN, LEGEND_ROOM_IN = 5, 0.2, 0.35
VIOLIN_IN, VIOLIN_ROOM_IN = 0.24, 1.0  # Height of a panel for each method, and for the rest [in].


def distributions(kind: str, case: Case) -> Figure | None:
    """Cumulative curves of a case's measures, one panel each; None if it has no values.

    A run without a value (one that fails has no path cost) counts as beyond every value, so that a curve
    ends at the share of runs that have one, and not at 1.
    """
    drawn = _drawn(kind, case)
    if not drawn:
        return None
    num_rows = math.ceil(len(drawn) / NUM_COLUMNS)
    legend = LEGEND_ROOM_IN + LEGEND_ROW_IN * math.ceil(len(case.samples) / LEGEND_COLUMNS)
    height = num_rows * PANEL_IN + legend
    figure = style.new_figure(WIDTH_IN, height)
    panels = figure.subplots(num_rows, NUM_COLUMNS, squeeze=False)
    figure.subplots_adjust(
        left=0.06, right=0.985, bottom=0.5 / height, top=1.0 - (legend + 0.1) / height, hspace=0.55,
        wspace=0.16,
    )  # fmt: skip
    _fill(panels.flat, case, drawn, _draw)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=LEGEND_COLUMNS, bbox_to_anchor=(0.05, 1.0))
    return figure


def violins(kind: str, case: Case) -> Figure | None:
    """Violins of a case's measures, one panel each; None if it has no values.

    A violin's width is the density of its values (Gaussian kernel, Scott's rule). A dot is the median, and
    a bar spans the middle half. Runs without a value are left out; the number of the others stands behind the
    method's name.
    """
    drawn = _drawn(kind, case)
    if not drawn:
        return None
    num_rows = math.ceil(len(drawn) / NUM_COLUMNS)
    panel = VIOLIN_IN * len(case.samples) + VIOLIN_ROOM_IN
    figure = style.new_figure(WIDTH_IN, num_rows * panel)
    panels = figure.subplots(num_rows, NUM_COLUMNS, squeeze=False)
    figure.subplots_adjust(
        left=0.14, right=0.985, bottom=0.5 / (num_rows * panel), top=1.0 - 0.35 / (num_rows * panel),
        hspace=0.9 / panel, wspace=0.62,
    )  # fmt: skip
    _fill(panels.flat, case, drawn, _draw_violins)
    return figure


def _drawn(kind: str, case: Case) -> list[Measure]:
    """Return the measures to draw, of those that a case has values of."""
    known = {measure.name: measure for group in GROUPS[kind] for measure in group.measures}
    return [known[name] for name in DRAWN[kind] if _has_values(case, known[name])]


def _fill(
    panels: Iterable[Axes], case: Case, drawn: Sequence[Measure], draw: Callable[[Axes, Case, Measure], None]
) -> None:
    """Draw a measure in each panel; spare panels are hidden."""
    for n, axes in enumerate(panels):
        if n < len(drawn):
            draw(axes, case, drawn[n])
        else:
            axes.set_visible(False)


def _has_values(case: Case, measure: Measure) -> bool:
    return any(sample.values(measure) for sample in case.samples.values())


def _draw(axes: Axes, case: Case, measure: Measure) -> None:
    """Draw one panel; every method has a line, so that each legend is complete."""
    for n, (method, sample) in enumerate(case.samples.items()):
        values = np.sort(list(sample.values(measure).values()))
        shares = np.arange(1, len(values) + 1) / max(len(sample.rows), 1)
        axes.step(
            np.append(values[:1], values), np.append(np.zeros(min(1, len(values))), shares), where="post",
            color=COLOURS[n % len(COLOURS)], ls=DASHES[n // len(COLOURS) % len(DASHES)], lw=1.5, label=method,
        )  # fmt: skip
    if measure.name in LOGARITHMIC:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    else:
        axes.xaxis.set_major_locator(MaxNLocator(5))
        axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    axes.set_ylim(0.0, 1.02)
    _dress(axes, measure)


def _draw_violins(axes: Axes, case: Case, measure: Measure) -> None:
    """One panel, the first method at the top."""
    is_logarithmic = measure.name in LOGARITHMIC
    names = []
    for n, (method, sample) in enumerate(case.samples.items()):
        values = np.array(list(sample.values(measure).values()))
        names.append(f"{method} ({len(values)})")
        if len(values) == 0:
            continue
        shown = np.log10(np.maximum(values, np.finfo(float).tiny)) if is_logarithmic else values
        parts = axes.violinplot([shown], [-n], orientation="horizontal", widths=0.85, showextrema=False)
        for body in cast("list[Collection]", parts["bodies"]):
            body.set(facecolor=COLOURS[n % len(COLOURS)], edgecolor="none", alpha=0.35)
        low, middle, high = np.quantile(shown, [0.25, 0.5, 0.75])
        axes.plot([low, high], [-n, -n], color=style.INK, lw=2.0, solid_capstyle="butt")
        axes.plot([middle], [-n], "o", color=style.INK, mfc="white", ms=4.0)
    axes.set_yticks([-n for n in range(len(names))], names, fontsize=7.5)
    axes.set_ylim(0.6 - len(names), 0.6)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    if is_logarithmic:
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{10.0**value:.3g}"))
    else:
        axes.ticklabel_format(axis="x", style="plain", useOffset=False)
    _dress(axes, measure)


def _dress(axes: Axes, measure: Measure) -> None:
    """Set what all panels share."""
    axes.grid(visible=True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(measure.name, fontsize=9.5)
    axes.set_xlabel(measure.words, fontsize=8)
