"""Near mid-air collision, loss of well clear and its severity, by the volumes of the standards.

References
----------
.. [1] RTCA DO-365B, "Minimum Operational Performance Standards for Detect and Avoid Systems". Its numbers
   are restated in DAIDALUS' configuration ``DO_365B_no_SUM.conf``, which rounds 4000 ft up to 0.66 nmi.
.. [2] ASTM F3442/F3442M, "Standard Specification for Detect and Avoid System Performance Requirements":
   2000 ft and 250 ft, about aircraft of at most 25 ft and 100 kt. PX4 restates both its volumes in metres.
.. [3] Muñoz, Narkawicz, Chamberlain, Consiglio, Upchurch, "A Family of Well-Clear Boundary Models for the
   Integration of UAS in the NAS", AIAA 2014-2412: modified tau, and the miss distance by constant velocity.
.. [4] RTCA SC-228, "Closed-Loop Metrics White Paper": the severity of loss of well clear, by E. Pratt and
   J. Kay; the R package ``flightconflicts`` restates it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray

FOOT_M = 0.3048

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Volume:
    """A volume about an aircraft that others are to stay out of.

    Parameters
    ----------
    distance_m : float
        Horizontal distance: DMOD, and the miss distance HMD in the same length [m].
    height_m : float
        Vertical distance [m].
    tau_s : float
        Modified tau within which a coming miss distance counts [s]; 0 counts the present distance alone.
    """

    distance_m: float
    height_m: float
    tau_s: float = 0.0

    def is_inside(self, away_m: FloatArray, velocity_m_s: FloatArray) -> BoolArray:
        """Return at which instants the other aircraft is in the volume; its surface belongs to it.

        Parameters
        ----------
        away_m, velocity_m_s : ndarray, shape (N, 3)
            Position and velocity of the other aircraft less those of the own: east, north, up [m], [m/s].

        Returns
        -------
        ndarray, shape (N,)
            Whether it is inside, at each instant.
        """
        distance, miss, rate = _horizontal(away_m, velocity_m_s)
        near = distance <= self.distance_m
        if self.tau_s > 0.0:
            # τ_mod = (DMOD² - r²)/(r ṙ) ≤ τ without a division; r ṙ < 0 while they come nearer.
            comes = rate < 0.0
            soon = self.distance_m**2 - distance**2 >= self.tau_s * rate
            near = near | (comes & soon & (miss <= self.distance_m))
        found: BoolArray = near & (np.abs(away_m[:, 2]) <= self.height_m)
        return found

    def severity(self, away_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Return how deep the other aircraft is in the volume: 0 at its surface and outside, 1 at its centre.

        ``1 - FG(FG(r/S, HMD/DMOD), h/H)`` with the norm of Fernández-Guasti ``FG(x, y)² = x² + y² - x² y²``
        and ``S = ½ (√((ṙ τ)² + 4 DMOD²) - ṙ τ)``, the range at which modified tau is τ; at least DMOD [4]_.

        Parameters
        ----------
        away_m, velocity_m_s : ndarray, shape (N, 3)
            Position and velocity of the other aircraft less those of the own: east, north, up [m], [m/s].

        Returns
        -------
        ndarray, shape (N,)
            The severity at each instant, from 0 to 1.
        """
        distance, miss, rate = _horizontal(away_m, velocity_m_s)
        closing = np.divide(rate, distance, out=np.zeros_like(rate), where=distance > 0.0) * self.tau_s
        reach = np.maximum(0.5 * (np.sqrt(closing**2 + 4.0 * self.distance_m**2) - closing), self.distance_m)
        parts = (distance / reach, miss / self.distance_m, np.abs(away_m[:, 2]) / self.height_m)
        along, across, up = (np.minimum(part, 1.0) ** 2 for part in parts)
        inside = (1.0 - along) * (1.0 - across) * (1.0 - up)  # 1 - FG(x, y)² = (1 - x²)(1 - y²)
        return np.asarray(1.0 - np.sqrt(1.0 - inside))


NEAR_MID_AIR_COLLISION = Volume(500.0 * FOOT_M, 100.0 * FOOT_M)  # [1]_ and [2]_
EN_ROUTE = Volume(4000.0 * FOOT_M, 450.0 * FOOT_M, 35.0)  # [1]_, DAA well clear of phase 1
NON_COOPERATIVE = Volume(2200.0 * FOOT_M, 450.0 * FOOT_M)  # [1]_
SMALL_AIRCRAFT = Volume(2000.0 * FOOT_M, 250.0 * FOOT_M)  # [2]_


def _horizontal(away_m: FloatArray, velocity_m_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance [m], miss distance to come [m], and r ṙ [m²/s], each (N,).

    ``away_m`` and ``velocity_m_s`` are (N, 3).
    """
    away, velocity = away_m[:, :2], velocity_m_s[:, :2]
    rate, square = (away * velocity).sum(axis=1), (velocity**2).sum(axis=1)
    wait = np.divide(-rate, square, out=np.zeros_like(rate), where=square > 0.0)
    miss = away + np.maximum(wait, 0.0)[:, None] * velocity
    return np.hypot(*away.T), np.hypot(*miss.T), rate
