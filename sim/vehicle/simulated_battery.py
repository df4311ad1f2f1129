"""A battery that the thrust drains."""

from __future__ import annotations

import math

# Motor, controller and propeller of a small aircraft together; a propeller alone has about 0.7 (Beard and
# McLain, "Small Unmanned Aircraft", 4.3).
EFFICIENCY = 0.6
# Autopilot, companion computer, radio and servos. No model of level flight has a constant term, so that this
# is an error that the identification of a real aircraft has, too.
AVIONICS_W = 8.0
# Six lithium cells: open-circuit voltage of a full and an empty one, and the pack's resistance.
CELLS = 6
FULL_V, EMPTY_V, NOMINAL_V = 4.2, 3.3, 3.7
RESISTANCE_OHM = 0.03


class SimulatedBattery:
    """Energy, charge and voltage of a pack.

    Parameters
    ----------
    capacity_wh : float
        Energy of the full battery, with which it begins [Wh].
    drain : float
        Factor by which it is drained faster than by the thrust and the avionics.

    Attributes
    ----------
    used_wh, used_mah : float
        Energy and charge that it has supplied.
    current_a : float
        Present current [A].
    """

    def __init__(self, capacity_wh: float, drain: float = 1.0) -> None:
        self._drain = drain
        self.capacity_wh = capacity_wh
        self.used_wh = self.used_mah = self.current_a = 0.0

    def drain(self, thrust_power_w: float, seconds: float) -> None:
        """Supply the power of the thrust [W] for a time [s]."""
        power_w, open_v = self._drain * (max(thrust_power_w, 0.0) / EFFICIENCY + AVIONICS_W), self._open_v
        # The current of a power behind a resistance: P = (U - R·I)·I.
        root = math.sqrt(max(open_v**2 - 4.0 * RESISTANCE_OHM * power_w, 0.0))
        self.current_a = (open_v - root) / (2.0 * RESISTANCE_OHM)
        self.used_wh += power_w * seconds / 3_600.0
        self.used_mah += self.current_a * seconds / 3.6

    @property
    def remaining(self) -> float:
        """Remaining share in [0, 1]."""
        return max(0.0, 1.0 - self.used_wh / self.capacity_wh)

    @property
    def voltage_v(self) -> float:
        """Voltage under the present load [V]."""
        return self._open_v - RESISTANCE_OHM * self.current_a

    @property
    def _open_v(self) -> float:
        return CELLS * (EMPTY_V + (FULL_V - EMPTY_V) * self.remaining)

    @staticmethod
    def charge_mah(energy_wh: float) -> float:
        """Return the charge of an energy at the nominal voltage [mAh]."""
        return 1e3 * energy_wh / (CELLS * NOMINAL_V)
