"""Which of the mission file's moving threats a tracked vehicle is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.types.threat import DynamicThreat

REMEMBERED_MAX = 1_000  # identities; more are forgotten, the oldest first


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """What a tracked vehicle can do, as far as the mission file tells.

    Parameters
    ----------
    number : int or None
        Place in the mission file's list; None for a vehicle it does not name.
    speed_m_s : float
        Highest ground speed [m/s].
    max_threat_radius_m : float
        Distance within which it may harm the aircraft [m].
    turn_radius_m : float
        Tightest turn it can make [m].
    """

    number: int | None
    speed_m_s: float
    max_threat_radius_m: float
    turn_radius_m: float

    @property
    def stands(self) -> bool:
        """Whether the mission file says that it does not move."""
        return self.number is not None and self.speed_m_s == 0.0


@dataclass(frozen=True, slots=True)
class VehicleClassSettings:
    """What is taken for vehicles that the mission file does not name.

    Parameters
    ----------
    ground, air : VehicleClass
        What is assumed of a ground vehicle, and of an aircraft, that the mission file does not name.
    air_match_distance_m : float
        The mission file names ground vehicles; a detection that says it is airborne, or does not say
        what it is, counts as one of them only within this distance of its start [m].
    """

    ground: VehicleClass = VehicleClass(None, speed_m_s=25.0, max_threat_radius_m=250.0, turn_radius_m=15.0)
    air: VehicleClass = VehicleClass(None, speed_m_s=40.0, max_threat_radius_m=250.0, turn_radius_m=50.0)
    air_match_distance_m: float = 300.0

    def __post_init__(self) -> None:
        if self.ground.number is not None or self.air.number is not None:
            raise ValueError("the classes of unknown vehicles have no number")


class ThreatAssigner:
    """Gives each named threat to one identity at a time.

    Parameters
    ----------
    threats : sequence of DynamicThreat
        The threats the mission file names, in its order.
    settings : VehicleClassSettings
        What is assumed of vehicles the mission file does not name.
    """

    def __init__(self, threats: Sequence[DynamicThreat], settings: VehicleClassSettings) -> None:
        self._threats = tuple(threats)
        self._settings = settings
        self._holders: dict[int, str] = {}
        self._remembered: dict[str, int] = {}

    def assigned(self, identity: str, east_m: float, north_m: float, *, is_airborne: bool) -> VehicleClass:
        """Assign the free threat that starts nearest, and return its class.

        An identity that held a threat before gets the same again while nobody else holds it: where a
        vehicle reappears says less than what it was.
        """
        reach = self._settings.air_match_distance_m if is_airborne else math.inf
        former = self._remembered.get(identity)
        if former is not None and former not in self._holders:
            number: int | None = former
        else:
            number = self._nearest_free(east_m, north_m, reach)
        if number is None:
            return self._settings.air if is_airborne else self._settings.ground
        self._holders[number] = identity
        self._remembered.pop(identity, None)
        self._remembered[identity] = number
        if len(self._remembered) > REMEMBERED_MAX:
            del self._remembered[next(iter(self._remembered))]
        threat = self._threats[number]
        return VehicleClass(number, threat.speed_m_s, threat.max_threat_radius_m, threat.turn_radius_m)

    def release(self, vehicle_class: VehicleClass) -> None:
        """Make a dropped track's threat free again."""
        if vehicle_class.number is not None:
            self._holders.pop(vehicle_class.number, None)

    def _nearest_free(self, east_m: float, north_m: float, reach_m: float) -> int | None:
        distances = (
            (math.hypot(threat.position_enu_m[0] - east_m, threat.position_enu_m[1] - north_m), number)
            for number, threat in enumerate(self._threats)
            if number not in self._holders
        )
        distance, number = min(distances, default=(math.inf, -1))
        return number if number >= 0 and distance <= reach_m else None
