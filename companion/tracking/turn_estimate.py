"""An estimate of an aircraft's turn rate from the velocities that it reports.

An estimator of interacting multiple models [1]_: each model turns at one rate, and the aircraft may go over
from one to another at any time. The models are linear, and need no derivatives.

filterpy has such an estimator, but its import takes more than a second and 44 MB. The tests compare the two.

References
----------
.. [1] Blom and Bar-Shalom, "The Interacting Multiple Model Algorithm for Systems with Markovian Switching
   Coefficients", IEEE Transactions on Automatic Control 33 (8), 1988.
"""

from __future__ import annotations

import numpy as np

from companion.frames import FloatArray

RATES_RAD_S = np.radians([-6.0, -4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5, 6.0])  # 3°/s is a standard rate turn.
STRAIGHT_AT_FIRST = 0.9  # Most aircraft fly straight: two noisy velocities must not look like a turn.
KEPT_S = 20.0  # An aircraft changes its turn rate after this time on average.
VELOCITY_STD_M_S = 1.5  # Standard deviation of each component of a reported velocity.
ACCELERATION_STD_M_S2 = 1.0  # Standard deviation of each component, in addition to the turn.
GAP_MAX_S = 15.0  # The estimate begins anew after a longer silence.
FAR = 13.8  # It also begins anew if no model expects a velocity: 99.9 % of chi-square, two degrees.


def first_shares() -> FloatArray:
    """Return the shares (M,) of the models before two velocities are known."""
    others = (1.0 - STRAIGHT_AT_FIRST) / (len(RATES_RAD_S) - 1)
    return np.where(RATES_RAD_S == 0.0, STRAIGHT_AT_FIRST, others)


class TurnEstimate:
    """The turn rate of one aircraft; 0 until it has reported two velocities."""

    def __init__(self) -> None:
        count = len(RATES_RAD_S)
        self._stamp_s = -np.inf
        self._means, self._covariances = np.zeros((count, 2)), np.zeros((count, 2, 2))
        self._begin(np.zeros(2), np.eye(2))

    @property
    def rate_rad_s(self) -> float:
        """The turn rate, counter-clockwise [rad/s]: the mean of the models' rates."""
        return float(self._shares @ RATES_RAD_S)

    def observe(self, stamp_s: float, velocity_m_s: FloatArray) -> None:
        """Update the estimate; a velocity that is not newer than the last one is left out.

        Parameters
        ----------
        stamp_s : float
            Clock reading of the report [s].
        velocity_m_s : ndarray, shape (2,)
            East and north [m/s].
        """
        ahead_s = stamp_s - self._stamp_s
        if ahead_s <= 0.0:
            return
        self._stamp_s = stamp_s
        noise = VELOCITY_STD_M_S**2 * np.eye(2)
        if ahead_s > GAP_MAX_S:
            self._begin(velocity_m_s, noise)
            return
        predicted = self._mixed(ahead_s)
        total = self._covariances + noise
        missing = velocity_m_s - self._means
        inverse = np.linalg.inv(total)
        gains = self._covariances @ inverse
        far = np.einsum("mi,mij,mj->m", missing, inverse, missing)
        if far.min() > FAR:
            self._begin(velocity_m_s, noise)
            return
        logs = np.log(predicted) - 0.5 * (far + np.log(np.linalg.det(total)))
        self._shares = np.exp(logs - logs.max())
        self._shares /= self._shares.sum()
        self._means += np.einsum("mij,mj->mi", gains, missing)
        self._covariances -= gains @ self._covariances

    def _begin(self, velocity_m_s: FloatArray, covariance: FloatArray) -> None:
        """Begin with ``velocity_m_s`` (2,) and ``covariance`` (2, 2), which every model has alike."""
        self._shares = first_shares()
        self._means[:], self._covariances[:] = velocity_m_s, covariance

    def _mixed(self, ahead_s: float) -> FloatArray:
        """Mix the models and turn each as it turns; return their shares (M,) before the report."""
        count = len(RATES_RAD_S)
        stays = np.exp(-ahead_s / KEPT_S)
        goes_over = stays * np.eye(count) + (1.0 - stays) / count
        joint = self._shares[:, None] * goes_over  # from one model (row) to another (column)
        shares = joint.sum(axis=0)
        weights = joint / shares
        means = weights.T @ self._means
        apart = self._means[:, None] - means  # (from, to, 2)
        spread = self._covariances[:, None] + apart[..., :, None] * apart[..., None, :]
        covariances = np.einsum("fm,fmij->mij", weights, spread)
        cosine, sine = np.cos(RATES_RAD_S * ahead_s), np.sin(RATES_RAD_S * ahead_s)
        turns = np.array([[cosine, -sine], [sine, cosine]]).transpose(2, 0, 1)
        self._means = np.einsum("mij,mj->mi", turns, means)
        grown = (ACCELERATION_STD_M_S2 * ahead_s) ** 2 * np.eye(2)
        self._covariances = turns @ covariances @ turns.transpose(0, 2, 1) + grown
        return np.asarray(shares)
