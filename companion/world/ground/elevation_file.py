"""Heights of the ground from raster files, read by rasterio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.errors import CompanionError
from companion.frames import FloatArray, LocalFrame, SingleArray
from companion.types.elevation import ElevationPosts

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

EDGE_POINTS = 25  # Points on each side of the bounds through which their edge is followed.
CACHE_MB = 4  # GDAL keeps blocks that it has read; each is read once here.
POSTS_MORE = 2  # Posts beyond the bounds that are read.


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
    place: Path, frame: LocalFrame, bounds: Sequence[float], geoid_m: float, *, beyond_m: float = 0.0
) -> ElevationPosts:
    """Read the posts over the bounds and some way beyond.

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
    beyond_m : float
        Posts are read up to this distance beyond the bounds [m]. Those that the map lacks there are NaN.

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
        crs = _crs_of(datasets)
        box = _box(datasets[0], edge_on_map(bounds, frame, crs))
        west, east, south, north = bounds[:4]
        wider = west - beyond_m, east + beyond_m, south - beyond_m, north + beyond_m
        wider_box = _box(datasets[0], edge_on_map(wider, frame, crs))
        try:
            with rasterio.Env(GDAL_CACHEMAX=CACHE_MB):
                heights, transform = merge(datasets, bounds=wider_box, nodata=math.nan, dtype="float32")
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
    _require_whole(posts_over(posts, bounds).up_m, place)
    return posts


def posts_over(posts: ElevationPosts, bounds: Sequence[float]) -> ElevationPosts:
    """Return the posts of the bounds and a few more around, without copying them.

    Parameters
    ----------
    posts : ElevationPosts
        The posts.
    bounds : sequence of float
        East and north, each low and high [m].
    """
    x, y = edge_on_map(bounds, posts.frame, posts.crs)
    rows, columns = posts.up_m.shape
    i, first_row = _window((y - posts.first_y) / posts.step_y, rows)
    j, first_column = _window((x - posts.first_x) / posts.step_x, columns)
    return replace(
        posts, up_m=posts.up_m[i, j], first_x=posts.first_x + first_column * posts.step_x,
        first_y=posts.first_y + first_row * posts.step_y,
    )  # fmt: skip


def _window(at: FloatArray, count: int) -> tuple[slice, int]:
    """Return the posts along one axis, of ``count``, that are about all of ``at`` (N,), and the first one."""
    first = min(max(0, math.floor(float(at.min())) - POSTS_MORE), max(0, count - 2))
    last = max(min(count, math.ceil(float(at.max())) + POSTS_MORE + 1), first + 2)
    return slice(first, last), first


def _crs_of(datasets: Sequence[DatasetReader]) -> str:
    """Return the coordinate system that all files have."""
    systems = {None if dataset.crs is None else dataset.crs.to_wkt() for dataset in datasets}
    if len(systems) != 1 or None in systems:
        raise TerrainError(f"{len(systems)} coordinate systems", "one, that every file names")
    return str(systems.pop())


def _box(dataset: DatasetReader, edge: tuple[FloatArray, FloatArray]) -> tuple[float, float, float, float]:
    """Return the left, bottom, right and top of what is to be read; ``edge`` holds x and y, (N,) each."""
    transform: Any = dataset.transform
    if transform.b or transform.d:
        raise TerrainError("a turned raster", "rows along one of its coordinates")
    x, y = edge
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise TerrainError("bounds far outside of the map's coordinates", "a map of this area")
    left, right = _whole_steps(x, transform.c, transform.a)
    bottom, top = _whole_steps(y, transform.f, transform.e)
    return left, bottom, right, top


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


def _require_whole(up: SingleArray, place: Path) -> None:
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
