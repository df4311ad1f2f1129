"""Colours, sizes and small helpers that all pictures share."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from companion.frames import FloatArray
from companion.plain_text import in_page, printable
from companion.safe_files import SHARED, replace_file

INK: Final = "#1d2733"
MUTED: Final = "#55616d"
GRID: Final = "#e3e7eb"
OBSTACLE: Final = "#5b6773"
OBSTACLE_CLEAR: Final = "#aab3bc"
RADAR: Final = "#9a2c08"
FLOWN: Final = "#0a4fa3"
DYNAMIC: Final = "#b0127b"
START: Final = "#0d7a3f"
GOAL: Final = "#c8102e"
TREE: Final = "#4f8fd6"
HORIZON: Final = "#1f4fd8"
REACH: Final = "#d62728"
SUB_GOAL: Final = "#1a9850"
MISSION_MAP: Final = "viridis"
# White at zero, so that a map without threats is a white map.
THREAT_MAP: Final = LinearSegmentedColormap.from_list(
    "threat", ["#ffffff", "#fff3d6", "#fddfae", "#f8c08f", "#efa07c"]
)
GROUND: Final = "#8c7a5e"
HALO: Final = (withStroke(linewidth=2.4, foreground="white"),)
DPI: Final = 150
LINE_SPACING_PT: Final = 4.0
# Positions of a text beside its point, east and north, and the share of the text that lies before the point.
OFFSETS: Final = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))
SHARE_LEFT: Final = {1: 0.0, 0: 0.5, -1: 1.0}

SETTINGS: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "companion",  # Equal records give equal reports.
    "svg.fonttype": "path",
    "text.parse_math": False,  # A dollar sign in a name does not begin a formula.
}


@contextmanager
def drawing() -> Iterator[None]:
    """Apply the house style while a figure is built and saved."""
    with mpl.rc_context(SETTINGS):
        yield


def inline_svg(figure: Figure, name: str, text: str) -> str:
    """Return a figure as an SVG element to stand inside a page.

    Parameters
    ----------
    figure : Figure
        What is drawn.
    name : str
        Put before every name defined in the drawing: names are unique within a page, not a drawing.
    text : str
        Description for readers that do not see the figure.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    drawing = buffer.getvalue()
    drawing = drawing[drawing.index("<svg") :]
    drawing = re.sub(r'\bid="', f'id="{name}-', drawing)
    drawing = re.sub(r'href="#|url\(#', lambda found: f"{found.group()}{name}-", drawing)
    # Width and height in points would fix its size; the view box alone lets the page scale it.
    for side in ("width", "height"):
        drawing = re.sub(rf'(<svg[^>]*?) {side}="[^"]*"', r"\1", drawing, count=1)
    return drawing.replace("<svg", f'<svg role="img" aria-label="{in_page(text)}"', 1)


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return a figure that belongs to no window and no global list."""
    return Figure(figsize=(width_in, height_in), facecolor="white")


def write_picture(path: Path, figure: Figure, dpi: int = DPI) -> bytes:
    """Write a figure as the file's ending says, as a PNG by default, and return what was written."""
    ending = path.suffix[1:].lower()
    kind = ending if ending in figure.canvas.get_supported_filetypes() else "png"
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=dpi)
    replace_file(path, buffer.getvalue(), SHARED)
    return buffer.getvalue()


def clock_text(seconds: float) -> str:
    """Return minutes and seconds, ``03:07``; hours where needed, a sign before zero."""
    if not math.isfinite(seconds):
        return "–"
    whole = round(abs(seconds))
    hours, rest = divmod(whole, 3600)
    text = f"{rest // 60:02d}:{rest % 60:02d}"
    sign = "−" if seconds < 0.0 and whole else ""
    return f"{sign}{hours}:{text}" if hours else f"{sign}{text}"


def number_text(value: float) -> str:
    """Return a number with three digits that count; a dash where it is none."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    digits = max(0, 3 - math.floor(math.log10(abs(value))) - 1) if abs(value) >= 1e-3 else 4
    return f"{value:.{min(digits, 4)}f}"


def round_step(span: float, num_max: int) -> float:
    """Return the step of 1, 2 or 5 times a power of ten that cuts a span into at most ``num_max`` parts."""
    raw = max(span, 1e-9) / num_max
    power = 10.0 ** math.floor(math.log10(raw))
    return next(
        step for step in (power, 2.0 * power, 5.0 * power, 10.0 * power) if step >= raw * (1.0 - 1e-9)
    )


def day_time_text(epoch_s: float | None, stamp_s: float) -> str:
    """Return the time of day of a stamp, UTC; a dash where it is not known."""
    if epoch_s is None or not math.isfinite(epoch_s + stamp_s):
        return "–"
    seconds = math.floor(epoch_s + stamp_s) % 86_400
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}"


def time_step(span_s: float, num_max: int) -> float:
    """Return a step that reads well on a clock [s]."""
    steps = (5.0, 10.0, 15.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0)
    return next((step for step in steps if span_s / step <= num_max), round_step(span_s, num_max))


def clock_axis(axes: Axes, start_s: float, end_s: float) -> None:
    """Label the x axis in minutes and seconds."""
    step = time_step(end_s - start_s, 10)
    ticks = np.arange(math.ceil(start_s / step) * step, end_s + 0.5 * step, step)
    axes.set_xticks(ticks[ticks <= end_s + 1e-9], [clock_text(t) for t in ticks if t <= end_s + 1e-9])
    axes.set_xlim(start_s, end_s)
    axes.set_xlabel("flight time [mm:ss]")


def tree_lines(nodes: FloatArray, parents: np.ndarray) -> FloatArray:
    """Edges of a tree, as lines to draw.

    Parameters
    ----------
    nodes : ndarray, shape (N, D)
        Places of the nodes, in D dimensions [m].
    parents : ndarray, shape (N,)
        Number of each one's parent, -1 at roots.

    Returns
    -------
    ndarray, shape (E, 2, D)
        Each node that has a parent, and that parent [m].
    """
    child = np.nonzero(parents >= 0)[0]
    return np.stack([nodes[child], nodes[parents[child]]], axis=1)


def add_lines(axes: Axes, segments: FloatArray, **look: Any) -> LineCollection:  # noqa: ANN401
    """Draw many segments as one artist: thousands of lines stay fast.

    Parameters
    ----------
    axes : Axes
        Axes that are drawn in; their limits stay.
    segments : ndarray, shape (E, 2, 2)
        Both ends of each, in the units of the axes.
    **look
        How they look, as ``LineCollection`` takes it.
    """
    collection = LineCollection(list(segments), **look)
    axes.add_collection(collection, autolim=False)
    return collection


@dataclass
class Labels:
    """Puts short texts beside points so that none covers another; one without a place is left out.

    Parameters
    ----------
    axes : Axes
        Axes that are written in; their limits and size must be final.
    size : float
        Font size [pt].
    """

    axes: Axes
    size: float = 7.5
    _taken: list[tuple[float, float, float, float]] = field(default_factory=list)

    def reserve(self, east_m: float, north_m: float, radius_pt: float = 5.0) -> None:
        """Keep texts off a marker."""
        x, y = self._points(east_m, north_m)
        self._taken.append((x - radius_pt, y - radius_pt, x + radius_pt, y + radius_pt))

    def reserve_line(self, line_m: FloatArray) -> None:
        """Keep texts off the path ``line_m`` (K, 2) [m], as long as they find another place."""
        if len(line_m) == 0:
            return
        points = self.axes.transData.transform(line_m) * (72.0 / self._dpi())
        gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        along = np.arange(0.0, gone[-1] + LINE_SPACING_PT, LINE_SPACING_PT)
        for x, y in zip(*(np.interp(along, gone, points[:, axis]) for axis in (0, 1)), strict=True):
            self._taken.append((x - 2.0, y - 2.0, x + 2.0, y + 2.0))

    def put(self, east_m: float, north_m: float, text: str, colour: str, *, offset_pt: float = 7.0) -> bool:
        """Write a text beside a point; return whether there was room."""
        x, y, text = *self._points(east_m, north_m), printable(text)
        width, height = 0.62 * self.size * len(text), 1.25 * self.size
        left, bottom, right, top = self._frame()
        for dx, dy in OFFSETS:
            reach = offset_pt * (1.0 if dx == 0 or dy == 0 else 0.75)
            low_x = x + dx * reach - SHARE_LEFT[dx] * width
            low_y = y + dy * reach - SHARE_LEFT[dy] * height
            box = (low_x, low_y, low_x + width, low_y + height)
            inside = box[0] >= left and box[1] >= bottom and box[2] <= right and box[3] <= top
            if inside and not any(_overlap(box, other) for other in self._taken):
                self._taken.append(box)
                self.axes.annotate(
                    text,
                    (east_m, north_m),
                    xytext=(dx * reach, dy * reach),
                    textcoords="offset points",
                    ha=("center", "left", "right")[dx],
                    va=("center", "bottom", "top")[dy],
                    fontsize=self.size,
                    color=colour,
                    path_effects=list(HALO),
                    zorder=20,
                )
                return True
        return False

    def _points(self, east_m: float, north_m: float) -> tuple[float, float]:
        scale = 72.0 / self._dpi()
        x, y = self.axes.transData.transform((east_m, north_m))
        return float(x) * scale, float(y) * scale

    def _frame(self) -> tuple[float, float, float, float]:
        scale = 72.0 / self._dpi()
        low, high = self.axes.transAxes.transform([(0.0, 0.0), (1.0, 1.0)])
        return float(low[0]) * scale, float(low[1]) * scale, float(high[0]) * scale, float(high[1]) * scale

    def _dpi(self) -> float:
        figure = self.axes.get_figure(root=True)
        return 100.0 if figure is None else float(figure.dpi)


def _overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
