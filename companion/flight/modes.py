"""Who flies: the service's states, and everything that changes them.

Theory of operation. The service acts in ``ACTIVE`` only. It becomes active when the autopilot is
armed and flies missions, and it leaves that state on the first heartbeat that says otherwise: the
pilot always wins, and nothing the service does changes a mode. After such a change it is
``SUSPENDED``; whether the return of the mission mode makes it active again is the mission file's
``authority.resume``. ``ARRIVED`` is final for a flight: the last goal was reached.

An autopilot that fell silent while the service was active is waited for in ``LOST``: if it comes back
in another mode, the pilot has taken over meanwhile. A mission that somebody else uploads is flown, not
replaced, and so is an item that somebody else makes current: ``YIELDED`` until the pilot leaves the
mission mode, which is where handing back begins.

=============  ==================  =============
state          event               next state
=============  ==================  =============
WAITING        mission flown       ACTIVE
WAITING        mission not flown   STANDBY
STANDBY        mission flown       ACTIVE
ACTIVE         mission not flown   SUSPENDED
ACTIVE         goal reached        ARRIVED
ACTIVE         foreign mission     YIELDED
ACTIVE         autopilot silent    LOST
LOST           mission flown       ACTIVE
LOST           mission not flown   SUSPENDED
YIELDED        mission not flown   SUSPENDED
SUSPENDED      mission flown       ACTIVE (resume: auto), else SUSPENDED
STANDBY        autopilot silent    WAITING
=============  ==================  =============
"""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """What the service may do."""

    WAITING = "waiting for the autopilot"
    STANDBY = "standing by: no mission is flown"
    ACTIVE = "planning"
    LOST = "waiting for the autopilot to come back"
    SUSPENDED = "suspended by the pilot"
    YIELDED = "suspended: another mission or item was chosen"
    ARRIVED = "arrived"


class ModeEvent(Enum):
    """What changes it."""

    MISSION_FLOWN = "mission flown"
    MISSION_NOT_FLOWN = "mission not flown"
    GOAL_REACHED = "goal reached"
    AUTOPILOT_SILENT = "autopilot silent"
    OTHER_MISSION = "foreign mission"


_TABLE: dict[tuple[Mode, ModeEvent], Mode] = {
    (Mode.WAITING, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.WAITING, ModeEvent.MISSION_NOT_FLOWN): Mode.STANDBY,
    (Mode.STANDBY, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.STANDBY, ModeEvent.AUTOPILOT_SILENT): Mode.WAITING,
    (Mode.ACTIVE, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.ACTIVE, ModeEvent.GOAL_REACHED): Mode.ARRIVED,
    (Mode.ACTIVE, ModeEvent.OTHER_MISSION): Mode.YIELDED,
    (Mode.ACTIVE, ModeEvent.AUTOPILOT_SILENT): Mode.LOST,
    (Mode.LOST, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.LOST, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.YIELDED, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.SUSPENDED, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
}


def next_mode(mode: Mode, event: ModeEvent, *, may_resume: bool) -> Mode:
    """Mode after an event; events without a row change nothing."""
    if mode is Mode.SUSPENDED and not may_resume:
        return mode
    return _TABLE.get((mode, event), mode)
