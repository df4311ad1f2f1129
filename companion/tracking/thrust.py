"""Detection of lost thrust from throttle, height, airspeed and the engine's reported speed.

An engine adds energy. Two observations of the specific energy ``h + v²/2g`` show that it does not: the
energy falls although the throttle is open, or its rate is much lower than a few seconds ago although the
throttle is no lower than then. More throttle raises the rate, more airspeed lowers it. How much one share of
throttle adds shows in flight: it makes up for the sink of a glide, and for what is climbed. An engine that
reports its speed is seen to stand still.

References
----------
J. D. Anderson, *Aircraft Performance and Design*, 1999, eq. (6.30): specific energy (energy height), and its
rate, the specific excess power; chapter 5: the power that drag takes.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from companion.tracking.ownship import GRAVITY_M_S2
from companion.types.events import AirData, EngineSpeed, Event, GlobalPosition

WINDOW_S = 2.0  # A rate is observed for this time: a gust of 1 m/s changes it by about 1 m/s.
SAMPLES_MIN = 4  # Fewer samples in a window say nothing.
SPAN_SHARE = 0.7  # So do samples that span a smaller share of the window.
OPEN_SHARE = 0.85  # A throttle above this share of its largest value counts as open.
LOSS_M_S = 1.0  # Energy that falls faster than this is lost.
REFERENCE_S = (4.0, 14.0)  # The rate is compared with the rates of this age.
# A rate that is lower than those by more than this has dropped. Without thrust a small aircraft loses 1.5 to
# 3 m/s; a steep turn costs about 1 m/s.
DROP_M_S = 2.0
# In gusts it must be lower by this many of their standard deviations. They show in the differences between
# windows that follow each other: a climb, a turn or a descent changes one of these, a gust changes all.
DROP_DEVIATIONS = 4.0
GUSTS_S = 60.0  # Gusts are observed for this time.
# More throttle adds energy: from idle to full at least this rate. A small aircraft climbs at 3 m/s or more at
# full throttle, and flies level at half of it.
FULL_THROTTLE_M_S = 4.0
# More throttle is expected to add this share of what throttle has added in the flight before.
GAIN_SHARE = 0.7
GAIN_THROTTLE_MIN = 0.08  # Rates at lower throttle do not show what throttle adds.
GAIN_RATES_MIN = 20  # Fewer rates do not show it, either.
# At its usual airspeed an aircraft's lift is at least this multiple of its drag. The power that drag takes
# rises with the third power of airspeed at most (parasite drag alone).
GLIDE_RATIO_MIN = 5.0
# If throttle and airspeed should have raised the rate by this, energy that does not rise is missing.
ADDED_M_S = 1.0
MAD_TO_DEVIATION = 1.4826  # Ratio of the standard deviation to the median absolute deviation (normal).
LASTS_S = 1.0  # A lack of thrust is a fault after this time.
WORKING_SHARE = 0.15  # With less throttle little thrust is expected.
SAME_THROTTLE = 0.03  # A throttle that is lower by less counts as the same.
STILL_S = 1.0  # An engine that reported a speed stands still after this time without any.
STILL_RPM = 100.0  # Slower engines stand still.
# Below this throttle an electric motor may stand still; or below one at which it was seen to turn, if that
# is lower and not idle.
IDLE_SHARE = 0.3
ASKED_S = 1.0  # An engine runs when it was asked for thrust for this time.


class _Sample(NamedTuple):
    """Time [s], specific energy [m], throttle as a share of 1, and airspeed [m/s]."""

    stamp_s: float
    energy: float
    throttle: float
    airspeed_m_s: float


class _Rate(NamedTuple):
    """Rate of the energy [m/s] in a window that ends at a time [s].

    With it the lowest and the mean throttle in the window, the difference to the rate in the window before
    [m/s], and the mean airspeed [m/s].
    """

    stamp_s: float
    energy_m_s: float
    throttle: float
    mean_throttle: float
    change_m_s: float
    airspeed_m_s: float


class _Usual(NamedTuple):
    """Medians of earlier rates: energy [m/s], throttle, airspeed [m/s]; the spread of gusts [m/s].

    The throttle is the mean of each window. Its lowest value, as after a throttle closed for a moment, would
    let a descent with less throttle than before look like one with the same.
    """

    energy_m_s: float
    throttle: float
    airspeed_m_s: float
    deviation_m_s: float


class ThrustMonitor:
    """Observes telemetry; :meth:`fault` says whether thrust is missing, :meth:`gains` whether not."""

    def __init__(self) -> None:
        self._up_m: float | None = None
        self._samples: deque[_Sample] = deque()
        self._rates: deque[_Rate] = deque()
        self._ran = False
        self._turns_share = IDLE_SHARE  # With this throttle the engine turns.
        self._still_since_s: float | None = None
        self._reported_s = -math.inf  # Time of the newest report of the engine's speed.
        self._asked_since_s = math.inf
        self._lost_since_s: float | None = None

    def forget(self) -> None:
        """Begin again, with the next flight."""
        self._samples.clear()
        self._rates.clear()
        self._asked_since_s, self._turns_share = math.inf, IDLE_SHARE
        self._ran, self._still_since_s, self._lost_since_s = False, None, None

    def observe(self, event: Event) -> None:
        """Take an event; others than height, airspeed and engine speed are ignored."""
        if isinstance(event, GlobalPosition):
            self._up_m = event.altitude_amsl_m
        elif isinstance(event, AirData) and self._up_m is not None:
            energy = self._up_m + event.airspeed_m_s**2 / (2.0 * GRAVITY_M_S2)
            self._note_energy(_Sample(event.stamp_s, energy, event.throttle, event.airspeed_m_s))
        elif isinstance(event, EngineSpeed):
            self._note_engine(event)

    def _note_energy(self, sample: _Sample) -> None:
        asks = sample.throttle >= self._turns_share
        self._asked_since_s = min(self._asked_since_s, sample.stamp_s) if asks else math.inf
        self._samples.append(sample)
        while sample.stamp_s - self._samples[0].stamp_s > WINDOW_S:
            self._samples.popleft()
        times, energies, throttles, airspeeds = np.array(self._samples).T
        if len(times) < SAMPLES_MIN or times[-1] - times[0] < SPAN_SHARE * WINDOW_S:
            return
        centred = times - times.mean()
        slope = float((centred * energies).sum() / (centred**2).sum())
        earlier = (rate for rate in reversed(self._rates) if sample.stamp_s - rate.stamp_s >= WINDOW_S)
        before = next(earlier, None)
        change = math.nan if before is None else slope - before.energy_m_s
        throttle, mean_throttle = float(throttles.min()), float(throttles.mean())
        airspeed = float(airspeeds.mean())
        self._rates.append(_Rate(sample.stamp_s, slope, throttle, mean_throttle, change, airspeed))
        while sample.stamp_s - self._rates[0].stamp_s > GUSTS_S:
            self._rates.popleft()

    def _note_engine(self, event: EngineSpeed) -> None:
        self._reported_s = event.stamp_s
        if event.speed_rpm > STILL_RPM:
            self._ran, self._still_since_s = True, None
            throttle = max((sample.throttle for sample in self._samples), default=IDLE_SHARE)
            self._turns_share = min(self._turns_share, max(throttle, WORKING_SHARE))
        elif self._ran and self._still_since_s is None:
            self._still_since_s = event.stamp_s

    def fault(self, now_s: float, throttle_max: float = 1.0, sink_m_s: float | None = None) -> str:
        """Return how the lack of thrust shows, in words; '' if it does not.

        Parameters
        ----------
        now_s : float
            The clock's reading [s].
        throttle_max : float
            Largest throttle that the autopilot may command, as a share of 1.
        sink_m_s : float, optional
            Height that the aircraft loses in a glide [m/s].
        """
        if self._is_still(now_s) and self._reported_s - self._asked_since_s >= ASKED_S:
            return "the engine stands still"
        now = self._rate(now_s)
        loss = ""
        if now is not None and now.energy_m_s <= 0.0:
            loss = self._loss(now, now_s, throttle_max, sink_m_s)
        if not loss:
            self._lost_since_s = None
            return ""
        if self._lost_since_s is None:
            self._lost_since_s = now_s
        return loss if now_s - self._lost_since_s >= LASTS_S else ""

    def _loss(self, now: _Rate, now_s: float, throttle_max: float, sink_m_s: float | None) -> str:
        """Return in words how much energy is lost although the engine should keep it; '' if none is."""
        usual = self._usual(now_s)
        if usual is None:
            return ""
        lost, deviation = f"{abs(now.energy_m_s):.1f} m/s of height are lost", usual.deviation_m_s
        is_open = now.throttle >= OPEN_SHARE * throttle_max
        if is_open and now.energy_m_s <= -max(LOSS_M_S, 2.0 * deviation):
            return f"{lost} with the throttle open"
        if now.throttle < max(usual.throttle - SAME_THROTTLE, WORKING_SHARE):
            return ""
        change_m_s = self._gain_m_s(now_s, sink_m_s) * max(now.throttle - usual.throttle, 0.0)
        change_m_s -= _cost_of_speed_m_s(now.airspeed_m_s, usual.airspeed_m_s)
        loss_min_m_s = LOSS_M_S if change_m_s < ADDED_M_S else 0.0
        expected = usual.energy_m_s + change_m_s
        has_dropped = now.energy_m_s < expected - max(DROP_M_S, DROP_DEVIATIONS * deviation)
        is_lost = has_dropped and now.energy_m_s <= -loss_min_m_s
        return f"{lost} with the throttle as before" if is_lost else ""

    def _gain_m_s(self, now_s: float, sink_m_s: float | None) -> float:
        """Return the rate of energy that full throttle adds at least, by the flight so far [m/s]."""
        if sink_m_s is None:
            return FULL_THROTTLE_M_S
        working = [
            (rate.energy_m_s + sink_m_s) / rate.throttle
            for rate in self._rates
            if now_s - rate.stamp_s >= REFERENCE_S[0] and rate.throttle >= GAIN_THROTTLE_MIN
        ]
        if len(working) < GAIN_RATES_MIN:
            return FULL_THROTTLE_M_S
        return max(FULL_THROTTLE_M_S, GAIN_SHARE * float(np.median(working)))

    def _usual(self, now_s: float) -> _Usual | None:
        """Return the medians of earlier rates; None early in a flight."""
        young, old = REFERENCE_S
        earlier = [rate for rate in self._rates if now_s - rate.stamp_s >= young]
        recent = [rate for rate in earlier if now_s - rate.stamp_s <= old]
        changes = [abs(rate.change_m_s) for rate in earlier if math.isfinite(rate.change_m_s)]
        if not recent or not changes:
            return None
        energy, throttle, airspeed = np.median(
            [(rate.energy_m_s, rate.mean_throttle, rate.airspeed_m_s) for rate in recent], axis=0
        )
        deviation = MAD_TO_DEVIATION * float(np.median(changes)) / math.sqrt(2.0)
        return _Usual(energy, throttle, airspeed, deviation)

    def gains(self, now_s: float) -> bool:
        """Return whether the aircraft gains energy with a throttle that gives thrust, or its engine runs.

        With the throttle closed, air that rises may give as much.
        """
        now = self._rate(now_s)
        if now is None or now.throttle < WORKING_SHARE:
            return False
        return now.energy_m_s > 0.0 and not self._is_still(now_s)

    def _is_still(self, now_s: float) -> bool:
        """Return whether an engine that ran stands still."""
        return self._still_since_s is not None and now_s - self._still_since_s >= STILL_S

    def _rate(self, now_s: float) -> _Rate | None:
        """Return the present rate; None without fresh samples."""
        last = self._rates[-1] if self._rates else None
        return last if last is not None and now_s - last.stamp_s <= WINDOW_S else None


def _cost_of_speed_m_s(airspeed_m_s: float, usual_m_s: float) -> float:
    """Return how much more energy drag may take than at the usual airspeed [m/s]; 0 if no faster."""
    ratio = max(airspeed_m_s / max(usual_m_s, 1.0), 1.0)
    return usual_m_s / GLIDE_RATIO_MIN * (ratio**3 - 1.0)
