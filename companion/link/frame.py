"""What the codec makes of one frame."""

from __future__ import annotations

from dataclasses import dataclass

from companion.types.events import Event

# MAV_RESULT, as far as it ends a command.
RESULTS = {
    0: "ACCEPTED",
    1: "TEMPORARILY_REJECTED",
    2: "DENIED",
    3: "UNSUPPORTED",
    4: "FAILED",
    6: "CANCELLED",
}


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK: the command, and the MAV_RESULT it got (0 accepted, 5 in progress)."""

    stamp_s: float
    command: int
    result: int


@dataclass(frozen=True, slots=True)
class MissionAck:
    """MISSION_ACK. ``opaque_id`` names the mission on PX4; 0 where there is none."""

    stamp_s: float
    result: int
    mission_type: int
    opaque_id: int


@dataclass(frozen=True, slots=True)
class Request:
    """Something asked of us or of everybody.

    Parameters
    ----------
    kind : str
        ``command``, ``ping``, ``parameter_list``, ``parameter_read``, ``parameter_set``, or
        ``mission_list``.
    number : int
        The command, or the sequence number of a ping.
    parameters : tuple of float
        Of a command, the first four, -1 for one not finite; of a ping, its time in microseconds.
    name : str
        Of a parameter.
    """

    kind: str
    target_system: int
    target_component: int
    number: int = 0
    parameters: tuple[float, ...] = ()
    name: str = ""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame that was accepted: intact, and from somebody else.

    Parameters
    ----------
    raw : bytes
        As received, to be recorded or passed on.
    events : tuple of Event
        What it tells the rest of the program; empty for messages nobody needs and for values
        that were refused.
    reply : CommandAck, MissionAck or None
        What the autopilot answered.
    request : Request or None
        What somebody asks.
    """

    raw: bytes
    system_id: int
    component_id: int
    message_id: int
    events: tuple[Event, ...] = ()
    reply: CommandAck | MissionAck | None = None
    request: Request | None = None
