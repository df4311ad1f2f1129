"""The codec's result for one frame: events, replies of the autopilot, and requests of others."""

from __future__ import annotations

from dataclasses import dataclass

from companion.types.events import Event
from companion.types.mission import MissionItem


@dataclass(frozen=True, slots=True)
class CommandAck:
    """COMMAND_ACK: the command and its MAV_RESULT, both as received."""

    stamp_s: float
    command: int
    result: int


@dataclass(frozen=True, slots=True)
class MissionAck:
    """MISSION_ACK. ``opaque_id`` identifies the mission on PX4; it is 0 if the autopilot sends none."""

    stamp_s: float
    result: int
    mission_type: int
    opaque_id: int


@dataclass(frozen=True, slots=True)
class MissionItemRequest:
    """MISSION_REQUEST or MISSION_REQUEST_INT: the autopilot requests an item of an upload."""

    sequence: int
    mission_type: int


@dataclass(frozen=True, slots=True)
class MissionCount:
    """MISSION_COUNT: the number of items in the autopilot's list."""

    count: int
    mission_type: int


@dataclass(frozen=True, slots=True)
class MissionItemReceived:
    """MISSION_ITEM_INT: one item of the autopilot's list."""

    item: MissionItem
    mission_type: int


@dataclass(frozen=True, slots=True)
class ParameterValue:
    """PARAM_VALUE: the value as a float, and the same 32 bits as an integer.

    ArduPilot sends an integer parameter as a float. PX4 sends its bytes as they are in memory. ``is_whole``
    is true for an integer parameter.
    """

    name: str
    value: float
    bits: int
    is_whole: bool

    def number(self, *, is_bytewise: bool) -> float:
        """Return the value; ``is_bytewise`` is true if the autopilot sends integers as in memory."""
        return float(self.bits) if self.is_whole and is_bytewise else self.value

    def is_set(self, name: str, value: float, is_bytewise: bool) -> bool:
        """Return whether this is a parameter with this value; ``is_bytewise`` as in :meth:`number`."""
        return self.name == name and self.number(is_bytewise=is_bytewise) == value


@dataclass(frozen=True, slots=True)
class AutopilotVersion:
    """AUTOPILOT_VERSION: major, minor and patch number, and the release type (255: released)."""

    numbers: tuple[int, int, int]
    release: int


Reply = (
    CommandAck
    | MissionAck
    | MissionItemRequest
    | MissionCount
    | MissionItemReceived
    | ParameterValue
    | AutopilotVersion
)


@dataclass(frozen=True, slots=True)
class Request:
    """A request to this component or to everybody.

    Parameters
    ----------
    kind : str
        ``command``, ``ping``, ``parameter_list``, ``parameter_read``, ``parameter_set``,
        ``mission_list``, ``file``, or ``terrain``.
    number : int
        The command of ``command``; the sequence number of ``ping``; the index of ``parameter_read``, or -1
        if it gives a name; the MAV_PARAM_TYPE of ``parameter_set``; a bit for each square of heights that
        ``terrain`` asks for. 0 for other requests.
    parameters : tuple of float
        The first four parameters of ``command``, with -1 in place of values that are not finite; the time of
        ``ping`` [µs]; the new value of ``parameter_set``; latitude, longitude [1e-7 deg] and spacing [m] of
        ``terrain``.
    name : str
        Name of the parameter to read or set; '' for other requests.
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
    """A frame that the codec accepted: it is intact and was not sent by this component.

    Parameters
    ----------
    raw : bytes
        The frame as received.
    events : tuple of Event
        Events decoded from the message; empty if nothing uses the message or its values were refused.
    reply : Reply or None
        The reply, if the vehicle's system sent one.
    request : Request or None
        The request, if the message is one.
    """

    raw: bytes
    system_id: int
    component_id: int
    message_id: int
    events: tuple[Event, ...] = ()
    reply: Reply | None = None
    request: Request | None = None
