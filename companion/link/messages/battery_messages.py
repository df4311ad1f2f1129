"""Decoding of BATTERY_STATUS and SYS_STATUS: what the autopilot's battery monitor measures.

Only the first battery counts (id 0), and only if it drives the aircraft. ArduPilot reports the level of a
fuel tank in the same message; its remaining share is used like a battery's. FUEL_STATUS is not read.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from companion.types.events import BatteryReported

JOULES_PER_WH = 3_600.0
VOLTAGE_MAX_V = 1_000.0
ENERGY_MAX_WH = 1_000_000.0

_NO_VOLTAGE = 0xFFFF
_DRIVING = (0, 1, 2)  # MAV_BATTERY_FUNCTION: unknown, all, propulsion; not avionics or payload.
_HECTOJOULE_WH = 100.0 / JOULES_PER_WH


class BatteryMeter:
    """Decodes the messages of the battery monitor.

    The energy consumed is taken where it is sent, as ArduPilot does. PX4 sends the charge alone: its
    increments are multiplied by the voltage at which they arrive.
    """

    def __init__(self) -> None:
        self._charge_mah = 0.0
        self._energy_wh = 0.0

    def reports(self, message: Any, stamp_s: float) -> Iterator[BatteryReported]:  # noqa: ANN401
        """Decode a BATTERY_STATUS or SYS_STATUS; nothing for another battery, or where nothing is known.

        Raises
        ------
        ValueError
            For impossible values.
        """
        share = _share(message.battery_remaining)
        if message.get_type() == "SYS_STATUS":
            consumed_wh, voltage_v = None, _voltage((message.voltage_battery,))
        elif message.id == 0 and message.battery_function in _DRIVING:
            cells = (*message.voltages, *(cell for cell in message.voltages_ext if cell))
            voltage_v = _voltage(cells)
            consumed_wh = self._consumed_wh(message.energy_consumed, message.current_consumed, voltage_v)
        else:
            return
        if share is not None or consumed_wh is not None or voltage_v is not None:
            yield BatteryReported(stamp_s, share, consumed_wh, voltage_v)

    def _consumed_wh(self, hectojoules: int, charge_mah: int, voltage_v: float | None) -> float | None:
        """Return the energy consumed; None if neither is known: -1, or what PX4 adds up without a sensor."""
        if hectojoules >= 0:
            return _possible(hectojoules * _HECTOJOULE_WH)
        if charge_mah < 0 or voltage_v is None:
            return None
        if charge_mah < self._charge_mah:  # The monitor has begun anew.
            self._charge_mah = self._energy_wh = 0.0
        self._energy_wh += (charge_mah - self._charge_mah) * 1e-3 * voltage_v
        self._charge_mah = charge_mah
        return _possible(self._energy_wh)


def _possible(energy_wh: float) -> float:
    if energy_wh > ENERGY_MAX_WH:
        raise ValueError("consumed")
    return energy_wh


def _share(percent: int) -> float | None:
    """Return the remaining share; None if it is not known, which is -1."""
    if not -1 <= percent <= 100:
        raise ValueError("remaining")
    return None if percent < 0 else percent / 100.0


def _voltage(cells_mv: tuple[int, ...]) -> float | None:
    """Return the sum of the cells [V]; a pack that is measured as a whole is one cell. None without any."""
    known = [cell for cell in cells_mv if 0 < cell < _NO_VOLTAGE]
    total = 1e-3 * math.fsum(known)
    if total > VOLTAGE_MAX_V:
        raise ValueError("voltage")
    return total if known else None
