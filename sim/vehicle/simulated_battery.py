"""A battery that the thrust drains."""

from __future__ import annotations

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
    """

    def __init__(self, capacity_wh: float, drain: float = 1.0) -> None:
        self._drain = drain
        self._power_w = 0.0
        self.capacity_wh = capacity_wh
        self.used_wh = 0.0

    def drain(self, thrust_power_w: float, seconds: float) -> None:
        """Supply the power of the thrust [W] for a time [s]."""
        self._power_w = self._drain * (max(thrust_power_w, 0.0) / EFFICIENCY + AVIONICS_W)
        self.used_wh += self._power_w * seconds / 3_600.0

    @property
    def remaining(self) -> float:
        """Remaining share in [0, 1]."""
        return max(0.0, 1.0 - self.used_wh / self.capacity_wh)

    @property
    def current_a(self) -> float:
        """Current [A]."""
        return self._power_w / (CELLS * NOMINAL_V)

    @property
    def voltage_v(self) -> float:
        """Voltage under the present load [V]."""
        open_v = CELLS * (EMPTY_V + (FULL_V - EMPTY_V) * self.remaining)
        return max(open_v - RESISTANCE_OHM * self.current_a, 0.0)

    @property
    def used_mah(self) -> float:
        """Charge that was used, at the nominal voltage [mAh]."""
        return self.charge_mah(self.used_wh)

    @staticmethod
    def charge_mah(energy_wh: float) -> float:
        """Return the charge of an energy at the nominal voltage [mAh]."""
        return 1e3 * energy_wh / (CELLS * NOMINAL_V)
