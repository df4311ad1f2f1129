"""The life of a flight as a table: which mode the service is in, and the events that change it.

Theory of operation. The table covers everything from power-on to landing. Until the takeover the list is the
operator's: on the ground and during the climb the service reads every change of it and replies, and nothing
suspends it. In ``DEPARTING``, from arming on, the operator's mission is flown up to the moment that the
mission file's ``takeover`` names. Only then is the service ``ACTIVE`` and uploads missions. It leaves that
mode on the first heartbeat that reports another flight mode: the pilot always wins, and the service never
changes a flight mode. It is then ``SUSPENDED``. Whether it becomes active again when the mission mode
returns is the mission file's ``authority.resume``. ``ARRIVED`` holds until the aircraft has landed: what
follows the goal is the operator's, unless the engine stops and the mission file lets the service glide down,
or the aircraft circles at the goal in another team member's way.

If the autopilot falls silent while the service is active, the service waits in ``LOST``. If the autopilot
returns in another flight mode, the pilot has taken over meanwhile. A mission that another station uploads in
flight is not replaced, and neither is an item that another station selects: the service is ``YIELDED`` until
the pilot leaves the mission mode, which is also the first step of a handback. A return to launch that follows
the service's return path is left alone, too, unless ``authority.renew_return`` lets it plan the rest.

=============  ==================  =============
state          event               next state
=============  ==================  =============
WAITING        mission flown       DEPARTING
WAITING        mission not flown   STANDBY
STANDBY        mission flown       DEPARTING
STANDBY        autopilot silent    WAITING
DEPARTING      takeover due        ACTIVE
DEPARTING      mission not flown   STANDBY
DEPARTING      autopilot silent    WAITING
ACTIVE         mission not flown   SUSPENDED
ACTIVE         goal reached        ARRIVED
ACTIVE         foreign mission     YIELDED
ACTIVE         return path flown   YIELDED
YIELDED        return renewed      ACTIVE
ACTIVE         autopilot silent    LOST
ACTIVE         landed              STANDBY
LOST           mission flown       ACTIVE
LOST           mission not flown   SUSPENDED
LOST           landed              STANDBY
YIELDED        mission not flown   SUSPENDED
YIELDED        landed              STANDBY
SUSPENDED      mission flown       ACTIVE (resume: auto), else SUSPENDED
SUSPENDED      return path flown   YIELDED
SUSPENDED      landed              STANDBY
ARRIVED        glide begun         ACTIVE
ARRIVED        other goals         ACTIVE
ARRIVED        landed              STANDBY
=============  ==================  =============
"""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """The service's modes, each with what it may do."""

    WAITING = "waiting for the autopilot"
    STANDBY = "standing by: no mission is flown"
    DEPARTING = "the operator's mission is flown up to the takeover"
    ACTIVE = "planning"
    LOST = "waiting for the autopilot to come back"
    SUSPENDED = "suspended: another mode is flown"
    YIELDED = "suspended: another mission or item was chosen"
    ARRIVED = "arrived"

    @property
    def is_before_takeover(self) -> bool:
        """Whether the list still belongs to the operator alone."""
        return self in (Mode.STANDBY, Mode.DEPARTING)


class ModeEvent(Enum):
    """The events that change the mode."""

    MISSION_FLOWN = "mission flown"
    MISSION_NOT_FLOWN = "mission not flown"
    TAKEOVER_DUE = "takeover due"
    GOAL_REACHED = "goal reached"
    GLIDE_BEGUN = "glide begun"
    OTHER_GOALS = "other goals"
    AUTOPILOT_SILENT = "autopilot silent"
    OTHER_MISSION = "foreign mission"
    RETURN_FLOWN = "return path flown"
    RETURN_RENEWED = "return renewed"
    LANDED = "landed"


_TABLE: dict[tuple[Mode, ModeEvent], Mode] = {
    (Mode.WAITING, ModeEvent.MISSION_FLOWN): Mode.DEPARTING,
    (Mode.WAITING, ModeEvent.MISSION_NOT_FLOWN): Mode.STANDBY,
    (Mode.STANDBY, ModeEvent.MISSION_FLOWN): Mode.DEPARTING,
    (Mode.STANDBY, ModeEvent.AUTOPILOT_SILENT): Mode.WAITING,
    (Mode.DEPARTING, ModeEvent.TAKEOVER_DUE): Mode.ACTIVE,
    (Mode.DEPARTING, ModeEvent.MISSION_NOT_FLOWN): Mode.STANDBY,
    (Mode.DEPARTING, ModeEvent.AUTOPILOT_SILENT): Mode.WAITING,
    (Mode.ACTIVE, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.ACTIVE, ModeEvent.GOAL_REACHED): Mode.ARRIVED,
    (Mode.ARRIVED, ModeEvent.GLIDE_BEGUN): Mode.ACTIVE,
    (Mode.ARRIVED, ModeEvent.OTHER_GOALS): Mode.ACTIVE,
    (Mode.ACTIVE, ModeEvent.OTHER_MISSION): Mode.YIELDED,
    (Mode.ACTIVE, ModeEvent.RETURN_FLOWN): Mode.YIELDED,
    (Mode.YIELDED, ModeEvent.RETURN_RENEWED): Mode.ACTIVE,
    (Mode.ACTIVE, ModeEvent.AUTOPILOT_SILENT): Mode.LOST,
    (Mode.LOST, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.LOST, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.YIELDED, ModeEvent.MISSION_NOT_FLOWN): Mode.SUSPENDED,
    (Mode.SUSPENDED, ModeEvent.MISSION_FLOWN): Mode.ACTIVE,
    (Mode.SUSPENDED, ModeEvent.RETURN_FLOWN): Mode.YIELDED,
    **{
        (mode, ModeEvent.LANDED): Mode.STANDBY
        for mode in (Mode.ACTIVE, Mode.LOST, Mode.YIELDED, Mode.SUSPENDED, Mode.ARRIVED)
    },
}


def next_mode(mode: Mode, event: ModeEvent, *, may_resume: bool) -> Mode:
    """Return the mode after an event; events without a row change nothing."""
    if (mode, event) == (Mode.SUSPENDED, ModeEvent.MISSION_FLOWN) and not may_resume:
        return mode
    return _TABLE.get((mode, event), mode)
