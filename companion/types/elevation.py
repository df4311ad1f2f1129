"""Heights of the ground as a file holds them: posts on a regular grid of its own coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from companion.frames import LocalFrame, SingleArray


@dataclass(frozen=True, slots=True, eq=False)
class ElevationPosts:
    """Heights at posts, bilinear in between.

    Parameters
    ----------
    up_m : ndarray, shape (NY, NX)
        Heights of the posts in the local frame [m], single precision (1 mm at 9 km); not a number where
        a map has none.
    first_x, first_y : float
        Coordinates of the post in row 0 and column 0.
    step_x, step_y : float
        From post to post along a row and along a column; ``step_y`` may be negative.
    crs : str
        The coordinate system, in any form that PROJ reads.
    frame : LocalFrame
        The local frame.
    name : str
        The source, in messages.
    """

    up_m: SingleArray
    first_x: float
    first_y: float
    step_x: float
    step_y: float
    crs: str
    frame: LocalFrame
    name: str

    def __post_init__(self) -> None:
        heights = np.asarray(self.up_m, dtype=np.float32).view()
        heights.setflags(write=False)
        object.__setattr__(self, "up_m", heights)
