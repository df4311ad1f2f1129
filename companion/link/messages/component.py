"""How this component behaves towards others: what it answers when it is addressed.

A component that stays silent makes ground stations wait and retry. It stores no missions and carries
out no commands, and says so; it has parameters of its own, and documents that describe them; what is
asked of others is left alone.

References
----------
MAVLink guide, *Parameter Protocol*: a value that is not taken is answered with the one in force. All
values are REAL32, which every dialect's encoding leaves alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from companion import __version__
from companion.link.messages.codec import Codec
from companion.link.messages.file_server import FileServer, file_checksum
from companion.link.wire.decoded_frame import DecodedFrame, Request
from companion.types.mavlink_enums import (
    Command,
    CommandResult,
    MessageId,
    ParameterType,
)
from companion.types.pilot_texts import pilot_message


class ParameterStore(Protocol):
    """Parameters that may be listed, read and set."""

    @property
    def names(self) -> Sequence[str]:
        """In the order of their numbers."""
        ...

    @property
    def files(self) -> Mapping[str, bytes]:
        """What may be read about them, by path; the general metadata comes first."""
        ...

    def value(self, name: str) -> float:
        """The value in force."""
        ...

    def may_set(self, system_id: int) -> bool:
        """Whether a system may set values."""
        ...

    def set(self, name: str, value: float, sender: tuple[int, int]) -> str:
        """Set a value for a system and component; returns why that was refused, '' if it was not."""
        ...


def answer(
    frame: DecodedFrame,
    codec: Codec,
    parameters: ParameterStore | None = None,
    files: FileServer | None = None,
    now_s: float = 0.0,
) -> bytes:
    """Return the bytes that a frame calls for, empty for none.

    Parameters
    ----------
    frame : DecodedFrame
        The received frame, of whatever kind.
    codec : Codec
        The link's codec, under whose ids the answer is encoded.
    parameters : ParameterStore, optional
        Parameters of this component; left out, it has none.
    files : FileServer, optional
        What may be read by MAVLink FTP, the general metadata first; left out, nothing.
    now_s : float, optional
        Clock reading [s].
    """
    request = frame.request
    if request is None:
        return b""
    system, component = codec.own_ids
    if request.kind == "ping":
        return _ping_answer(request, frame, codec)
    if request.kind == "parameter_list" and parameters is not None:
        return _parameter_list(request, codec, parameters)
    if (request.target_system, request.target_component) != (system, component):
        return b""  # an answer to a broadcast would be one of many, and the autopilot gives it
    return _addressed_answer(request, frame, codec, parameters, files, now_s)


def _addressed_answer(
    request: Request,
    frame: DecodedFrame,
    codec: Codec,
    parameters: ParameterStore | None,
    files: FileServer | None,
    now_s: float,
) -> bytes:
    """Answer a request that is addressed to this component alone."""
    sender = (frame.system_id, frame.component_id)
    if request.kind == "command":
        return _command_answer(request, sender, codec, files, now_s)
    if request.kind == "file":
        payloads = () if files is None else files.answers(request.data, sender, now_s)
        return b"".join(codec.file_transfer(payload, *sender) for payload in payloads)
    if request.kind == "mission_list":
        # The autopilot's own count, which it sends to us in a download, is no request.
        return b"" if sender == (codec.own_ids[0], 1) else codec.mission_refusal(*sender)
    return b"" if parameters is None else _parameter_answer(request, frame, codec, parameters)


def _ping_answer(request: Request, frame: DecodedFrame, codec: Codec) -> bytes:
    """Answer to a ping that asks everybody; one with a target is itself an answer."""
    if (request.target_system, request.target_component) != (0, 0):
        return b""
    return codec.ping_answer(int(request.parameters[0]), request.number, frame.system_id, frame.component_id)


def _parameter_list(request: Request, codec: Codec, parameters: ParameterStore) -> bytes:
    """All parameters, where we are asked or everybody is, by component 0: each answers for itself."""
    system, component = codec.own_ids
    is_asked = request.target_system in (0, system) and request.target_component in (0, component)
    return b"".join(_told(name, codec, parameters) for name in parameters.names) if is_asked else b""


def _told(name: str, codec: Codec, parameters: ParameterStore) -> bytes:
    names = parameters.names
    return codec.parameter_value(name, parameters.value(name), names.index(name), len(names))


def _parameter_answer(
    request: Request, frame: DecodedFrame, codec: Codec, parameters: ParameterStore
) -> bytes:
    """Answer to PARAM_REQUEST_READ or PARAM_SET; what there is not is counted and not answered."""
    names, name = parameters.names, request.name
    if request.kind == "parameter_read" and request.number >= 0:
        name = names[request.number] if request.number < len(names) else ""
    if name not in names:
        codec.counters["refused_parameter"] += 1
        return b""
    said = b""
    if request.kind == "parameter_set" and not parameters.may_set(frame.system_id):
        codec.counters["refused_parameter_source"] += 1
    elif request.kind == "parameter_set":
        # In another type the same bytes are another number, and autopilots differ in how they take it.
        is_real = request.number == ParameterType.REAL32
        sender = (frame.system_id, frame.component_id)
        reason = parameters.set(name, request.parameters[0], sender) if is_real else "not sent as REAL32"
        if reason:
            codec.counters["refused_parameter"] += 1
            value = f"{parameters.value(name):g}"
            message = pilot_message("parameter refused", parameter=name, value=value, reason=reason)
            said = codec.status_text(message.severity, message.text)
    return _told(name, codec, parameters) + said


def _command_answer(
    request: Request, sender: tuple[int, int], codec: Codec, files: FileServer | None, now_s: float
) -> bytes:
    if request.number == Command.REQUEST_MESSAGE:
        wanted = int(request.parameters[0])
        accepted = codec.command_ack(request.number, CommandResult.ACCEPTED, *sender)
        if wanted == MessageId.AUTOPILOT_VERSION:
            return accepted + codec.autopilot_version(_packed_version())
        if wanted == MessageId.HEARTBEAT:
            return accepted + codec.heartbeat_again()
        if wanted == MessageId.COMPONENT_METADATA and files is not None:
            path, document = next(iter(files.files().items()))
            return accepted + codec.component_metadata(now_s, file_checksum(document), f"mftp://{path}")
    return codec.command_ack(request.number, CommandResult.UNSUPPORTED, *sender)


def _packed_version() -> int:
    """The program's version as AUTOPILOT_VERSION packs it: a byte each for major, minor and patch."""
    major, minor, patch = (int(number) for number in __version__.split(".")[:3])
    return major << 24 | minor << 16 | patch << 8
