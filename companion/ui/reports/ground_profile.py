"""The ground from the side: under the straight way, a plan, or the path of a flight."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from companion.assurance.surroundings.ground_heights import GroundHeights
from companion.config.models import MissionConfig
from companion.config.sections.terrain_map import ground_heights_of
from companion.frames import FloatArray
from companion.ui.reports import style
from companion.ui.reports.basemap import MapSheet

PROFILE_IN = 2.6  # Height of the profile below a map.
HEADROOM = 0.12  # Share of the heights that stays free above and below.


def draw_ground(axes: Axes, at: FloatArray, ground_m: FloatArray, heights: GroundHeights) -> None:
    """Draw the ground, and the limits of the height over it.

    Parameters
    ----------
    axes : Axes
        Axes that are drawn in.
    at : ndarray, shape (S,)
        Places along the axis, in its unit.
    ground_m : ndarray, shape (S,)
        Height of the ground at each [m].
    heights : GroundHeights
        The limits.
    """
    axes.fill_between(at, np.full(len(at), -1e5), ground_m, color=style.GROUND, alpha=0.45, lw=0)
    axes.plot(at, ground_m, color=style.GROUND, lw=1.2, label="ground")
    limits = (("lowest", heights.height_min_m, style.GOAL), ("highest", heights.height_max_m, style.MUTED))
    for name, limit, colour in limits:
        if math.isfinite(limit):
            label = f"{name} over ground, {limit:g} m"
            axes.plot(at, ground_m + limit, color=colour, lw=1.0, ls=(0, (5, 3)), label=label)


def lowest_over_ground(up_m: FloatArray, ground_m: FloatArray) -> tuple[int, float]:
    """Return where a line is lowest over ground: the number of the place, and the height there [m].

    Parameters
    ----------
    up_m, ground_m : ndarray, shape (S,)
        Heights of the line and of the ground [m].
    """
    number = int(np.argmin(up_m - ground_m))
    return number, float(up_m[number] - ground_m[number])


def flown_over_ground(mission: MissionConfig, flown: FloatArray) -> FloatArray:
    """Return times and heights of a flown path and of the ground below it; no rows without a map.

    Parameters
    ----------
    mission : MissionConfig
        The mission file.
    flown : ndarray, shape (N, 7)
        The flown path, columns as in ``FlightRecord``.

    Returns
    -------
    ndarray, shape (M, 3)
        Time [s], height of the path and height of the ground [m], of the rows with a place.
    """
    heights = ground_heights_of(mission)
    rows = flown[np.isfinite(flown[:, :4]).all(axis=1)]
    if heights is None or not len(rows):
        return np.empty((0, 3))
    return np.column_stack([rows[:, 0], rows[:, 3], heights.up_m(rows[:, 1:3])])


def mark_lowest(axes: Axes, at: FloatArray, up_m: FloatArray, ground_m: FloatArray) -> None:
    """Mark where a line is lowest over ground, and write the height there.

    Parameters
    ----------
    axes : Axes
        Axes that are drawn in.
    at : ndarray, shape (S,)
        Places along the axis, in its unit.
    up_m, ground_m : ndarray, shape (S,)
        Heights of the line and of the ground [m].
    """
    number, height = lowest_over_ground(up_m, ground_m)
    axes.plot(
        [at[number]] * 2, [ground_m[number], up_m[number]], color=style.INK, lw=1.2, marker="_", ms=7,
        label=f"lowest: {height:.0f} m over ground",
    )  # fmt: skip


def add_profile(
    sheet: MapSheet, heights: GroundHeights, line_enu_m: FloatArray, name: str, colour: str
) -> None:
    """Add the ground under a line below the map, with the limits of the height over it.

    Parameters
    ----------
    sheet : MapSheet
        The sheet, which grows.
    heights : GroundHeights
        The ground.
    line_enu_m : ndarray, shape (N, 3)
        The line [m].
    name, colour : str
        What the line is, and its colour.
    """
    width, height = sheet.figure.get_size_inches()
    total = height + PROFILE_IN
    for other in sheet.figure.axes:
        box = other.get_position(original=True)
        bottom = (box.y0 * height + PROFILE_IN) / total
        other.set_position((box.x0, bottom, box.width, box.height * height / total))
    sheet.figure.set_size_inches(width, total)
    title = sheet.figure._suptitle  # type: ignore[attr-defined]
    if title is not None:
        title.set_y(1.0 - 0.015 * height / total)
    above = sheet.axes.get_position(original=True)
    axes = sheet.figure.add_axes((above.x0, 0.5 / total, above.width, (PROFILE_IN - 0.95) / total))
    along_m, up_m, ground_m = heights.profile(line_enu_m).T
    draw_ground(axes, 1e-3 * along_m, ground_m, heights)
    axes.plot(1e-3 * along_m, up_m, color=colour, lw=1.8, label=name)
    mark_lowest(axes, 1e-3 * along_m, up_m, ground_m)
    set_heights(axes, up_m, ground_m)
    axes.set_xlim(0.0, 1e-3 * float(along_m[-1]))
    axes.set_xlabel("distance [km]")
    axes.set_ylabel("up [m]")
    axes.set_title("From the side")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), labelspacing=0.75, handlelength=2.2)


def set_heights(axes: Axes, up_m: FloatArray, ground_m: FloatArray) -> None:
    """Limit the vertical axis to a line and the ground.

    Parameters
    ----------
    axes : Axes
        Axes whose limits are set.
    up_m, ground_m : ndarray, shape (S,)
        Heights of the line and of the ground [m].
    """
    low, high = float(min(up_m.min(), ground_m.min())), float(max(up_m.max(), ground_m.max()))
    margin = HEADROOM * max(high - low, 1.0)
    axes.set_ylim(low - margin, high + 2.0 * margin)
