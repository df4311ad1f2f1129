"""The mission protocol as PX4 speaks it, one machine a link.

Theory of operation::

    idle ──COUNT──▶ receiving ──last item──▶ idle; the list is switched to, ACK with its id
      │               │   └──bad item─────▶ idle, ACK with the reason
      │               ├──ACK CANCELLED────▶ idle
      │               └──5 s of silence───▶ idle, no ACK
      └─REQUEST_LIST─▶ sending ──ACK, or 5 s of silence──▶ idle

Items of an upload are asked for at once, again every 250 ms, and kept apart until the last has come:
whatever ends a transfer early leaves the old list as it was. Only one link may upload at a time, and a
link that is not idle takes no new list: it is "busy".
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.mission import MissionItem
from ...mission_types import MissionKind, Verdict
from ..arduplane.arduplane_transfer import item_from_message
from ..channel import Channel, Extended, Message
from .px4_store import MAX_ITEMS, StoredList, read_back, stored, verdict_on

_REPEAT_US = 250_000
_TIMEOUT_US = 5_000_000
_KIND_OF_ALL = 255
_TARGET_COMPONENTS = (0, 1, 190)


class Owner(Protocol):
    """The owner of the lists."""

    @property
    def current_item(self) -> int:
        """Sequence marked as current in a download."""

    def stored_list(self, kind: MissionKind) -> StoredList:
        """Return the list in use."""

    def switch(self, kind: MissionKind, new: StoredList, current: int | None) -> None:
        """Use another list from now on; ``current`` is the item marked so, if one was."""

    def clear(self, kind: MissionKind) -> None:
        """Forget a list."""

    def forget_reached(self) -> None:
        """Stop repeating MISSION_ITEM_REACHED."""

    def go_to(self, sequence: int) -> bool:
        """Make an item current; ``False`` if there is none of that number."""


class _State(Enum):
    IDLE = "idle"
    RECEIVING = "receiving"
    SENDING = "sending"


@dataclass(slots=True)
class _Link:
    """The transfer on one link, and its times [µs]."""

    state: _State = _State.IDLE
    partner: tuple[int, int] = (0, 0)
    kind: MissionKind = MissionKind.MISSION
    count: int = 0
    items: list[MissionItem] = field(default_factory=list)
    current: int | None = None
    received_us: int = 0
    ask_us: int = 0


def _sender(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


class Px4Transfer:
    """Uploads and downloads of all three lists, on all links.

    Parameters
    ----------
    owner : Owner
        Keeps the lists.
    announce : callable
        Sends a text of a severity to everybody.
    """

    def __init__(self, owner: Owner, announce: Callable[[int, str], None]) -> None:
        self._owner = owner
        self._announce = announce
        self._links: dict[Channel, _Link] = {}
        self._now_us = 0
        self._handlers: dict[str, Callable[[Channel, _Link, Message], None]] = {
            "MISSION_COUNT": self._count,
            "MISSION_ITEM": self._item,
            "MISSION_ITEM_INT": self._item,
            "MISSION_ACK": self._ack,
            "MISSION_REQUEST_LIST": self._list,
            "MISSION_REQUEST": self._request,
            "MISSION_REQUEST_INT": self._request,
            "MISSION_CLEAR_ALL": self._clear,
            "MISSION_SET_CURRENT": self._set_current,
        }

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages it answers; MISSION_WRITE_PARTIAL_LIST is none of them."""
        return tuple(self._handlers)

    @property
    def is_receiving(self) -> bool:
        """Whether a list is being uploaded."""
        return any(link.state is _State.RECEIVING for link in self._links.values())

    def update(self, now_us: int) -> None:
        """Request the next item again, and end transfers that went silent."""
        self._now_us = now_us
        for channel, link in self._links.items():
            if link.state is _State.IDLE:
                continue
            if now_us - link.received_us >= _TIMEOUT_US:
                link.state = _State.IDLE
                self._announce(mavlink.MAV_SEVERITY_CRITICAL, "Operation timeout")
            elif link.state is _State.RECEIVING and now_us >= link.ask_us:
                self._ask(channel, link)

    def handle(self, channel: Channel, message: Message, now_us: int) -> None:
        """Answer one message of the protocol; ignore messages for other components."""
        self._now_us = now_us
        if message.target_component in _TARGET_COMPONENTS:
            self._handlers[message.get_type()](channel, self._links.setdefault(channel, _Link()), message)

    def _reply(
        self, channel: Channel, message: Message, kind: int, verdict: Verdict, identity: int = 0
    ) -> None:
        ack = mavlink.MAVLink_mission_ack_message(*_sender(message), int(verdict), kind)
        channel.send(Extended(ack, identity.to_bytes(4, "little")))

    def _busy(self, channel: Channel, message: Message) -> None:
        self._announce(mavlink.MAV_SEVERITY_CRITICAL, "WPM: REJ. CMD: Busy")
        self._reply(channel, message, getattr(message, "mission_type", 0), Verdict.ERROR)

    def _ask(self, channel: Channel, link: _Link) -> None:
        link.ask_us = self._now_us + _REPEAT_US
        channel.send(mavlink.MAVLink_mission_request_int_message(*link.partner, len(link.items), link.kind))

    def _count(self, channel: Channel, link: _Link, message: Message) -> None:
        self._owner.forget_reached()
        is_partner = link.partner == _sender(message)
        if link.state is _State.RECEIVING and is_partner and not link.items:
            link.received_us = self._now_us  # A repetition; a changed count is ignored.
            self._ask(channel, link)
            return
        if link.state is not _State.IDLE or self.is_receiving:
            if link.state is _State.RECEIVING and is_partner:
                link.received_us = self._now_us
            self._busy(channel, message)
            return
        kind = self._kind(channel, message)
        if kind is None:
            return
        if message.count > MAX_ITEMS:
            self._reply(channel, message, kind, Verdict.NO_SPACE)
        elif message.count == 0:
            self._owner.clear(kind)
            self._reply(channel, message, kind, Verdict.ACCEPTED)
        else:
            link.state, link.partner, link.kind = _State.RECEIVING, _sender(message), kind
            link.count, link.items, link.current = message.count, [], None
            link.received_us = self._now_us
            self._ask(channel, link)

    def _kind(self, channel: Channel, message: Message) -> MissionKind | None:
        number = message.mission_type
        if number in tuple(MissionKind):
            return MissionKind(number)
        self._reply(channel, message, number, Verdict.UNSUPPORTED)
        return None

    def _item(self, channel: Channel, link: _Link, message: Message) -> None:
        """Take the item that was asked for; others, and those of strangers, are ignored."""
        if link.state is not _State.RECEIVING or link.partner != _sender(message):
            return
        if message.seq != len(link.items) or message.mission_type != link.kind:
            return
        link.received_us = self._now_us
        item = item_from_message(message)
        verdict = verdict_on(link.kind, item)
        if verdict is not Verdict.ACCEPTED:
            link.state = _State.IDLE
            self._reply(channel, message, link.kind, verdict)
            return
        link.items.append(item)
        if item.is_current:
            link.current = item.sequence  # The last marked item counts.
        if len(link.items) < link.count:
            self._ask(channel, link)
            return
        link.state = _State.IDLE
        new = stored(link.items)
        if (
            new.identity != self._owner.stored_list(link.kind).identity
        ):  # The same list again is accepted without a transfer.
            self._owner.switch(link.kind, new, link.current)
        self._reply(channel, message, link.kind, Verdict.ACCEPTED, new.identity)

    def _ack(self, _channel: Channel, link: _Link, message: Message) -> None:
        if link.partner != _sender(message):
            return
        if link.state is _State.SENDING or (
            link.state is _State.RECEIVING and message.type == Verdict.OPERATION_CANCELLED
        ):
            link.state = _State.IDLE

    def _list(self, channel: Channel, link: _Link, message: Message) -> None:
        if link.state is _State.RECEIVING:
            self._busy(channel, message)
            return
        kind = self._kind(channel, message)
        if kind is None:
            return
        kept = self._owner.stored_list(kind)
        link.state = _State.SENDING if kept.items else _State.IDLE
        link.partner, link.kind, link.received_us = _sender(message), kind, self._now_us
        count = mavlink.MAVLink_mission_count_message(*_sender(message), len(kept.items), kind)
        channel.send(Extended(count, kept.identity.to_bytes(4, "little")))

    def _request(self, channel: Channel, link: _Link, message: Message) -> None:
        if link.state is not _State.SENDING or link.partner != _sender(message):
            return
        kept = self._owner.stored_list(link.kind)
        if message.seq >= len(kept.items) or message.mission_type != link.kind:
            self._reply(channel, message, link.kind, Verdict.ERROR)
            return
        link.received_us = self._now_us
        is_present = link.kind is MissionKind.MISSION and message.seq == self._owner.current_item
        item = read_back(kept.items[message.seq], is_current=is_present)
        is_integer = message.get_type() == "MISSION_REQUEST_INT"
        build = (
            mavlink.MAVLink_mission_item_int_message if is_integer else mavlink.MAVLink_mission_item_message
        )
        scale = 1 if is_integer else 1e-7
        channel.send(
            build(
                *link.partner,
                message.seq,
                item.frame,
                item.command,
                int(item.is_current),
                int(item.autocontinue),
                *(math.nan if value is None else value for value in item.parameters),
                item.latitude_e7 * scale,
                item.longitude_e7 * scale,
                item.altitude_m,
                int(link.kind),
            )
        )

    def _clear(self, channel: Channel, link: _Link, message: Message) -> None:
        if link.state is not _State.IDLE:
            self._busy(channel, message)
            return
        number = message.mission_type
        kinds = list(MissionKind) if number == _KIND_OF_ALL else [self._kind(channel, message)]
        for kind in kinds:
            if kind is None:
                return
            self._owner.clear(kind)
        self._reply(channel, message, number, Verdict.ACCEPTED)

    def _set_current(self, _channel: Channel, link: _Link, message: Message) -> None:
        """MISSION_SET_CURRENT, which is never acknowledged."""
        if link.state is not _State.IDLE:
            self._announce(mavlink.MAV_SEVERITY_CRITICAL, "WPM: IGN WP CURR CMD: Busy")
        elif not self._owner.go_to(message.seq):
            self._announce(mavlink.MAV_SEVERITY_CRITICAL, "WPM: WP CURR CMD: Not in list")
