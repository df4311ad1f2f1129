"""Windows of flight from a recording: the energy used in each, and the terms of the model of power."""

from __future__ import annotations

import math
from dataclasses import dataclass

from companion.types.events import AirData, Attitude, BatteryReported, Event, GlobalPosition, Heartbeat
from companion.world.vehicle.energy import BANK_MAX_RAD
from companion.world.vehicle.vehicle_model import GRAVITY_M_S2

# In a shorter window the resolution of the messages counts for more: 0.1 kJ, 1 mAh, and a metre of height.
WINDOW_S = 10.0
GAP_MAX_S = 1.0  # Longest time between two messages of a kind within a window.
FLYING_MIN_M_S = 8.0  # Slower, the aircraft stands, rolls or is launched.


@dataclass(frozen=True, slots=True)
class EnergyWindow:
    """The energy used in a window of flight, and the three integrals that explain it.

    Parameters
    ----------
    energy_j : float
        Energy used by the battery's monitor [J].
    cubes : float
        Integral of v³ over time [m³/s²].
    loads : float
        Integral of n²/v over time, with the load factor n [s²/m].
    climb_m : float
        Change of the height plus v²/2g [m].
    seconds : float
        Duration [s].
    """

    energy_j: float
    cubes: float
    loads: float
    climb_m: float
    seconds: float


class EnergyListener:
    """Collects the windows of a recording from its events, in their order.

    A window begins and ends with a report of the battery, in flight and armed, whatever the mode. One in
    which a message is missing is dropped.

    Attributes
    ----------
    windows : list of EnergyWindow
        The windows so far.
    """

    def __init__(self) -> None:
        self.windows: list[EnergyWindow] = []
        self._is_armed = False
        self._air: AirData | None = None
        self._attitude: Attitude | None = None
        self._position: GlobalPosition | None = None
        self._stamp_s = math.nan
        self._cubes = self._loads = 0.0
        self._begin: tuple[float, float, float] | None = None  # Time [s], energy [J], height [m].

    def note(self, event: Event) -> None:
        """Take an event."""
        match event:
            case Heartbeat():
                self._is_armed = event.is_armed
            case AirData():
                self._advance(event.stamp_s)
                self._air = event
            case Attitude():
                self._advance(event.stamp_s)
                self._attitude = event
            case GlobalPosition():
                self._position = event
            case BatteryReported() if event.consumed_wh is not None:
                self._advance(event.stamp_s)
                self._cut(event.stamp_s, 3_600.0 * event.consumed_wh)

    def _advance(self, now_s: float) -> None:
        """Integrate up to a time with the airspeed and bank that were reported last."""
        step_s, self._stamp_s = now_s - self._stamp_s, now_s
        if not self._is_complete(now_s) or not 0.0 <= step_s <= GAP_MAX_S:
            self._begin = None
            return
        assert self._air is not None
        assert self._attitude is not None
        airspeed, bank = self._air.airspeed_m_s, min(abs(self._attitude.bank_rad), BANK_MAX_RAD)
        self._cubes += step_s * airspeed**3
        self._loads += step_s / math.cos(bank) ** 2 / airspeed

    def _is_complete(self, now_s: float) -> bool:
        kept = (self._air, self._attitude, self._position)
        is_fresh = all(event is not None and now_s - event.stamp_s <= GAP_MAX_S for event in kept)
        return (
            is_fresh and self._is_armed and self._air is not None and self._air.airspeed_m_s >= FLYING_MIN_M_S
        )

    def _cut(self, now_s: float, used_j: float) -> None:
        """End the window if it is long enough, and begin the next."""
        if not self._is_complete(now_s):
            return
        assert self._air is not None
        assert self._position is not None
        height = self._position.altitude_amsl_m + self._air.airspeed_m_s**2 / (2.0 * GRAVITY_M_S2)
        if self._begin is not None:
            begin_s, begin_j, begin_m = self._begin
            if used_j >= begin_j and now_s - begin_s < WINDOW_S:
                return
            if used_j >= begin_j:
                self.windows.append(
                    EnergyWindow(
                        used_j - begin_j, self._cubes, self._loads, height - begin_m, now_s - begin_s
                    )
                )
        self._begin, self._cubes, self._loads = (now_s, used_j, height), 0.0, 0.0
