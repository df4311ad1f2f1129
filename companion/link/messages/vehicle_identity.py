"""Who the vehicle is: its system, the address it speaks from, and whether its heartbeats can all be true.

Without signatures anybody can say anything under any ids. What can be done is done: nobody becomes the
vehicle by being first, nobody takes its place while it speaks, and where two say contradictory things
under its ids, neither is acted on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.link.wire.transport import Address
from companion.types.events import Dialect
from companion.types.mavlink_enums import ComponentId

SETTLED_S = 0.9  # from the first heartbeat of a candidate to one that makes it the vehicle
HEARTBEATS_ALONE = 5  # of a candidate that sends nothing else until it is asked
PEER_SILENT_S = 5.0  # after which the vehicle may speak from another address
DIALECT_SILENT_S = 5.0  # after which it may be another autopilot, on the ground
CHANGES_S = 4.0
ARMED_CHANGES_MAX, MODE_CHANGES_MAX = 1, 2  # within that time; more come from two senders
DISBELIEVED_S = 5.0  # after a contradiction
CANDIDATES_MAX = OTHERS_MAX = 16


@dataclass(slots=True)
class _Candidate:
    first_s: float
    num_heartbeats: int = 0
    num_others: int = 0

    def note(self, *, is_heartbeat: bool) -> None:
        """Count a frame of it."""
        self.num_heartbeats += is_heartbeat
        self.num_others += not is_heartbeat

    def is_settled(self, stamp_s: float) -> bool:
        """Whether it has sent what an autopilot sends, for a while."""
        enough = self.num_heartbeats >= (2 if self.num_others else HEARTBEATS_ALONE)
        return enough and stamp_s - self.first_s >= SETTLED_S


@dataclass(slots=True)
class _Told:
    """What the vehicle's heartbeats say, and when that changed."""

    dialect: Dialect
    stamp_s: float
    is_armed: bool
    mode: str
    armed_changes_s: list[float] = field(default_factory=list)
    mode_changes_s: list[float] = field(default_factory=list)


class VehicleIdentity:
    """Knows the vehicle.

    Parameters
    ----------
    named : int or None
        System id that the mission file names; None: the first autopilot that is heard for a while and
        sends what an autopilot sends.

    Attributes
    ----------
    system_id : int or None
        The vehicle's, None until it is known.
    peer : Address or None
        Where it speaks from; None where a line has no addresses, or before it was heard.
    others : list of int
        Systems of other autopilots on the link, sixteen at most.
    """

    def __init__(self, named: int | None) -> None:
        self.system_id = named
        self.peer: Address | None = None
        self.others: list[int] = []
        self._peer_heard_s = -math.inf
        self._candidates: dict[tuple[int, Address | None], _Candidate] = {}
        self._told: _Told | None = None
        self._disbelieved_until_s = -math.inf

    def is_autopilot(self, system_id: int, component_id: int) -> bool:
        """Whether a frame has the ids of the vehicle's autopilot."""
        return system_id == self.system_id and component_id == ComponentId.AUTOPILOT1

    def is_at_its_place(self, stamp_s: float, address: Address | None, *, is_verified: bool) -> bool:
        """Whether a frame with the vehicle's ids comes from where the vehicle speaks.

        Another address becomes that by a verified frame, once the former was silent for five seconds.
        """
        if address is None:
            return True
        if address != self.peer:
            if not is_verified or stamp_s - self._peer_heard_s <= PEER_SILENT_S:
                return False
            self.peer = address
        if is_verified:
            self._peer_heard_s = stamp_s
        return True

    def note_frame(self, system_id: int, stamp_s: float, address: Address | None) -> None:
        """Take note of what an autopilot's component sends besides heartbeats, until the vehicle is known."""
        candidate = self._candidates.get((system_id, address))
        if self.system_id is None and candidate is not None:
            candidate.note(is_heartbeat=False)
            self._settle(system_id, candidate, stamp_s, address)

    def note_heartbeat(self, system_id: int, stamp_s: float, address: Address | None) -> None:
        """Take note of an autopilot's heartbeat; it may be that by which the vehicle is known."""
        if self.system_id is None:
            key = system_id, address
            if key not in self._candidates:
                if len(self._candidates) >= CANDIDATES_MAX:
                    del self._candidates[next(iter(self._candidates))]
                self._candidates[key] = _Candidate(stamp_s)
            self._candidates[key].note(is_heartbeat=True)
            self._settle(system_id, self._candidates[key], stamp_s, address)
        elif system_id != self.system_id and system_id not in self.others and len(self.others) < OTHERS_MAX:
            self.others.append(system_id)

    def _settle(self, system_id: int, candidate: _Candidate, stamp_s: float, address: Address | None) -> None:
        if not candidate.is_settled(stamp_s):
            return
        self.system_id, self.peer, self._peer_heard_s = system_id, address, stamp_s
        self.others = sorted({system for system, _ in self._candidates} - {system_id})
        self._candidates.clear()

    def believed(
        self, dialect: Dialect, mode: str, stamp_s: float, *, is_armed: bool
    ) -> tuple[Dialect, bool, bool]:
        """What is believed of a heartbeat of the vehicle's.

        Parameters
        ----------
        dialect, mode, is_armed
            What it says.
        stamp_s : float
            When it came [s].

        Returns
        -------
        tuple
            Dialect, whether the aircraft is armed, and whether heartbeats contradict each other. The dialect
            is fixed while the aircraft is armed, and for as long as heartbeats of it come.
        """
        told = self._told
        if told is None or (
            dialect is not told.dialect and not told.is_armed and stamp_s - told.stamp_s > DIALECT_SILENT_S
        ):
            told = self._told = _Told(dialect, stamp_s, is_armed, mode)
        if dialect is not told.dialect:
            self._disbelieved_until_s = stamp_s + DISBELIEVED_S
            return told.dialect, told.is_armed, True
        _note_change(told.armed_changes_s, stamp_s, is_change=is_armed is not told.is_armed)
        _note_change(told.mode_changes_s, stamp_s, is_change=mode != told.mode)
        told.stamp_s, told.is_armed, told.mode = stamp_s, is_armed, mode
        if len(told.armed_changes_s) > ARMED_CHANGES_MAX or len(told.mode_changes_s) > MODE_CHANGES_MAX:
            self._disbelieved_until_s = stamp_s + DISBELIEVED_S
        return dialect, is_armed, stamp_s < self._disbelieved_until_s


def _note_change(changes_s: list[float], stamp_s: float, *, is_change: bool) -> None:
    """Keep the changes of the last seconds, as many as are needed to tell."""
    changes_s[:] = [at for at in changes_s if stamp_s - at <= CHANGES_S][-MODE_CHANGES_MAX - 1 :]
    if is_change:
        changes_s.append(stamp_s)
