"""Answers of this component to requests of other systems.

Ground stations wait and retry if a component does not answer. This component stores no missions and carries
out no commands, and answers so. It has parameters and documents that describe them. Requests to other
components are ignored.

References
----------
MAVLink guide, *Parameter Protocol*: a refused value is answered with the value in force. All values are
REAL32, which every dialect encodes in the same way.
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
    """Parameters that can be listed, read and set."""

    @property
    def names(self) -> Sequence[str]:
        """Names, in the order of their indices."""
        ...

    @property
    def files(self) -> Mapping[str, bytes]:
        """Metadata files by path; the general metadata comes first."""
        ...

    def value(self, name: str) -> float:
        """Return the value in force."""
        ...

    def may_set(self, system_id: int) -> bool:
        """Return whether a system may set values."""
        ...

    def set(self, name: str, value: float, sender: tuple[int, int]) -> str:
        """Set a value for a system and component; returns the reason of a refusal, else ''."""
        ...


def answer(
    frame: DecodedFrame,
    codec: Codec,
    parameters: ParameterStore | None = None,
    files: FileServer | None = None,
    now_s: float = 0.0,
) -> bytes:
    """Return the answer to a frame, empty if there is none.

    Parameters
    ----------
    frame : DecodedFrame
        The received frame, of any kind.
    codec : Codec
        Codec of the link; it packs the answer.
    parameters : ParameterStore, optional
        Parameters of this component; left out, it has none.
    files : FileServer, optional
        Files that MAVLink FTP may read, the general metadata first; left out, none.
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
        return b""  # The autopilot answers broadcasts.
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
    """Answer a ping to everybody; a ping with a target is itself an answer."""
    if (request.target_system, request.target_component) != (0, 0):
        return b""
    return codec.ping_answer(int(request.parameters[0]), request.number, frame.system_id, frame.component_id)


def _parameter_list(request: Request, codec: Codec, parameters: ParameterStore) -> bytes:
    """Send all parameters if this component is asked, or all components (component 0)."""
    system, component = codec.own_ids
    is_asked = request.target_system in (0, system) and request.target_component in (0, component)
    return (
        b"".join(_parameter_value(name, codec, parameters) for name in parameters.names) if is_asked else b""
    )


def _parameter_value(name: str, codec: Codec, parameters: ParameterStore) -> bytes:
    names = parameters.names
    return codec.parameter_value(name, parameters.value(name), names.index(name), len(names))


def _parameter_answer(
    request: Request, frame: DecodedFrame, codec: Codec, parameters: ParameterStore
) -> bytes:
    """Answer PARAM_REQUEST_READ or PARAM_SET; unknown parameters are counted and not answered."""
    names, name = parameters.names, request.name
    if request.kind == "parameter_read" and request.number >= 0:
        name = names[request.number] if request.number < len(names) else ""
    if name not in names:
        codec.counters["refused_parameter"] += 1
        return b""
    text = b""
    if request.kind == "parameter_set" and not parameters.may_set(frame.system_id):
        codec.counters["refused_parameter_source"] += 1
    elif request.kind == "parameter_set":
        # In another type the same bytes mean another number, and autopilots differ in how they decode it.
        is_real = request.number == ParameterType.REAL32
        sender = (frame.system_id, frame.component_id)
        reason = parameters.set(name, request.parameters[0], sender) if is_real else "not sent as REAL32"
        if reason:
            codec.counters["refused_parameter"] += 1
            value = f"{parameters.value(name):g}"
            message = pilot_message("parameter refused", parameter=name, value=value, reason=reason)
            text = codec.status_text(message.severity, message.text)
    return _parameter_value(name, codec, parameters) + text


def _command_answer(
    request: Request, sender: tuple[int, int], codec: Codec, files: FileServer | None, now_s: float
) -> bytes:
    if request.number == Command.REQUEST_MESSAGE:
        wanted = int(request.parameters[0])
        accepted = codec.command_ack(request.number, CommandResult.ACCEPTED, *sender)
        if wanted == MessageId.AUTOPILOT_VERSION:
            return accepted + codec.autopilot_version(_packed_version())
        if wanted == MessageId.HEARTBEAT:
            return accepted + codec.repeat_heartbeat()
        if wanted == MessageId.COMPONENT_METADATA and files is not None:
            path, document = next(iter(files.files().items()))
            return accepted + codec.component_metadata(now_s, file_checksum(document), f"mftp://{path}")
    return codec.command_ack(request.number, CommandResult.UNSUPPORTED, *sender)


def _packed_version() -> int:
    """Return the program's version as in AUTOPILOT_VERSION: a byte each for major, minor and patch."""
    major, minor, patch = (int(number) for number in __version__.split(".")[:3])
    return major << 24 | minor << 16 | patch << 8
