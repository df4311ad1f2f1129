"""One client's end of the autopilot: bytes to messages, messages to bytes, and its stream rates."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message = Any  # pymavlink's generated message classes have no usable common type.


@dataclass(slots=True)
class Stream:
    """A message's interval, and when it is sent next [µs]."""

    interval_us: int
    next_us: int


class Channel:
    """A byte stream between the autopilot and one client.

    Parameters
    ----------
    system_id, component_id : int
        The autopilot's ids.

    Attributes
    ----------
    systems_seen : set of int
        System ids seen on the channel, to which targeted messages are forwarded.
    streams : dict
        Message id to :class:`Stream`.
    num_dropped : int
        Frames that could not be decoded.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True
        self._others: dict[tuple[int, int], Any] = {}
        self._outgoing = bytearray()
        self.systems_seen: set[int] = set()
        self.streams: dict[int, Stream] = {}
        self.num_dropped = 0

    def parse(self, data: bytes) -> list[Message]:
        """Messages completed by these bytes; what cannot be decoded is counted and dropped."""
        messages: list[Message] = []
        pending = data
        while True:
            try:
                message = self._mav.parse_char(pending)
            except (mavlink.MAVError, struct.error, UnicodeDecodeError):
                self.num_dropped += 1
                pending = b""
                continue
            pending = b""
            if message is None:
                return messages
            if message.get_msgId() < 0 or message.get_type().startswith("UNKNOWN"):
                self.num_dropped += 1
                continue
            self.systems_seen.add(message.get_srcSystem())
            messages.append(message)

    def use_signing(self, key: bytes, link_id: int = 0, time: int = 0) -> None:
        """Sign sent frames and accept signed frames only, from now on.

        Parameters
        ----------
        key : bytes
            32 bytes.
        link_id : int
            Link id of this end.
        time : int
            Time of the first signature, in 10 µs since 2015.
        """
        signing = self._mav.signing
        signing.secret_key, signing.link_id, signing.timestamp = key, link_id, time
        signing.sign_outgoing = True

    def send(self, message: Message) -> None:
        """Queue a message of the autopilot's."""
        self._pack(self._mav, message)

    def send_as(self, message: Message, system_id: int, component_id: int) -> None:
        """Queue a message that another system on the vehicle's network sends."""
        key = (system_id, component_id)
        mav = self._others.get(key)
        if mav is None:
            mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
            self._others[key] = mav
        self._pack(mav, message)

    def forward(self, frame: bytes) -> None:
        """Queue another client's frame as it came."""
        self._outgoing += frame

    def take(self) -> bytes:
        """Everything queued since the last call."""
        data = bytes(self._outgoing)
        self._outgoing.clear()
        return data

    def _pack(self, mav: Message, message: Message) -> None:
        self._outgoing += message.pack(mav)
        mav.seq = (mav.seq + 1) % 256


class Extended:
    """A message with extension fields that the dialect does not know yet, behind those it does.

    Parameters
    ----------
    message : Message
        The message without them.
    extension : bytes
        The rest of the payload.
    """

    def __init__(self, message: Message, extension: bytes) -> None:
        self._message = message
        self._extension = extension

    def pack(self, mav: Message) -> bytes:
        """Frame of the message; extension fields do not count in its checksum's extra byte."""
        message = self._message
        fields = (getattr(message, name) for name in message.ordered_fieldnames)
        payload = message.unpacker.pack(*fields) + self._extension
        return bytes(message._pack(mav, message.crc_extra, payload))
