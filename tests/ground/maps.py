"""Maps of heights for tests."""

import numpy as np

from companion.frames import LocalFrame
from companion.types.elevation import ElevationPosts

FRAME = LocalFrame(-35.363261, 149.16523, 584.0)
BOUNDS = (0.0, 1000.0, 0.0, 800.0)


def posts_over(height, *, spacing=50.0, bounds=BOUNDS, frame=FRAME):
    """Posts in the local frame, their height a function of east and north."""
    east = np.arange(bounds[0] - 2.0 * spacing, bounds[1] + 2.5 * spacing, spacing)
    north = np.arange(bounds[2] - 2.0 * spacing, bounds[3] + 2.5 * spacing, spacing)
    up = height(*np.meshgrid(east, north))
    return ElevationPosts(
        np.broadcast_to(up, (len(north), len(east))), east[0], north[0], spacing, spacing, frame.crs, frame,
        "a function",
    )  # fmt: skip


def hill(east, north):
    """A hill 300 m high in the middle of the bounds."""
    return 300.0 * np.exp(-((east - 500.0) ** 2 + (north - 400.0) ** 2) / 150.0**2)


def rough(seed):
    """Random heights up to 200 m."""
    rng = np.random.default_rng(seed)
    return lambda east, north: rng.uniform(0.0, 200.0, np.shape(east))


def bilinear(posts, east, north):
    """Height between four posts, by the definition."""
    across, along = (east - posts.first_x) / posts.step_x, (north - posts.first_y) / posts.step_y
    i, j = int(across), int(along)
    u, v = across - i, along - j
    up = posts.up_m
    return (
        (1 - u) * (1 - v) * up[j, i] + u * (1 - v) * up[j, i + 1]
        + (1 - u) * v * up[j + 1, i] + u * v * up[j + 1, i + 1]
    )  # fmt: skip
