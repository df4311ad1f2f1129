"""The autopilots' answer to a low battery: one return to launch."""

from __future__ import annotations

from dataclasses import dataclass

from ..vehicle.simulated_battery import SimulatedBattery
from .autopilot_parameters import Parameters

ARDUPLANE_RTL = 1.0  # BATT_FS_LOW_ACT
PX4_RETURN = 3.0  # COM_LOW_BAT_ACT: return at the critical level.


@dataclass(frozen=True, slots=True)
class LowBattery:
    """The answer to a low battery: a text, and whether the aircraft returns."""

    text: str
    returns: bool


class BatteryFailsafe:
    """Watches the battery by the autopilot's own parameters.

    ArduPlane compares what is left of BATT_CAPACITY with BATT_LOW_MAH, PX4 the remaining share with
    BAT_CRIT_THR. ArduPlane's text is that of its source; PX4's was not measured.

    Parameters
    ----------
    battery : SimulatedBattery
        The battery.
    parameters : Parameters
        The autopilot's parameters, with those of :meth:`Parameters.add_battery`.
    """

    def __init__(self, battery: SimulatedBattery, parameters: Parameters) -> None:
        self._battery, self._parameters = battery, parameters
        self._is_px4 = "BAT_CRIT_THR" in parameters.names
        self._is_reported = False

    def check(self) -> LowBattery | None:
        """Return what becomes of the battery at the moment at which it is low; None before and after."""
        if self._is_reported or not self._is_low():
            return None
        self._is_reported = True
        if self._is_px4:
            return LowBattery("Critical battery level", self._parameters["COM_LOW_BAT_ACT"] == PX4_RETURN)
        battery = self._battery
        text = f"Battery 1 is low {battery.voltage_v:.2f}V used {battery.used_mah:.0f} mAh"
        return LowBattery(text, self._parameters["BATT_FS_LOW_ACT"] == ARDUPLANE_RTL)

    def _is_low(self) -> bool:
        battery, parameters = self._battery, self._parameters
        if self._is_px4:
            return battery.remaining < parameters["BAT_CRIT_THR"]
        return parameters["BATT_CAPACITY"] - battery.used_mah < parameters["BATT_LOW_MAH"]
