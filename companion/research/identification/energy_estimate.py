"""Estimates the three numbers of the model of power from the energy used in recorded flights.

Energy used in a window = A·∫(v/v_c)³dt + B·∫n²(v_c/v)dt + c·Δh, by linear least squares over the windows,
with the airspeed v_c of cruise. A + B is then the power of level flight at cruise. Windows in which the motor
idles are left out: there the power is no longer linear in the climb.

References
----------
Draper, Smith, *Applied Regression Analysis*, Wiley 1998, chapter 5 (least squares and its intervals).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.research.identification.energy_samples import EnergyWindow
from companion.research.identification.noise_estimate import NORMAL_95, NoiseKey, independent_samples
from companion.world.vehicle.vehicle_model import VehicleModel

WINDOWS_MIN = 20  # With fewer windows nothing is estimated.
LAG_MAX = 6  # Residuals of windows that are farther apart count as independent.
IDLE_SHARE = 0.25  # A window whose power is below this share of cruise may hold an idling motor.
ROUNDS = 3  # Which windows idle depends on the model, and the model on them; this often it is tried.
UNCERTAINTY_MAX = 0.5  # A key is not reported if its interval reaches farther than this share of its value.


@dataclass(frozen=True, slots=True)
class _Fit:
    """``coefficients`` (3,): A, B [W] and c [J/m]; their ``covariance`` (3, 3); and the number of windows."""

    coefficients: FloatArray
    covariance: FloatArray
    num: int


def energy_keys(windows: Sequence[EnergyWindow], vehicle: VehicleModel) -> tuple[NoiseKey, ...]:
    """Return the keys of the section ``energy`` that recordings can tell, with 95 % intervals.

    Parameters
    ----------
    windows : sequence of EnergyWindow
        Windows of all recordings, in order; without any there are no keys.
    vehicle : VehicleModel
        The aircraft, for its airspeeds of cruise and at most.
    """
    ratio = vehicle.airspeed_max_m_s / vehicle.airspeed_cruise_m_s
    rows = {
        "power_cruise_w": np.array([1.0, 1.0, 0.0]),
        "power_max_airspeed_w": np.array([ratio**3, 1.0 / ratio, 0.0]),
        "climb_energy_j_m": np.array([0.0, 0.0, 1.0]),
    }
    if not windows:
        return ()
    fit = _fitted(windows, vehicle.airspeed_cruise_m_s) if len(windows) >= WINDOWS_MIN else None
    if fit is None or fit.num < WINDOWS_MIN:
        num = len(windows) if fit is None else fit.num
        note = f"too little: {num} windows of flight with battery messages; {WINDOWS_MIN} are needed"
        return tuple(NoiseKey(name, None, math.nan, math.nan, note) for name in rows)
    return tuple(_key(name, row, fit) for name, row in rows.items())


def _key(name: str, row: FloatArray, fit: _Fit) -> NoiseKey:
    """Return the key that is a sum of the coefficients, weighted by ``row``, shape (3,)."""
    value = float(row @ fit.coefficients)
    half = NORMAL_95 * math.sqrt(float(row @ fit.covariance @ row))
    note = f"{fit.num} windows"
    if not half <= UNCERTAINTY_MAX * value:
        wanted = "climbs and descents" if name == "climb_energy_j_m" else "other airspeeds"
        note = f"too little: {value:.3g} ± {half:.2g} in {note}; fly {wanted}, too"
        return NoiseKey(name, None, math.nan, math.nan, note)
    return NoiseKey(name, value, max(value - half, 0.0), value + half, note)


def _fitted(windows: Sequence[EnergyWindow], cruise_m_s: float) -> _Fit:
    """Least squares over the windows in which the motor does not idle."""
    table = np.array([[w.cubes / cruise_m_s**3, w.loads * cruise_m_s, w.climb_m] for w in windows])
    energy, seconds = np.array([w.energy_j for w in windows]), np.array([w.seconds for w in windows])
    kept = np.ones(len(windows), dtype=np.bool_)
    for _ in range(ROUNDS):
        coefficients = _least_squares(table[kept], energy[kept])
        power = table @ coefficients / seconds
        kept = power >= IDLE_SHARE * (coefficients[0] + coefficients[1])
        if kept.sum() < WINDOWS_MIN:
            return _Fit(coefficients, np.zeros((3, 3)), int(kept.sum()))
    residuals = (energy - table @ coefficients)[kept]
    share = len(residuals) / independent_samples([residuals - residuals.mean()], LAG_MAX)
    variance = float(residuals @ residuals) / (len(residuals) - 3) * share
    covariance: FloatArray = variance * np.linalg.pinv(table[kept].T @ table[kept])
    return _Fit(coefficients, covariance, int(kept.sum()))


def _least_squares(table: FloatArray, energy: FloatArray) -> FloatArray:
    """The coefficients, shape (3,), of ``table`` (N, 3) that explain ``energy`` (N,); none is negative.

    A drag that comes out negative is zero, and the others are fitted without it: a flight at one airspeed
    does not tell the two drags apart.
    """
    active = [0, 1, 2]
    while True:
        found = np.zeros(3)
        found[active] = np.linalg.lstsq(table[:, active], energy, rcond=None)[0]
        negative = [index for index in active if found[index] < 0.0]
        if not negative:
            return found
        active.remove(min(negative, key=lambda index: found[index]))
