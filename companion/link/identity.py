"""How this component behaves towards others: what it answers when it is addressed.

A component that stays silent makes ground stations wait and retry. It has no parameters, stores
no missions and carries out no commands, and says so; what is asked of others is left alone.
"""

from __future__ import annotations

from companion.link.codec import Codec
from companion.link.frame import Frame, Request

_ACCEPTED, _UNSUPPORTED = 0, 3
_REQUEST_MESSAGE = 512
_AUTOPILOT_VERSION, _HEARTBEAT = 148, 0
_VERSION = 0x00010000  # 0.1.0, as AUTOPILOT_VERSION packs it


def answer(frame: Frame, codec: Codec) -> bytes:
    """Return the bytes that a frame calls for, empty for none.

    Parameters
    ----------
    frame : Frame
        Any received one.
    codec : Codec
        Whose ids and encoding the answer has.
    """
    request = frame.request
    if request is None:
        return b""
    system, component = codec.own_ids
    if request.kind == "ping":
        # A ping to nobody asks everybody; one with a target is itself an answer.
        if (request.target_system, request.target_component) != (0, 0):
            return b""
        return codec.ping_answer(
            int(request.parameters[0]), request.number, frame.system_id, frame.component_id
        )
    if (request.target_system, request.target_component) != (system, component):
        return b""  # an answer to a broadcast would be one of many, and the autopilot gives it
    if request.kind == "command":
        return _command_answer(request, frame, codec)
    if request.kind == "mission_list":
        # The autopilot's own count, sent to us in a download, is no request.
        is_autopilot = frame.system_id == system and frame.component_id == 1
        return b"" if is_autopilot else codec.mission_refusal(frame.system_id, frame.component_id)
    return b""  # an empty parameter list is one without entries


def _command_answer(request: Request, frame: Frame, codec: Codec) -> bytes:
    sender = (frame.system_id, frame.component_id)
    if request.number == _REQUEST_MESSAGE:
        wanted = int(request.parameters[0])
        if wanted == _AUTOPILOT_VERSION:
            return codec.command_ack(request.number, _ACCEPTED, *sender) + codec.autopilot_version(_VERSION)
        if wanted == _HEARTBEAT:
            return codec.command_ack(request.number, _ACCEPTED, *sender) + codec.heartbeat()
    return codec.command_ack(request.number, _UNSUPPORTED, *sender)
