"""A drawing of encounters: how near aircraft pass a flight alone, and one that hears of them."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from companion.research.encounters.well_clear import NEAR_MID_AIR_COLLISION, SMALL_AIRCRAFT
from companion.research.evidence.encounter_tables import LOSS, happened, values_of
from companion.research.evidence.samples import Case, Sample
from companion.ui.reports import style

WIDTH_IN, HEIGHT_IN = 8.4, 3.9
FARTHEST_M, HIGHEST_M = 950.0, 200.0


def passages(kind: str, case: Case) -> Figure | None:
    """Each encounter as a dot at its nearest approach in the plane, of the first method; None without any.

    Parameters
    ----------
    kind : str
        The kind of campaign; others than encounters have none.
    case : Case
        The encounters.
    """
    sample = next(iter(case.samples.values()))
    if kind != "encounters" or not len(values_of(sample, "miss_m")):
        return None
    figure = style.new_figure(WIDTH_IN, HEIGHT_IN)
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    figure.subplots_adjust(left=0.09, right=0.985, bottom=0.14, top=0.91, wspace=0.06)
    for axes, before, words in zip(panels, ("without.", ""), ("alone", "with the planner"), strict=True):
        _draw(axes, sample, before, words)
    panels[0].set_ylabel("how much higher the aircraft passes [m]")
    return figure


def _draw(axes: Axes, sample: Sample, before: str, words: str) -> None:
    """Draw one panel: ``before`` is what the measures' names begin with."""
    for volume, look in ((SMALL_AIRCRAFT, ":"), (NEAR_MID_AIR_COLLISION, "-")):
        corner, size = (0.0, -volume.height_m), (volume.distance_m, 2.0 * volume.height_m)
        axes.add_patch(Rectangle(corner, *size, fill=False, linestyle=look, edgecolor=style.DYNAMIC))
    miss_m, above_m = (values_of(sample, f"{before}{name}") for name in ("miss_m", "above_m"))
    is_lost = happened(sample, f"{before}{LOSS}")
    for which, colour in ((~is_lost, style.FLOWN), (is_lost, style.DYNAMIC)):
        axes.plot(miss_m[which], above_m[which], ".", color=colour, markersize=5, alpha=0.8)
    axes.set_title(f"{words}: {is_lost.sum()} lose well clear")
    axes.set_xlim(0.0, FARTHEST_M)
    axes.set_ylim(-HIGHEST_M, HIGHEST_M)
    axes.set_xlabel("miss distance in the plane [m]")
