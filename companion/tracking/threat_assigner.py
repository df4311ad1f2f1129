"""Which of the mission file's moving threats a tracked vehicle is.

It is told by what a vehicle is and where it is seen, never by who is seen first: nobody takes a named
threat away from another. Where several fit, each is taken for it, which errs towards caution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from companion.types.threat import DynamicThreat

WELL_CLEAR_M = 610.0
COOPERATIVE = frozenset({"icao", "callsign", "rid", "utm"})  # what aircraft tell of themselves by
REMEMBERED_MAX = 1_000  # identities; more are forgotten, the oldest first


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """What a tracked vehicle can do, as far as the mission file tells.

    Parameters
    ----------
    number : int or None
        Place in the mission file's list; None for a vehicle that is not taken for one it names.
    speed_m_s : float
        Highest ground speed [m/s].
    max_threat_radius_m : float
        Distance within which it may harm the aircraft [m].
    turn_radius_m : float
        Tightest turn it can make [m].
    flies_on : bool
        Whether it is an aircraft that tells where it is and goes, and so hunts nobody.
    """

    number: int | None
    speed_m_s: float
    max_threat_radius_m: float
    turn_radius_m: float
    flies_on: bool = False

    def at_least(self, other: VehicleClass) -> VehicleClass:
        """A vehicle of no name that can do what either can."""
        return VehicleClass(
            None,
            max(self.speed_m_s, other.speed_m_s),
            max(self.max_threat_radius_m, other.max_threat_radius_m),
            min(self.turn_radius_m, other.turn_radius_m),
        )

    @property
    def stands(self) -> bool:
        """Whether the mission file says that it does not move."""
        return self.number is not None and self.speed_m_s == 0.0


@dataclass(frozen=True, slots=True)
class VehicleClassSettings:
    """What is taken for vehicles that the mission file does not name.

    Parameters
    ----------
    ground, air, cooperative : VehicleClass
        What is assumed of a ground vehicle, of an aircraft that others report, and of one that tells of
        itself, that the mission file does not name. From the last the well clear distance of ASTM F3442 is
        kept, 2000 ft.
    match_distance_m : float
        Within this distance of its start a vehicle is taken for the threat that the mission file names [m].
    """

    ground: VehicleClass = VehicleClass(None, speed_m_s=25.0, max_threat_radius_m=250.0, turn_radius_m=15.0)
    air: VehicleClass = VehicleClass(None, speed_m_s=40.0, max_threat_radius_m=250.0, turn_radius_m=50.0)
    cooperative: VehicleClass = VehicleClass(None, 130.0, WELL_CLEAR_M, 500.0, flies_on=True)
    match_distance_m: float = 300.0

    def __post_init__(self) -> None:
        if any(kind.number is not None for kind in (self.ground, self.air, self.cooperative)):
            raise ValueError("the classes of unknown vehicles have no number")


class ThreatAssigner:
    """Tells the kind of a vehicle that is seen.

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
        self._remembered: dict[str, int] = {}
        self._standing: dict[int, str] = {}

    def kind_of(
        self, identity: str, east_m: float, north_m: float, *, is_airborne: bool, system_id: int | None = None
    ) -> VehicleClass:
        """The class of a vehicle that is seen for the first time, or again.

        One that the mission file names by its identity is that threat wherever it is, and nobody else is. Of
        those that fit by kind and sender the nearest is meant: near its start as it stands in the file, and
        farther away with at least what is assumed of a stranger. A threat that does not move is taken for
        one only near its place, and one vehicle only: a second is taken to move. An identity followed before
        stays what it was, since where a vehicle reappears says less.

        Parameters
        ----------
        identity : str
            As reported, for instance ``icao:00ABCD``.
        east_m, north_m : float
            Where it is seen [m].
        is_airborne : bool
            Whether it says that it flies, or does not say what it is.
        system_id : int, optional
            Who reports it.
        """
        unknown = self._settings.ground
        if is_airborne:
            is_reported = identity.partition(":")[0] in COOPERATIVE
            unknown = self._settings.cooperative if is_reported else self._settings.air
        number, is_meant = self._meant(identity, east_m, north_m, system_id)
        if number < 0:
            return unknown
        kind = self._class_of(number)
        if is_meant:
            is_second = kind.stands and self._standing.get(number, identity) != identity
            return kind.at_least(unknown) if is_second else kind
        return unknown if is_airborne or kind.stands else kind.at_least(unknown)

    def assigned(
        self, identity: str, east_m: float, north_m: float, *, is_airborne: bool, system_id: int | None = None
    ) -> VehicleClass:
        """The same of one that is followed from now on, and remembered."""
        kind = self.kind_of(identity, east_m, north_m, is_airborne=is_airborne, system_id=system_id)
        number, is_meant = self._meant(identity, east_m, north_m, system_id)
        if is_meant:
            self._remembered.pop(identity, None)
            self._remembered[identity] = number
            if len(self._remembered) > REMEMBERED_MAX:
                del self._remembered[next(iter(self._remembered))]
        if kind.stands:
            self._standing.setdefault(number, identity)
        return kind

    def _meant(self, identity: str, east_m: float, north_m: float, system_id: int | None) -> tuple[int, bool]:
        """Number of the threat that a vehicle may be, -1 for none, and whether it is taken for that one."""
        by_name = next((n for n, threat in enumerate(self._threats) if threat.identity == identity), None)
        number = self._remembered.get(identity, by_name)
        if number is not None:
            return number, True
        distance, number = self._nearest(east_m, north_m, system_id)
        return number, distance <= self._settings.match_distance_m

    def _nearest(self, east_m: float, north_m: float, system_id: int | None) -> tuple[float, int]:
        """Distance [m] and number of the threat that starts nearest of those that a sender's may be."""
        distances = (
            (math.hypot(threat.position_enu_m[0] - east_m, threat.position_enu_m[1] - north_m), number)
            for number, threat in enumerate(self._threats)
            if not threat.identity and threat.system_id in (None, system_id)
        )
        return min(distances, default=(math.inf, -1))

    def release(self, identity: str) -> None:
        """A vehicle is followed no more; the next at its place may be the one that stands there."""
        self._standing = {number: holder for number, holder in self._standing.items() if holder != identity}

    def _class_of(self, number: int) -> VehicleClass:
        threat = self._threats[number]
        return VehicleClass(number, threat.speed_m_s, threat.max_threat_radius_m, threat.turn_radius_m)
