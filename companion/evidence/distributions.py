"""Distributions of measures as curves: which share of all runs has at most that value."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter

from companion.evidence.samples import GROUPS, Case, Measure
from companion.ui import style

DRAWN = {
    "plans": ("PST", "NCDC", "PC", "Q", "TTA", "TDTA"),
    "flights": (
        "seconds_in_reach_and_sight", "miss_distance_m", "TDTA", "TTA", "min_obstacle_clearance_m",
        "flight_s",
    ),
}  # fmt: skip
LOGARITHMIC = {"PST", "NCDC"}
COLOURS = (
    style.FLOWN, style.GOAL, style.SUB_GOAL, style.DYNAMIC, "#e08a00", "#00838f", "#6b4fb3", "#7a5c2e",
    style.MUTED, "#000000",
)  # fmt: skip
DASHES: tuple[str | tuple[int, tuple[int, ...]], ...] = ("-", (0, (5, 2)), (0, (1, 1)))
NUM_COLUMNS = 3
WIDTH_IN, PANEL_IN, LEGEND_IN = 10.4, 2.5, 0.75


def distributions(kind: str, case: Case) -> Figure | None:
    """Curves of the measures that a case has values of, one panel each; None where it has none.

    A run without a value (one that fails has no path cost) counts as beyond every value, so that a curve
    ends at the share of runs that have one, and not at 1.
    """
    known = {measure.name: measure for group in GROUPS[kind] for measure in group.measures}
    drawn = [known[name] for name in DRAWN[kind] if _has_values(case, known[name])]
    if not drawn:
        return None
    num_rows = math.ceil(len(drawn) / NUM_COLUMNS)
    height = num_rows * PANEL_IN + LEGEND_IN
    figure = style.new_figure(WIDTH_IN, height)
    panels = figure.subplots(num_rows, NUM_COLUMNS, squeeze=False)
    figure.subplots_adjust(
        left=0.06, right=0.985, bottom=0.5 / height, top=1.0 - (LEGEND_IN + 0.1) / height, hspace=0.55,
        wspace=0.16,
    )  # fmt: skip
    for n, axes in enumerate(panels.flat):
        if n < len(drawn):
            _draw(axes, case, drawn[n])
        else:
            axes.set_visible(False)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", ncols=5, bbox_to_anchor=(0.05, 1.0))
    return figure


def _has_values(case: Case, measure: Measure) -> bool:
    return any(sample.values(measure) for sample in case.samples.values())


def _draw(axes: Axes, case: Case, measure: Measure) -> None:
    """One panel; every method has its line, so that each legend is whole."""
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
    axes.grid(visible=True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_title(measure.name, fontsize=9.5)
    axes.set_xlabel(measure.words, fontsize=8)
