"""Assigns tracked vehicles to the moving threats of the mission file.

The assignment depends on what a vehicle is and where it is seen, not on the order of sightings, so that
nobody can take a threat away from another vehicle. If several vehicles match, each of them is assigned, which
is the cautious choice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.types.threat import DynamicThreat

WELL_CLEAR_M = 610.0
COOPERATIVE = frozenset({"icao", "callsign", "rid", "utm"})  # Identities that an aircraft reports of itself.
REMEMBERED_MAX = 1_000  # Of more identities the oldest are forgotten.


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """Capabilities of a tracked vehicle, as far as the mission file gives them.

    Parameters
    ----------
    number : int or None
        Index in the mission file's list; None for a vehicle that is not assigned.
    speed_m_s : float
        Highest ground speed [m/s].
    max_threat_radius_m : float
        Distance within which it threatens the aircraft [m].
    turn_radius_m : float
        Radius of its tightest turn [m].
    flies_on : bool
        True for an aircraft that reports its own position and velocity, and therefore is no pursuer.
    """

    number: int | None
    speed_m_s: float
    max_threat_radius_m: float
    turn_radius_m: float
    flies_on: bool = False

    def max_with(self, other: VehicleClass) -> VehicleClass:
        """Return an unassigned class with the larger capabilities of both."""
        return VehicleClass(
            None,
            max(self.speed_m_s, other.speed_m_s),
            max(self.max_threat_radius_m, other.max_threat_radius_m),
            min(self.turn_radius_m, other.turn_radius_m),
        )

    @property
    def is_stationary(self) -> bool:
        """Whether the mission file says that this threat does not move."""
        return self.number is not None and self.speed_m_s == 0.0


@dataclass(frozen=True, slots=True)
class VehicleClassSettings:
    """Assumptions about vehicles that the mission file does not name.

    Parameters
    ----------
    ground, air, cooperative : VehicleClass
        Classes of an unnamed ground vehicle, of an unnamed aircraft that others report, and of one that
        reports itself. The radius of the last is the well clear distance of ASTM F3442, 2000 ft.
    match_distance_m : float
        A vehicle within this distance of a threat's start is assigned to it [m].
    """

    ground: VehicleClass = VehicleClass(None, speed_m_s=25.0, max_threat_radius_m=250.0, turn_radius_m=15.0)
    air: VehicleClass = VehicleClass(None, speed_m_s=40.0, max_threat_radius_m=250.0, turn_radius_m=50.0)
    cooperative: VehicleClass = VehicleClass(None, 130.0, WELL_CLEAR_M, 500.0, flies_on=True)
    match_distance_m: float = 300.0

    def __post_init__(self) -> None:
        if any(kind.number is not None for kind in (self.ground, self.air, self.cooperative)):
            raise ValueError("the classes of unknown vehicles have no number")


class ThreatAssigner:
    """Determines the class of a vehicle.

    Parameters
    ----------
    threats : sequence of DynamicThreat
        Threats of the mission file, in its order.
    settings : VehicleClassSettings
        Assumptions about vehicles that the mission file does not name.
    """

    def __init__(self, threats: Sequence[DynamicThreat], settings: VehicleClassSettings) -> None:
        self._threats = tuple(threats)
        self._settings = settings
        self._remembered: dict[str, int] = {}
        self._standing: dict[int, str] = {}

    def kind_of(
        self, identity: str, east_m: float, north_m: float, *, is_airborne: bool, system_id: int | None = None
    ) -> VehicleClass:
        """Return the class of a vehicle at a sighting.

        A vehicle whose identity is in the mission file is that threat wherever it is, and no other vehicle
        is. Otherwise the nearest threat of matching kind and sender is considered. Near its start the vehicle
        has the class of the file; farther away it has at least the class of an unknown vehicle. A threat that
        does not move is assigned only near its position, and to one vehicle only; a second vehicle there is
        assumed to move. An identity that was tracked before keeps its assignment, since the position of a
        reappearance says less.

        Parameters
        ----------
        identity : str
            Identity as reported, for instance ``icao:00ABCD``.
        east_m, north_m : float
            Position of the sighting [m].
        is_airborne : bool
            True if the vehicle reports that it flies, or does not report its kind.
        system_id : int, optional
            System id of the sender.
        """
        unknown = self._settings.ground
        if is_airborne:
            is_reported = identity.partition(":")[0] in COOPERATIVE
            unknown = self._settings.cooperative if is_reported else self._settings.air
        number, is_meant = self._matched(identity, east_m, north_m, system_id)
        if number < 0:
            return unknown
        kind = self._class_of(number)
        if is_meant:
            is_second = kind.is_stationary and self._standing.get(number, identity) != identity
            return kind.max_with(unknown) if is_second else kind
        return unknown if is_airborne or kind.is_stationary else kind.max_with(unknown)

    def assigned(
        self, identity: str, east_m: float, north_m: float, *, is_airborne: bool, system_id: int | None = None
    ) -> VehicleClass:
        """Return the class of a vehicle that is tracked from now on, and remember its assignment."""
        kind = self.kind_of(identity, east_m, north_m, is_airborne=is_airborne, system_id=system_id)
        number, is_meant = self._matched(identity, east_m, north_m, system_id)
        if is_meant:
            self._remembered.pop(identity, None)
            self._remembered[identity] = number
            if len(self._remembered) > REMEMBERED_MAX:
                del self._remembered[next(iter(self._remembered))]
        if kind.is_stationary:
            self._standing.setdefault(number, identity)
        return kind

    def _matched(
        self, identity: str, east_m: float, north_m: float, system_id: int | None
    ) -> tuple[int, bool]:
        """Return the number of the threat that a vehicle may be, -1 for none, and whether it is assigned."""
        by_name = next((n for n, threat in enumerate(self._threats) if threat.identity == identity), None)
        number = self._remembered.get(identity, by_name)
        if number is not None:
            return number, True
        distance, number = self._nearest(east_m, north_m, system_id)
        return number, distance <= self._settings.match_distance_m

    def _nearest(self, east_m: float, north_m: float, system_id: int | None) -> tuple[float, int]:
        """Return distance [m] and number of the nearest threat among those that the sender may report."""
        distances = (
            (math.hypot(threat.position_enu_m[0] - east_m, threat.position_enu_m[1] - north_m), number)
            for number, threat in enumerate(self._threats)
            if not threat.identity and threat.system_id in (None, system_id)
        )
        return min(distances, default=(math.inf, -1))

    def release(self, identity: str) -> None:
        """End the tracking of a vehicle; the next one at its position may be that threat."""
        self._standing = {number: holder for number, holder in self._standing.items() if holder != identity}

    def _class_of(self, number: int) -> VehicleClass:
        threat = self._threats[number]
        return VehicleClass(number, threat.speed_m_s, threat.max_threat_radius_m, threat.turn_radius_m)
