"""Estimates the noise of LQG-MP from recorded flights.

The autopilot reports its estimate of the position, so that deviations from the plan have covariance Λ.
Straight on at cruise LQG-MP ends in a stationary Λ that grows with the process noise. The process noise is
identified as that at which Λ has the measured deviations. Across the path only the rate of turn's noise
counts, in height only the climb's, in speed only the acceleration's.

References
----------
Zięba, Ramza, "Standard deviation of the mean of autocorrelated observations", Metrol. Meas. Syst. 18(4),
2011 (the number of independent samples). Wilson, Hilferty, PNAS 17, 1931 (quantiles of χ²).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from companion.frames import FloatArray
from companion.kernels.aircraft.lqg_mp import propagate
from companion.kernels.workspace import filter_scratch
from companion.research.identification.flown_samples import Deviations, Flown, ReportedErrors
from companion.world.vehicle.lqg import tables_once
from companion.world.vehicle.vehicle_model import VehicleModel

TRACKED_MIN_S = 60.0  # With less flight along plans nothing is estimated.
INDEPENDENT_MIN = 8.0  # With fewer independent samples nothing is estimated.
REPORTED_MIN = 20  # Least number of fixes, or of differences between them.
TAU_S = 1.0
STRAIGHT_ON = (0.0, 0.0, 0.0)
LAG_MAX_S = 60.0
SETTLED = 1e-6  # Λ counts as stationary when a step changes it by less.
STEPS_MAX = 2_000
BISECTIONS = 40
NORMAL_95 = 1.96
OUTLIER = 6.0  # A fix that is this many median deviations off has jumped.
FIGURES = ("across the path", "ahead of its times", "above it", "course", "climb angle", "airspeed")
FIGURE_UNITS = ("m", "m", "m", "°", "°", "m/s")
ACROSS, ABOVE, SPEED = 0, 2, 5
LARGEST = {"acceleration_std_m_s2": 20.0, "course_rate_std_rad_s": 1.0, "climb_rate_std_rad_s": 1.0}


@dataclass(frozen=True, slots=True)
class Spread:
    """Spread of samples.

    Parameters
    ----------
    name, unit : str
        Name of the quantity, and its unit.
    mean, std : float
        Mean and standard deviation: about zero for positions, about the mean for speeds and angles.
    low, high : float
        95 % interval of the deviation.
    num : int
        Number of samples.
    num_independent : float
        Effective number of independent samples.
    """

    name: str
    unit: str
    mean: float
    std: float
    low: float
    high: float
    num: int
    num_independent: float

    @property
    def is_enough(self) -> bool:
        """Whether there are enough samples for an estimate."""
        return self.num_independent >= INDEPENDENT_MIN


@dataclass(frozen=True, slots=True)
class NoiseKey:
    """A key of the mission file: its value with a 95 % interval, and the data behind it.

    ``value`` is None if there is too little data; ``note`` then says of what.
    """

    name: str
    value: float | None
    low: float
    high: float
    note: str


@dataclass(frozen=True, slots=True)
class Identified:
    """What recordings say of an aircraft: the measurements, and the keys that explain them.

    ``energy`` has the keys of that section, if the recordings have battery messages.
    """

    tracked_s: float
    num_left_out: int
    spreads: tuple[Spread, ...]
    keys: tuple[NoiseKey, ...]
    energy: tuple[NoiseKey, ...] = ()

    @property
    def has_any(self) -> bool:
        """Whether there is enough data for any key."""
        return any(key.value is not None for key in (*self.keys, *self.energy))

    @property
    def known(self) -> dict[str, float]:
        """Keys with enough data."""
        return {key.name: key.value for key in self.keys if key.value is not None}


def identified(flights: Sequence[Flown], vehicle: VehicleModel) -> Identified:
    """Identify the noise of an aircraft from its flights.

    Parameters
    ----------
    flights : sequence of Flown
        The samples of their recordings.
    vehicle : VehicleModel
        The aircraft; its own noise is used where nothing is reported.
    """
    runs = [run for flight in flights for run in flight.deviations]
    tracked_s = float(sum(run.times_s[-1] - run.times_s[0] for run in runs))
    spreads = tuple(_spread_of(runs, column) for column in range(len(FIGURES)))
    sensors = _sensor_keys([flight.reported_errors for flight in flights], vehicle)
    known = {key.name: key.value for key in sensors if key.value is not None}
    seen = replace(
        vehicle,
        position_std_m=known.get("position_std_m", vehicle.position_std_m),
        altitude_std_m=known.get("altitude_std_m", vehicle.altitude_std_m),
        course_std_rad=math.radians(known.get("course_std_deg", math.degrees(vehicle.course_std_rad))),
        climb_std_rad=math.radians(known.get("climb_std_deg", math.degrees(vehicle.climb_std_rad))),
    )
    motion = [
        _motion_key(name, spreads[column], tracked_s, seen, which)
        for name, column, which in (
            ("acceleration_std_m_s2", SPEED, 0),
            ("course_rate_std_rad_s", ACROSS, 1),
            ("climb_rate_std_rad_s", ABOVE, 2),
        )
    ]
    left_out = sum(flight.num_left_out for flight in flights)
    return Identified(tracked_s, left_out, spreads, (*motion, *sensors))


def _spread_of(runs: Sequence[Deviations], column: int) -> Spread:
    """Spread of one column of all runs' deviations."""
    parts = [run.values[:, column] for run in runs]
    steps = [np.diff(run.times_s) for run in runs]
    if FIGURE_UNITS[column] == "°":
        parts = [np.degrees(part) for part in parts]
    whole = np.concatenate(parts) if parts else np.empty(0)
    whole = whole[np.isfinite(whole)]
    name, unit = FIGURES[column], FIGURE_UNITS[column]
    if len(whole) < 2:
        return Spread(name, unit, math.nan, math.nan, math.nan, math.nan, len(whole), 0.0)
    mean = float(whole.mean())
    about = 0.0 if unit == "m" else mean
    std = math.sqrt(float(((whole - about) ** 2).mean()))
    step_s = float(np.median(np.concatenate(steps)))
    centred = [part[np.isfinite(part)] - mean for part in parts]
    num_independent = independent_samples(centred, max(1, round(LAG_MAX_S / max(step_s, 1e-3))))
    low, high = interval_of(std, num_independent)
    return Spread(name, unit, mean, std, low, high, len(whole), num_independent)


def independent_samples(parts: Sequence[FloatArray], lag_max: int) -> float:
    """Effective number of independent samples: the number of all over the sum of their autocorrelations.

    Summed up to the first lag at which the autocorrelation is no longer positive.

    Parameters
    ----------
    parts : sequence of ndarray, shape (N_i,)
        Series with a common mean taken off.
    lag_max : int
        Largest lag at which correlation is looked for, in samples.
    """
    num = sum(len(part) for part in parts)
    power = sum(float(part @ part) for part in parts)
    if power <= 0.0:
        return float(num)
    total = 1.0
    for lag in range(1, lag_max + 1):
        both = [part for part in parts if len(part) > lag]
        pairs = sum(len(part) - lag for part in both)
        if pairs == 0:
            break
        correlation = sum(float(part[lag:] @ part[:-lag]) for part in both) / pairs / (power / num)
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return max(1.0, num / total)


def interval_of(std: float, num_independent: float) -> tuple[float, float]:
    """95 % interval of a standard deviation from a number of independent samples."""

    def quantile(normal: float) -> float:
        share = 2.0 / (9.0 * num_independent)
        return num_independent * max(1.0 - share + normal * math.sqrt(share), 1e-3) ** 3

    return (
        std * math.sqrt(num_independent / quantile(NORMAL_95)),
        std * math.sqrt(num_independent / quantile(-NORMAL_95)),
    )


def stationary_spreads(
    vehicle: VehicleModel, process: FloatArray | None = None
) -> tuple[float, float, float]:
    """Stationary deviations of LQG-MP, straight on at cruise: airspeed [m/s], across and above the path [m].

    For the position they are those of the estimate that an autopilot reports; for the speed those of the true
    speed.

    Parameters
    ----------
    vehicle : VehicleModel
        The aircraft with its noise.
    process : ndarray, shape (3,), optional
        Variances of acceleration, turn and climb rate in place of the aircraft's.
    """
    tables = tables_once(vehicle, TAU_S, 3)
    if process is not None:
        tables = tables._replace(process=process)
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, vehicle.airspeed_cruise_m_s])
    error, estimate = np.zeros((6, 6)), np.zeros((6, 6))
    work = filter_scratch()
    for _ in range(STEPS_MAX):
        error_next, estimate_next = np.empty((6, 6)), np.empty((6, 6))
        propagate(state, STRAIGHT_ON, TAU_S, tables, error, estimate, error_next, estimate_next, work)
        moved = np.abs(np.diag(error_next + estimate_next) - np.diag(error + estimate))
        error, estimate = error_next, estimate_next
        if (moved <= SETTLED * np.diag(error + estimate)).all():
            break
    return math.sqrt(error[5, 5] + estimate[5, 5]), math.sqrt(estimate[1, 1]), math.sqrt(estimate[2, 2])


def _motion_key(name: str, spread: Spread, tracked_s: float, vehicle: VehicleModel, which: int) -> NoiseKey:
    """Return the process noise at which LQG-MP has a spread that was measured."""
    if tracked_s < TRACKED_MIN_S or not spread.is_enough:
        note = (
            f"too little: {tracked_s:.0f} s along plans, {spread.num_independent:.0f} independent samples; "
            f"{TRACKED_MIN_S:.0f} s and {INDEPENDENT_MIN:.0f} are needed"
        )
        return NoiseKey(name, None, math.nan, math.nan, note)

    def spread_at(value: float) -> float:
        process = np.zeros(3)
        process[which] = value**2
        return stationary_spreads(vehicle, process)[which]

    value, low, high = (
        _sought(spread_at, goal, LARGEST[name]) for goal in (spread.std, spread.low, spread.high)
    )
    note = f"{spread.name} {spread.std:.2g} {spread.unit}, {spread.num_independent:.0f} independent samples"
    if value == 0.0:
        note += "; the sensors' noise alone explains it"
    elif value == LARGEST[name]:
        note += "; the largest there is does not explain it"
    return NoiseKey(name, value, low, high, note)


def _sought(function: Callable[[float], float], goal: float, largest: float) -> float:
    """Return the argument at which an increasing function has a value, between 0 and the largest argument."""
    if function(0.0) >= goal:
        return 0.0
    if function(largest) <= goal:
        return largest
    low, high = 0.0, largest
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) < goal else (low, middle)
    return 0.5 * (low + high)


def _sensor_keys(reported: Sequence[ReportedErrors], vehicle: VehicleModel) -> list[NoiseKey]:
    """Return the accuracy of position and velocity: the larger of the reported and the observed error."""
    accuracies = np.concatenate([entry.accuracies for entry in reported])
    innovations = np.concatenate([entry.innovations for entry in reported])
    jerks = np.concatenate([entry.jerks for entry in reported])
    speed = vehicle.airspeed_cruise_m_s
    # A fix's innovation has two fixes' noise; a second difference of noise σ has the variance 6·σ².
    level, upright = innovations[:, :2].ravel() / math.sqrt(2.0), innovations[:, 2] / math.sqrt(2.0)
    across, upwards = jerks[:, :2].ravel() / math.sqrt(6.0), jerks[:, 2] / math.sqrt(6.0)
    place = _sensor_key("position_std_m", accuracies[:, 0], level, 1.0)
    return [
        place,
        _sensor_key("altitude_std_m", accuracies[:, 1], upright, 1.0),
        _sensor_key("course_std_deg", accuracies[:, 2], across, math.degrees(1.0 / speed)),
        _sensor_key("climb_std_deg", accuracies[:, 2], upwards, math.degrees(1.0 / speed)),
        replace(place, name="initial_position_std_m"),
    ]


def _sensor_key(name: str, reported: FloatArray, seen: FloatArray, scale: float) -> NoiseKey:
    """Return the larger of the reported accuracy (its median) and the observed noise.

    Parameters
    ----------
    name : str
        The key.
    reported : ndarray, shape (M,)
        Reported accuracies, NaN where there is none.
    seen : ndarray, shape (K,)
        Observed errors.
    scale : float
        Factor from their unit to the key's.
    """
    reported = reported[np.isfinite(reported)]
    median = float(np.median(reported)) if len(reported) >= REPORTED_MIN else math.nan
    spread = _without_outliers(seen)
    noise = math.sqrt(float((spread**2).mean())) if len(spread) >= REPORTED_MIN else math.nan
    values = [value for value in (median, noise) if math.isfinite(value) and value > 0.0]
    if not values:
        count = f"{len(reported)} accuracies reported, {len(spread)} differences"
        note = f"too little: {count}; {REPORTED_MIN} are needed"
        return NoiseKey(name, None, math.nan, math.nan, note)
    words = []
    if math.isfinite(median):
        words.append(f"reported {scale * median:.2g}, {len(reported)} times")
    if math.isfinite(noise):
        words.append(f"seen {scale * noise:.2g} in {len(spread)} differences")
    note = "; ".join(words)
    if noise == max(values):
        low, high = interval_of(noise, len(spread) / 2.0)  # Neighbouring differences share a sample.
    else:
        low, high = float(np.percentile(reported, 2.5)), float(np.percentile(reported, 97.5))
    return NoiseKey(name, scale * max(values), scale * low, scale * high, note)


def _without_outliers(values: FloatArray) -> FloatArray:
    """Errors without outliers: positions that jumped.

    Parameters
    ----------
    values : ndarray, shape (K,)
        Errors.

    Returns
    -------
    ndarray, shape (≤ K,)
        The others.
    """
    if not len(values):
        return values
    away = np.abs(values - np.median(values))
    return values[away <= OUTLIER * max(1.4826 * float(np.median(away)), 1e-9)]
