"""What the codec makes of one frame."""

from __future__ import annotations

from dataclasses import dataclass

from companion.types.events import Event
from companion.types.mission import MissionItem


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK: the command, and the MAV_RESULT it got; both as they came."""

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
class MissionQuestion:
    """MISSION_REQUEST or MISSION_REQUEST_INT: the item of an upload that is asked for."""

    sequence: int
    mission_type: int


@dataclass(frozen=True, slots=True)
class MissionCount:
    """MISSION_COUNT: how long the autopilot's list is."""

    count: int
    mission_type: int


@dataclass(frozen=True, slots=True)
class MissionTold:
    """MISSION_ITEM_INT: an item of the autopilot's list."""

    item: MissionItem
    mission_type: int


@dataclass(frozen=True, slots=True)
class ParameterTold:
    """PARAM_VALUE: the value as a float, and the same 32 bits as a whole number.

    ArduPilot sends whole numbers as floats, PX4 as they lie in memory; ``is_whole`` tells of which the
    parameter is.
    """

    name: str
    value: float
    bits: int
    is_whole: bool

    def number(self, *, is_bytewise: bool) -> float:
        """The value, as an autopilot packs it that sends whole numbers as they lie in memory, or does not."""
        return float(self.bits) if self.is_whole and is_bytewise else self.value


@dataclass(frozen=True, slots=True)
class VersionTold:
    """AUTOPILOT_VERSION: major, minor and patch number, and the release type (255 released)."""

    numbers: tuple[int, int, int]
    release: int


Reply = CommandAck | MissionAck | MissionQuestion | MissionCount | MissionTold | ParameterTold | VersionTold


@dataclass(frozen=True, slots=True)
class Request:
    """Something asked of us or of everybody.

    Parameters
    ----------
    kind : str
        ``command``, ``ping``, ``parameter_list``, ``parameter_read``, ``parameter_set``,
        ``mission_list``, or ``file``.
    number : int
        The command, the sequence number of a ping, or of a parameter the index, -1 for one by its name, and
        where it is to be set its MAV_PARAM_TYPE.
    parameters : tuple of float
        A command's first four parameters, -1 for one not finite; a ping's time in microseconds; the
        value that a parameter is to have.
    name : str
        Name of the parameter that is asked for or set; '' for other requests.
    data : bytes
        Payload of MAVLink FTP; empty for other requests.
    """

    kind: str
    target_system: int
    target_component: int
    number: int = 0
    parameters: tuple[float, ...] = ()
    name: str = ""
    data: bytes = b""


@dataclass(frozen=True, slots=True)
class DecodedFrame:
    """A frame that was accepted: intact, and from somebody else.

    Parameters
    ----------
    raw : bytes
        As received, to be recorded or passed on.
    events : tuple of Event
        What it tells the rest of the program; empty for messages nobody needs and for values
        that were refused.
    reply : Reply or None
        What the autopilot answered.
    request : Request or None
        What somebody asks.
    """

    raw: bytes
    system_id: int
    component_id: int
    message_id: int
    events: tuple[Event, ...] = ()
    reply: Reply | None = None
    request: Request | None = None
