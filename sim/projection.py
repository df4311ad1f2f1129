"""The local frame's projection, approximated by polynomials.

The simulator converts positions some hundred times a simulated second, far too often for a
general projection library. Within the flying area two cubic polynomials do the same to the
millimetre; they are fitted to :class:`companion.frames.LocalFrame` itself, so the two cannot differ
by more than the checked residual.
"""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray, LocalFrame

_REACH_M = 20_000.0
_RESIDUAL_MAX_M = 0.05
_METRES_PER_DEGREE = 111_000.0


def _terms(first: FloatArray, second: FloatArray) -> FloatArray:
    """Monomials (N, 10) up to the third degree of ``first`` (N,) and ``second`` (N,).

    In the order in which :func:`_value` reads them.
    """
    a, b = first, second
    columns = [np.ones_like(a), a, b, a * a, a * b, b * b, a * a * a, a * a * b, a * b * b, b * b * b]
    return np.column_stack(columns)


def _value(coefficients: tuple[float, ...], a: float, b: float) -> float:
    c0, c1, c2, c3, c4, c5, c6, c7, c8, c9 = coefficients
    return c0 + a * (c1 + a * (c3 + a * c6 + b * c7) + b * (c4 + b * c8)) + b * (c2 + b * (c5 + b * c9))


class FastProjection:
    """WGS84 degrees to east and north metres and back, near the frame's origin.

    Parameters
    ----------
    frame : LocalFrame
        Frame to approximate, to 5 cm within 20 km of its origin.

    Raises
    ------
    ValueError
        If the polynomial does not match the frame that well (near a pole).
    """

    def __init__(self, frame: LocalFrame) -> None:
        self.frame = frame
        axis = np.linspace(-_REACH_M, _REACH_M, 15)
        east, north = (grid.ravel() for grid in np.meshgrid(axis, axis))
        points = [frame.global_from_local(float(e), float(n), 0.0) for e, n in zip(east, north, strict=True)]
        latitude = np.array([point[0] for point in points]) - frame.latitude_deg
        longitude = np.array([point[1] for point in points]) - frame.longitude_deg
        self._east = self._fit(_terms(latitude, longitude), east, 1.0)
        self._north = self._fit(_terms(latitude, longitude), north, 1.0)
        kilometres = _terms(east * 1e-3, north * 1e-3)
        self._latitude = self._fit(kilometres, latitude, _METRES_PER_DEGREE)
        self._longitude = self._fit(kilometres, longitude, _METRES_PER_DEGREE)

    @staticmethod
    def _fit(terms: FloatArray, values: FloatArray, metres_per_unit: float) -> tuple[float, ...]:
        """Coefficients of ``terms``, shape (N, 10), that give ``values``, shape (N,)."""
        scale = np.abs(terms).max(axis=0)
        solution = np.linalg.lstsq(terms / scale, values, rcond=None)[0] / scale
        residual_m = float(np.abs(terms @ solution - values).max()) * metres_per_unit
        if residual_m > _RESIDUAL_MAX_M:
            raise ValueError(f"the local frame cannot be fitted: {residual_m:.3f} m off")
        return tuple(float(value) for value in solution)

    def local(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """East and north [m] of a WGS84 point."""
        a, b = latitude_deg - self.frame.latitude_deg, longitude_deg - self.frame.longitude_deg
        return _value(self._east, a, b), _value(self._north, a, b)

    def degrees(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Latitude and longitude [deg] of a local point."""
        a, b = east_m * 1e-3, north_m * 1e-3
        return (
            self.frame.latitude_deg + _value(self._latitude, a, b),
            self.frame.longitude_deg + _value(self._longitude, a, b),
        )
