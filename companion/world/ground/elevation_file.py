"""Heights of the ground out of raster files, by rasterio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.errors import CompanionError
from companion.frames import FloatArray, LocalFrame
from companion.types.elevation import ElevationPosts

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

EDGE_POINTS = 25  # The edge of the bounds is followed through so many points a side.
POSTS_MORE = 2  # So many posts beyond the bounds are read.


class TerrainError(CompanionError):
    """A map of heights that cannot be used.

    Parameters
    ----------
    got : str
        What was found.
    expected : str
        What was expected.
    """

    def __init__(self, got: str, expected: str) -> None:
        super().__init__(f"{got}: expected {expected}")
        self.got, self.expected = got, expected


def read_posts(
    place: Path, frame: LocalFrame, bounds: Sequence[float], geoid_m: float, *, may_have_holes: bool = False
) -> ElevationPosts:
    """Read the posts over the bounds.

    Parameters
    ----------
    place : Path
        A raster file, or a folder of them with one coordinate system.
    frame : LocalFrame
        The local frame.
    bounds : sequence of float
        East and north, each low and high [m].
    geoid_m : float
        Is subtracted from all heights [m].
    may_have_holes : bool
        Whether heights may be missing, which are then not a number.

    Raises
    ------
    TerrainError
        If the extra is missing, or a file cannot be read or does not cover the bounds.
    """
    try:
        import rasterio  # noqa: PLC0415 - An extra.
        from rasterio.merge import merge  # noqa: PLC0415
    except ImportError:
        raise TerrainError(
            str(place), "the extra terrain: pip install 'safe-rrt-companion[terrain]'"
        ) from None
    files = sorted(entry for entry in place.iterdir() if entry.is_file()) if place.is_dir() else [place]
    datasets = []
    try:
        for file in files:
            try:
                datasets.append(rasterio.open(file))
            except rasterio.errors.RasterioIOError as error:
                if file == place:
                    raise TerrainError(str(error), "a raster file that GDAL reads") from None
        if not datasets:
            raise TerrainError(f"no raster file in {place}", "at least one that GDAL reads")
        crs, box = _box(datasets, frame, bounds)
        try:
            heights, transform = merge(datasets, bounds=box, nodata=math.nan, dtype="float64")
        except rasterio.errors.RasterioError as error:
            raise TerrainError(str(error), f"a map that covers {_in_words(box)} of its coordinates") from None
    finally:
        for dataset in datasets:
            dataset.close()
    posts = ElevationPosts(
        heights[0] - geoid_m - frame.altitude_amsl_m,
        transform.c + 0.5 * transform.a, transform.f + 0.5 * transform.e, transform.a, transform.e,
        crs, frame, place.name,
    )  # fmt: skip
    if not may_have_holes:
        _require_whole(posts.up_m, place)
    return posts


def _box(
    datasets: Sequence[DatasetReader], frame: LocalFrame, bounds: Sequence[float]
) -> tuple[str, tuple[float, float, float, float]]:
    """Return the coordinate system, and the left, bottom, right and top of what is to be read."""
    systems = {None if dataset.crs is None else dataset.crs.to_wkt() for dataset in datasets}
    if len(systems) != 1 or None in systems:
        raise TerrainError(f"{len(systems)} coordinate systems", "one, that every file names")
    crs = str(systems.pop())
    transform: Any = datasets[0].transform
    if transform.b or transform.d:
        raise TerrainError("a turned raster", "rows along one of its coordinates")
    x, y = edge_on_map(bounds, frame, crs)
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise TerrainError("bounds far outside of the map's coordinates", "a map of this area")
    left, right = _whole_steps(x, transform.c, transform.a)
    bottom, top = _whole_steps(y, transform.f, transform.e)
    return crs, (left, bottom, right, top)


def edge_on_map(bounds: Sequence[float], frame: LocalFrame, crs: str) -> tuple[FloatArray, FloatArray]:
    """Return the edge of the bounds in a map's coordinates, in which it may be curved.

    Parameters
    ----------
    bounds : sequence of float
        East and north, each low and high [m].
    frame : LocalFrame
        The local frame.
    crs : str
        The map's coordinate system.

    Returns
    -------
    tuple of ndarray, shape (N,)
        Both coordinates of points along the edge.
    """
    west, east, south, north = bounds[:4]
    share = np.linspace(0.0, 1.0, EDGE_POINTS)
    corners = np.array([(west, south), (east, south), (east, north), (west, north), (west, south)])
    sides = [begin + share[:, None] * (end - begin) for begin, end in pairwise(corners)]
    edge_east, edge_north = np.concatenate(sides).T
    x, y = frame.transformer_to(crs).transform(edge_east, edge_north)
    return x, y


def _whole_steps(values: FloatArray, first: float, step: float) -> tuple[float, float]:
    """Return the least and the greatest of ``values`` (N,), widened to borders of the raster's cells."""
    side = abs(step)
    low = math.floor((float(values.min()) - first) / side) - POSTS_MORE
    high = math.ceil((float(values.max()) - first) / side) + POSTS_MORE
    return first + low * side, first + high * side


def _require_whole(up: FloatArray, place: Path) -> None:
    """Refuse heights ``up`` (R, C) with holes, which are also what lies beyond the map's edge."""
    holes = int(np.isnan(up).sum())
    if holes:
        share = 100.0 * holes / up.size
        raise TerrainError(
            f"{place.name}: no height at {holes} of {up.size} posts ({share:.1f} %)",
            "a height at every post of the bounds and of two posts around",
        )


def _in_words(box: Sequence[float]) -> str:
    return f"x {box[0]:.6g} to {box[2]:.6g}, y {box[1]:.6g} to {box[3]:.6g}"
