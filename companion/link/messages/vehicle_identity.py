"""Identifies the vehicle: its system id, its address, and whether its heartbeats are consistent.

Without signatures anybody can send under any ids. Therefore nobody becomes the vehicle by being first, and
nobody replaces the vehicle while it sends. If two senders contradict each other under its ids, the service
acts on neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from companion.link.wire.transport import Address
from companion.types.events import Dialect
from companion.types.mavlink_enums import ComponentId

CANDIDATE_MIN_S = 0.9  # A candidate becomes the vehicle only this long after its first heartbeat.
HEARTBEATS_SUFFICIENT = (
    5  # Heartbeats that suffice from a candidate that sends nothing else until it is asked.
)
PEER_TIMEOUT_S = 5.0  # After this silence the vehicle may send from another address.
DIALECT_TIMEOUT_S = 5.0  # After this silence a disarmed vehicle may be another autopilot.
CHANGES_S = 4.0
ARMED_CHANGES_MAX, MODE_CHANGES_MAX = 1, 2  # More changes within CHANGES_S come from two senders.
DISTRUST_S = 5.0  # Heartbeats are not trusted for this time after a contradiction.
CANDIDATES_MAX = OTHERS_MAX = 16


@dataclass(slots=True)
class _Candidate:
    first_s: float
    num_heartbeats: int = 0
    num_others: int = 0

    def note(self, *, is_heartbeat: bool) -> None:
        """Count a frame of the candidate."""
        self.num_heartbeats += is_heartbeat
        self.num_others += not is_heartbeat

    def is_settled(self, stamp_s: float) -> bool:
        """Return whether it has sent for a while what an autopilot sends."""
        enough = self.num_heartbeats >= (2 if self.num_others else HEARTBEATS_SUFFICIENT)
        return enough and stamp_s - self.first_s >= CANDIDATE_MIN_S


@dataclass(slots=True)
class _ReportedState:
    """The state reported by the vehicle's heartbeats, and the times of its changes."""

    dialect: Dialect
    stamp_s: float
    is_armed: bool
    mode: str
    armed_changes_s: list[float] = field(default_factory=list)
    mode_changes_s: list[float] = field(default_factory=list)


class VehicleIdentity:
    """Identifies the vehicle.

    Parameters
    ----------
    named : int or None
        System id from the mission file; None selects the first autopilot that sends for a while what an
        autopilot sends.

    Attributes
    ----------
    system_id : int or None
        System id of the vehicle; None until it is known.
    peer : Address or None
        Address of the vehicle; None on a line without addresses, and before the first frame.
    others : list of int
        System ids of other autopilots on the link, at most 16.
    """

    def __init__(self, named: int | None) -> None:
        self.system_id = named
        self.peer: Address | None = None
        self.others: list[int] = []
        self._peer_received_s = -math.inf
        self._candidates: dict[tuple[int, Address | None], _Candidate] = {}
        self._reported: _ReportedState | None = None
        self._distrusted_until_s = -math.inf

    @property
    def has_candidate(self) -> bool:
        """Whether an autopilot has been received that is not yet confirmed as the vehicle."""
        return bool(self._candidates)

    def is_autopilot(self, system_id: int, component_id: int) -> bool:
        """Return whether these are the ids of the vehicle's autopilot."""
        return system_id == self.system_id and component_id == ComponentId.AUTOPILOT1

    def is_from_vehicle_address(self, stamp_s: float, address: Address | None, *, is_verified: bool) -> bool:
        """Return whether a frame with the vehicle's ids comes from the vehicle's address.

        A verified frame from another address changes the vehicle's address if the former one has been silent
        for five seconds.
        """
        if address is None:
            return True
        if address != self.peer:
            if not is_verified or stamp_s - self._peer_received_s <= PEER_TIMEOUT_S:
                return False
            self.peer = address
        if is_verified:
            self._peer_received_s = stamp_s
        return True

    def note_frame(self, system_id: int, stamp_s: float, address: Address | None) -> None:
        """Record a frame other than a heartbeat of an autopilot component, until the vehicle is known."""
        candidate = self._candidates.get((system_id, address))
        if self.system_id is None and candidate is not None:
            candidate.note(is_heartbeat=False)
            self._settle(system_id, candidate, stamp_s, address)

    def note_heartbeat(self, system_id: int, stamp_s: float, address: Address | None) -> None:
        """Record a heartbeat of an autopilot, which may identify the vehicle."""
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
        self.system_id, self.peer, self._peer_received_s = system_id, address, stamp_s
        self.others = sorted({system for system, _ in self._candidates} - {system_id})
        self._candidates.clear()

    def accept_heartbeat(
        self, dialect: Dialect, mode: str, stamp_s: float, *, is_armed: bool
    ) -> tuple[Dialect, bool, bool]:
        """Return what is accepted of a heartbeat of the vehicle.

        Parameters
        ----------
        dialect, mode, is_armed
            Contents of the heartbeat.
        stamp_s : float
            Time of arrival [s].

        Returns
        -------
        tuple
            The dialect, whether the aircraft is armed, and whether heartbeats contradict each other. The
            dialect does not change while the aircraft is armed, or while heartbeats of that dialect arrive.
        """
        reported = self._reported
        if reported is None or (
            dialect is not reported.dialect
            and not reported.is_armed
            and stamp_s - reported.stamp_s > DIALECT_TIMEOUT_S
        ):
            reported = self._reported = _ReportedState(dialect, stamp_s, is_armed, mode)
        if dialect is not reported.dialect:
            self._distrusted_until_s = stamp_s + DISTRUST_S
            return reported.dialect, reported.is_armed, True
        _note_change(reported.armed_changes_s, stamp_s, is_change=is_armed is not reported.is_armed)
        _note_change(reported.mode_changes_s, stamp_s, is_change=mode != reported.mode)
        reported.stamp_s, reported.is_armed, reported.mode = stamp_s, is_armed, mode
        if (
            len(reported.armed_changes_s) > ARMED_CHANGES_MAX
            or len(reported.mode_changes_s) > MODE_CHANGES_MAX
        ):
            self._distrusted_until_s = stamp_s + DISTRUST_S
        return dialect, is_armed, stamp_s < self._distrusted_until_s


def _note_change(changes_s: list[float], stamp_s: float, *, is_change: bool) -> None:
    """Keep the times of recent changes, at most as many as the decision needs."""
    changes_s[:] = [at for at in changes_s if stamp_s - at <= CHANGES_S][-MODE_CHANGES_MAX - 1 :]
    if is_change:
        changes_s.append(stamp_s)
