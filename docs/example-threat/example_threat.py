"""A radar that sees a sector only: a pattern to copy for models of static threats."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from companion.types.threat import Radar


class SectorRadar:
    """The sight of a radar that does not turn.

    Parameters
    ----------
    radar : Radar
        The radar whose sight it is.
    middle_deg : float
        Where it looks, clockwise from north.
    width_deg : float
        Width of what it sees.
    lowest_deg : float, optional
        It sees nothing below this angle over the horizontal.
    """

    def __init__(self, radar: Radar, middle_deg: float, width_deg: float, lowest_deg: float = -90.0) -> None:
        if not 0.0 < width_deg <= 360.0:
            raise ValueError(f"a sector of {width_deg:g} degrees")
        self._east_m, self._north_m, self._up_m = radar.position_enu_m
        self._middle_rad, self._half_rad = math.radians(middle_deg), math.radians(0.5 * width_deg)
        self._rise = math.tan(math.radians(lowest_deg)) if lowest_deg > -90.0 else -math.inf

    def __call__(self, places_enu_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return from which height on the radar sees the aircraft over each place.

        Parameters
        ----------
        places_enu_m : ndarray, shape (N, 2)
            East and north [m].

        Returns
        -------
        ndarray, shape (N,)
            Up coordinates [m]; infinite outside the sector.
        """
        east, north = (places_enu_m - (self._east_m, self._north_m)).T
        off = np.arctan2(east, north) - self._middle_rad
        is_inside = np.abs(np.angle(np.exp(1j * off))) <= self._half_rad
        away = np.maximum(np.hypot(east, north), 1e-3)
        return np.where(is_inside, self._up_m + self._rise * away, np.inf)
