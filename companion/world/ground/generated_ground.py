"""Ground without a map: computed from a seed, or the real ground that comes with matplotlib."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from companion.frames import FloatArray, LocalFrame
from companion.types.elevation import ElevationPosts
from companion.world.ground.elevation_file import TerrainError

SPACING_M = 30.0
MORE_M = 90.0  # Posts reach this far beyond the bounds.
HILL_M = 280.0  # Hills are about this wide.
RIDGE_EVERY_M, RIDGE_M = 1_500.0, 230.0  # Distance between ridges, and their standard deviation.
PASS_M, PASS_SHARE = 260.0, 0.7  # Passes have this standard deviation, and are lower by this share.
ROUGH_SHARE = 0.15  # This share of the relief of ridges is hills.
SAMPLE_FILE = "jacksboro_fault_dem.npz"


def generated_posts(
    kind: str, seed: int, relief_m: float, frame: LocalFrame, bounds: Sequence[float]
) -> ElevationPosts:
    """Return generated ground over the bounds; its lowest post has the height of the origin.

    Parameters
    ----------
    kind : str
        ``hills``, or ``ridges`` across the longer side of the bounds, each with a pass.
    seed : int
        The same seed and bounds give the same ground.
    relief_m : float
        From the lowest to the highest post [m].
    frame : LocalFrame
        The local frame.
    bounds : sequence of float
        East and north, each low and high [m].
    """
    west, east, south, north = bounds[:4]
    rng = np.random.default_rng(seed)
    at_east = np.arange(west - MORE_M, east + MORE_M + SPACING_M, SPACING_M)
    at_north = np.arange(south - MORE_M, north + MORE_M + SPACING_M, SPACING_M)
    up = _hills(rng, (len(at_north), len(at_east)))
    if kind == "ridges":
        is_wide = east - west >= north - south
        along, across = (at_east, at_north) if is_wide else (at_north, at_east)
        ridges = _ridges(rng, along, across)
        up = ROUGH_SHARE * up + (1.0 - ROUGH_SHARE) * (ridges if is_wide else ridges.T)
    up = relief_m * (up - up.min()) / (up.max() - up.min())
    return ElevationPosts(
        up, float(at_east[0]), float(at_north[0]), SPACING_M, SPACING_M, frame.crs, frame, f"{kind} {seed}"
    )


def _hills(rng: np.random.Generator, shape: tuple[int, int]) -> FloatArray:
    """Return smooth random heights from 0 to 1, (R, C)."""
    rough = _smoothed(_smoothed(rng.standard_normal(shape)).T).T
    return np.asarray((rough - rough.min()) / (rough.max() - rough.min()))


def _smoothed(rough: FloatArray) -> FloatArray:
    """Return ``rough`` (R, C) smoothed along columns by a normal distribution, (R, C); its ends reflect."""
    deviation = HILL_M / SPACING_M
    reach = int(4.0 * deviation + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    padded = np.pad(rough, ((reach, reach), (0, 0)), mode="symmetric")
    parts = (weight * padded[first : first + len(rough)] for first, weight in enumerate(weights))
    return np.asarray(sum(parts) / weights.sum())


def _ridges(rng: np.random.Generator, along: FloatArray, across: FloatArray) -> FloatArray:
    """Return ridges of height 1 at distances ``along`` (A,), which run ``across`` (B,) [m], (B, A)."""
    count = max(1, math.floor((along[-1] - along[0]) / RIDGE_EVERY_M))
    up = np.zeros((len(across), len(along)))
    for number in range(count):
        middle = along[0] + (number + 0.5 + rng.uniform(-0.15, 0.15)) * (along[-1] - along[0]) / count
        bend, phase = rng.uniform(100.0, 250.0), rng.uniform(0.0, 2.0 * math.pi)
        crest = middle + bend * np.sin(2.0 * math.pi * (across - across[0]) / 2_500.0 + phase)
        gap = rng.uniform(across[0] + 2.0 * PASS_M, across[-1] - 2.0 * PASS_M)
        height = 1.0 - PASS_SHARE * np.exp(-0.5 * ((across - gap) / PASS_M) ** 2)
        profile = np.exp(-0.5 * ((along[None, :] - crest[:, None]) / RIDGE_M) ** 2)
        up = np.maximum(up, height[:, None] * profile)
    return up


def sample_posts(frame: LocalFrame) -> ElevationPosts:
    """Return the ground of matplotlib's sample map: 403 by 344 posts, 3 seconds of arc apart.

    Raises
    ------
    TerrainError
        If matplotlib is missing.
    """
    try:
        from matplotlib import cbook  # noqa: PLC0415 - An extra.
    except ImportError:
        raise TerrainError("matplotlib is not installed", "the extra plot, whose sample this is") from None
    data: Any = cbook.get_sample_data(SAMPLE_FILE)
    step = float(data["dx"])
    return ElevationPosts(
        data["elevation"].astype(np.float64) - frame.altitude_amsl_m,
        float(data["xmin"]) + 0.5 * step, float(data["ymin"]) - 0.5 * step, step, -step,
        "EPSG:4326", frame, SAMPLE_FILE,
    )  # fmt: skip
