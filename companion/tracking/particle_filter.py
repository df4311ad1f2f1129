"""Particle filter of a moving threat (paper 3.2.1).

The state is ``[x, ẋ, y, ẏ]``: east [m], east speed [m/s], north [m], north speed [m/s]. The model is constant
velocity with white acceleration noise. It differs from the paper in three points, where the paper is silent
or would fail on board:

- *Irregular times.* With the printed noise (one acceleration held for the whole step τ) the spread after 10 s
  depends on the number of detections in that time. Here the noise is white in time, with the spectral density
  that gives the paper's velocity variance after its step of 1 s. Steps then add up: predicting 3 s and 7 s
  gives the same as predicting 10 s.
- *Accurate detections after a gap.* Sampling from the prediction leaves few particles near the detection.
Given a
  particle, prediction and likelihood are both Gaussian. Each particle is therefore drawn from their product
  and weighted by the detection's probability given its origin (the optimal importance density). If even then
  a few particles carry all the weight, the cloud does not represent its own spread; its moments are then
  updated in closed form, and the cloud is sampled again.
- *Copies.* Resampling duplicates particles. Each one is then moved by a small kernel and drawn towards the
mean by
  the same amount, which preserves mean and covariance.

References
----------
Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
6.2.2 (white-noise acceleration). Doucet, Godsill and Andrieu, *Statistics and Computing* 10, 2000,
II.D (optimal importance density). Liu and West, in *Sequential Monte Carlo Methods in Practice*,
2001, ch. 10 (kernel with shrinkage). Kotecha and Djurić, *IEEE Trans. Signal Processing* 51, 2003
(Gaussian particle filter).
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.tracking.resampling import systematic_resample

POSITION_ROWS = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
STATE_ROWS = np.eye(4)
# Keeps a covariance invertible if all particles agree; far below the variance of any sensor.
VARIANCE_FLOOR = 1e-6
# Larger than rounding errors, so that filterpy's search stops at the last cumulated weight.
WEIGHT_MARGIN = 1e-9

_legacy_generator_lock = threading.Lock()


class UpdateResult(Enum):
    """Result of a detection."""

    APPLIED = "applied"
    # The detection is older than the filter and was weighted after retrodiction.
    APPLIED_LATE = "applied_late"
    TOO_LATE = "too_late"


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Settings of the particle filter.

    Parameters
    ----------
    num_particles : int
        Number of particles, N_s of the paper.
    acceleration_std_m_s2 : float
        Acceleration noise σ_ω of the paper: the deviation of the velocity after one second; it grows with the
        square root of time [m/s²].
    velocity_std_m_s : float
        Standard deviation of a reported velocity, each axis [m/s].
    use_reported_velocity : bool
        True to use reported velocities as observations; the paper observes positions only.
    late_max_s : float
        Largest age of a detection relative to the filter [s].
    num_effective_min : float
        Number of effective particles below which the moments are updated instead.
    """

    num_particles: int = 500
    acceleration_std_m_s2: float = 3.0
    velocity_std_m_s: float = 2.0
    use_reported_velocity: bool = True
    late_max_s: float = 5.0
    num_effective_min: float = 25.0

    def __post_init__(self) -> None:
        if self.num_particles < 8:
            raise ValueError("a covariance of four numbers needs 8 particles or more")
        if min(self.acceleration_std_m_s2, self.late_max_s) < 0.0 or self.velocity_std_m_s <= 0.0:
            raise ValueError("standard deviations and times are positive")


def transition(elapsed_s: float) -> FloatArray:
    """Return the transition matrix, shape (4, 4), over a time, which is negative for retrodiction."""
    matrix = np.eye(4)
    matrix[0, 1] = matrix[2, 3] = elapsed_s
    return matrix


def process_noise(elapsed_s: float, acceleration_std_m_s2: float) -> FloatArray:
    """Return the process noise over a time; for a negative time that of the retrodicted state.

    A past state is ``x − v·lag`` minus the noise since then: the variances are the same, and the correlation
    of position and velocity has the opposite sign.

    Parameters
    ----------
    elapsed_s : float
        Time; negative for retrodiction [s].
    acceleration_std_m_s2 : float
        Acceleration noise, as in :class:`FilterSettings` [m/s²].

    Returns
    -------
    ndarray, shape (4, 4)
        Covariance of the state, each entry in the product of its two units.
    """
    span = abs(elapsed_s)
    cross = 0.5 * elapsed_s * span
    block = np.array([[span**3 / 3.0, cross], [cross, span]])
    noise = np.zeros((4, 4))
    noise[:2, :2] = noise[2:, 2:] = acceleration_std_m_s2**2 * block
    return noise


class ParticleFilter:
    """Cloud of equally weighted particles of one vehicle.

    Parameters
    ----------
    stamp_s : float
        Time of the first detection [s].
    position_m : ndarray, shape (2,)
        East and north of the first detection [m].
    position_std_m : float
        Standard deviation of that position, each axis [m].
    velocity_m_s : ndarray, shape (2,), or None
        Reported velocity east and north [m/s]; with None all velocities up to the speed limit are equally
        likely.
    speed_max_m_s : float
        Highest speed of the vehicle [m/s].
    settings : FilterSettings
        Settings of the particle filter.
    generator : numpy.random.Generator
        Source of all random numbers.
    """

    def __init__(
        self,
        *,
        stamp_s: float,
        position_m: FloatArray,
        position_std_m: float,
        velocity_m_s: FloatArray | None,
        speed_max_m_s: float,
        settings: FilterSettings,
        generator: np.random.Generator,
    ) -> None:
        self._settings = settings
        self._generator = generator
        self.stamp_s = stamp_s
        num = settings.num_particles
        self._particles = np.empty((num, 4))
        self._particles[:, ::2] = position_m + position_std_m * generator.standard_normal((num, 2))
        if velocity_m_s is None:
            radius = max(speed_max_m_s, settings.velocity_std_m_s) * np.sqrt(generator.random(num))
            angle = 2.0 * math.pi * generator.random(num)
            self._particles[:, 1] = radius * np.cos(angle)
            self._particles[:, 3] = radius * np.sin(angle)
        else:
            noise = settings.velocity_std_m_s * generator.standard_normal((num, 2))
            self._particles[:, 1::2] = velocity_m_s + noise

    @property
    def mean(self) -> FloatArray:
        """Mean state, shape (4,), at ``stamp_s``."""
        return np.asarray(self._particles.mean(axis=0))

    @property
    def covariance(self) -> FloatArray:
        """Covariance, shape (4, 4), at ``stamp_s``: symmetric, positive definite."""
        return _covariance(self._particles, np.full(len(self._particles), 1.0 / len(self._particles)))

    def moments(self, instant_s: float) -> tuple[FloatArray, FloatArray]:
        """Return mean, shape (4,), and covariance, shape (4, 4), at an instant before or after ``stamp_s``.

        They are computed in closed form; the cloud does not change.
        """
        elapsed = instant_s - self.stamp_s
        step = transition(elapsed)
        noise = process_noise(elapsed, self._settings.acceleration_std_m_s2)
        covariance = step @ self.covariance @ step.T + noise
        return step @ self.mean, 0.5 * (covariance + covariance.T)

    def squared_distance(self, stamp_s: float, position_m: FloatArray, position_std_m: float) -> float:
        """Return the squared Mahalanobis distance of a ``position_m`` (2,) [m] from the prediction."""
        mean, covariance = self.moments(stamp_s)
        innovation = position_m - POSITION_ROWS @ mean
        innovation_covariance = POSITION_ROWS @ covariance @ POSITION_ROWS.T + position_std_m**2 * np.eye(2)
        return float(innovation @ np.linalg.solve(innovation_covariance, innovation))

    def observe(
        self,
        stamp_s: float,
        position_m: FloatArray,
        position_std_m: float,
        velocity_m_s: FloatArray | None = None,
        velocity_std_m_s: float | None = None,
    ) -> UpdateResult:
        """Update the cloud with a detection.

        Parameters
        ----------
        stamp_s : float
            Clock reading at which the detection was true [s]; it may lie before the filter's time.
        position_m : ndarray, shape (2,)
            East and north of the detection [m].
        position_std_m : float
            Standard deviation of that position, each axis [m].
        velocity_m_s : ndarray, shape (2,), optional
            Reported velocity east and north [m/s].
        velocity_std_m_s : float, optional
            Standard deviation of that velocity, each axis [m/s]; that of the settings if none is given.
        """
        velocity_std_m_s = velocity_std_m_s or self._settings.velocity_std_m_s
        elapsed = stamp_s - self.stamp_s
        if elapsed < -self._settings.late_max_s:
            return UpdateResult.TOO_LATE
        rows, observed, variances = self._observation(
            position_m, position_std_m, velocity_m_s, velocity_std_m_s
        )
        noise = process_noise(elapsed, self._settings.acceleration_std_m_s2)
        predicted = self._particles @ transition(elapsed).T
        innovations = observed - predicted @ rows.T
        innovation_covariance = rows @ noise @ rows.T + np.diag(variances)
        weights = _normalised(innovations, innovation_covariance)
        scarce = 1.0 / float(weights @ weights) < self._settings.num_effective_min
        if scarce:
            self._resample_moments(max(stamp_s, self.stamp_s), stamp_s, rows, observed, variances)
        elif elapsed < 0.0:
            self._resample(weights)
        else:
            gain = noise @ rows.T @ np.linalg.inv(innovation_covariance)
            posterior = noise - gain @ rows @ noise
            drawn = self._generator.standard_normal(predicted.shape) @ _root(posterior).T
            self._particles = predicted + innovations @ gain.T + drawn
            self._resample(weights)
        self.stamp_s = max(stamp_s, self.stamp_s)
        return UpdateResult.APPLIED if elapsed >= 0.0 else UpdateResult.APPLIED_LATE

    def _observation(
        self,
        position_m: FloatArray,
        position_std_m: float,
        velocity_m_s: FloatArray | None,
        velocity_std_m_s: float,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return observation matrix, shape (M, 4), observed values and their variances, shape (M,) each.

        ``position_m`` (2,) [m] and ``velocity_m_s`` (2,) [m/s] are east and north. M is 4 if a velocity is
        reported and used, else 2.
        """
        if velocity_m_s is None or not self._settings.use_reported_velocity:
            return POSITION_ROWS, position_m, np.full(2, position_std_m**2)
        observed = np.array([position_m[0], velocity_m_s[0], position_m[1], velocity_m_s[1]])
        stds = np.array([position_std_m, velocity_std_m_s] * 2)
        return STATE_ROWS, observed, stds**2

    def _resample(self, weights: FloatArray) -> None:
        """Resample the cloud by ``weights``, shape (N,), and move each particle by the kernel."""
        num = len(weights)
        mean = weights @ self._particles
        root = _root(_covariance(self._particles, weights))
        bandwidth = (2.0 / 3.0) ** 0.125 * num**-0.125  # Silverman's rule in four dimensions
        kept = self._particles[_systematic(weights, self._generator)]
        moved = self._generator.standard_normal((num, 4)) @ root.T
        self._particles = mean + math.sqrt(1.0 - bandwidth**2) * (kept - mean) + bandwidth * moved

    def _resample_moments(
        self,
        instant_s: float,
        stamp_s: float,
        rows: FloatArray,
        observed: FloatArray,
        variances: FloatArray,
    ) -> None:
        """Sample the cloud again from its moments, updated in closed form and moved to ``instant_s``.

        ``rows``, shape (M, 4), is the observation matrix; ``observed``, shape (M,), are the observed values
        and ``variances``, shape (M,), their variances.
        """
        mean, covariance = self.moments(stamp_s)
        innovation_covariance = rows @ covariance @ rows.T + np.diag(variances)
        gain = np.linalg.solve(innovation_covariance, rows @ covariance).T
        mean = mean + gain @ (observed - rows @ mean)
        keep = np.eye(4) - gain @ rows
        covariance = keep @ covariance @ keep.T + gain @ np.diag(variances) @ gain.T
        step = transition(instant_s - stamp_s)
        noise = process_noise(instant_s - stamp_s, self._settings.acceleration_std_m_s2)
        root = _root(step @ covariance @ step.T + noise)
        drawn = self._generator.standard_normal(self._particles.shape)
        self._particles = step @ mean + drawn @ root.T


def _normalised(innovations: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return Gaussian likelihoods, shape (N,), of ``innovations`` (N, M), scaled to a sum of 1.

    ``covariance``, shape (M, M), is that of the innovations. The logarithms are shifted by the largest one,
    so that one weight is 1 before scaling and none is NaN, however distant the detection.
    """
    distances = np.einsum("ni,ij,nj->n", innovations, np.linalg.inv(covariance), innovations)
    weights = np.exp(-0.5 * (distances - distances.min()))
    return np.asarray(weights / weights.sum())


def _covariance(particles: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the covariance (4, 4) of ``particles`` (N, 4) by ``weights`` (N,), plus the floor."""
    away = particles - weights @ particles
    covariance = (weights[:, None] * away).T @ away
    return np.asarray(0.5 * (covariance + covariance.T) + VARIANCE_FLOOR * np.eye(4))


def _root(covariance: FloatArray) -> FloatArray:
    """Return the square root (4, 4) of a ``covariance`` (4, 4) that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _systematic(weights: FloatArray, generator: np.random.Generator) -> NDArray[np.intp]:
    """Return the indices (N,) of systematic resampling by ``weights`` (N,), drawn by filterpy.

    filterpy draws from NumPy's global generator. It is seeded for this call and then restored, so that a
    track depends on its own seed only and other random numbers do not change.
    """
    seed = int(generator.integers(2**32))
    with _legacy_generator_lock:
        saved = np.random.get_state()  # noqa: NPY002 - filterpy draws from this state.
        try:
            np.random.seed(seed)  # noqa: NPY002
            indices = systematic_resample(weights * (1.0 + WEIGHT_MARGIN))
        finally:
            np.random.set_state(saved)  # noqa: NPY002
    return np.asarray(indices, dtype=np.intp)
