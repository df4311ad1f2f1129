"""The mission that the autopilot holds, made again of what was said to it."""

import struct
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.real.rig.relay import Framer

HEADER = struct.Struct(">Q")


def messages_of(path, source):
    """Time, source and message of each frame of a tlog."""
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    data = path.read_bytes()
    place = 0
    while place + HEADER.size + 3 <= len(data):
        (stamp,) = HEADER.unpack_from(data, place)
        frames = Framer().frames(data[place + HEADER.size : place + HEADER.size + 400])
        if not frames:
            break
        place += HEADER.size + len(frames[0])
        for message in parser.parse_buffer(frames[0]) or []:
            if message.get_type() != "BAD_DATA":
                yield 1e-6 * stamp, source, message


@dataclass
class Upload:
    """An upload under way."""

    sender: int
    count: int
    items: dict
    is_partial: bool = False


class HeldMission:
    """Follows what one autopilot is told.

    Parameters
    ----------
    in_place : bool
        Whether items are written over the old ones as they come, as ArduPlane does; a PX4 takes the whole
        list at the end.

    Attributes
    ----------
    items : list
        MISSION_ITEM_INT messages, or None where nothing came yet.
    changed_s : float
        When the list or the item chosen was changed last.
    num_uploads : dict
        Uploads begun, by the sender's component.
    """

    def __init__(self, *, in_place):
        self.in_place = in_place
        self.items = []
        self.changed_s = 0.0
        self.num_uploads = {}
        self._upload = None

    def hear(self, stamp_s, message):
        """Follow a message of the exchange, from whomever."""
        kind = message.get_type()
        if getattr(message, "mission_type", 0) != 0:
            return
        if kind == "MISSION_COUNT" and message.get_srcComponent() != mavlink.MAV_COMP_ID_AUTOPILOT1:
            self._begin(stamp_s, message, message.count, is_partial=False)
            if self.in_place:
                self.items = (self.items + [None] * message.count)[: message.count]
        elif kind == "MISSION_WRITE_PARTIAL_LIST":
            self._begin(stamp_s, message, message.end_index + 1 - message.start_index, is_partial=True)
        elif kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            self._item(stamp_s, message)
        elif kind == "MISSION_ACK" and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
            self._end(stamp_s, message)
        elif kind == "MISSION_SET_CURRENT" or (
            kind in ("COMMAND_LONG", "COMMAND_INT")
            and message.command in (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, mavlink.MAV_CMD_MISSION_START)
        ):
            self.changed_s = stamp_s

    def _begin(self, _stamp_s, message, count, *, is_partial):
        sender = message.get_srcComponent()
        last = self._upload
        if last is not None and is_partial and last.is_partial and last.sender == sender:
            return  # said again: denied, and the first goes on
        if last is None or (last.sender, last.count) != (sender, count) or last.items:  # else asked again
            self.num_uploads[sender] = self.num_uploads.get(sender, 0) + 1
        self._upload = Upload(sender, count, {}, is_partial)

    def _item(self, stamp_s, message):
        upload = self._upload
        if upload is None or message.get_srcComponent() != upload.sender:
            return
        upload.items[message.seq] = message
        if self.in_place and message.seq < len(self.items):
            self.items[message.seq] = message
            self.changed_s = stamp_s
        elif self.in_place and message.seq == len(self.items):
            self.items.append(message)
            self.changed_s = stamp_s

    def _end(self, stamp_s, message):
        upload = self._upload
        if upload is None or message.target_component not in (upload.sender, 0):
            return
        is_whole = len(upload.items) == upload.count
        if message.type == mavlink.MAV_MISSION_ACCEPTED and is_whole and not self.in_place:
            self.items = [upload.items[number] for number in sorted(upload.items)]
            self.changed_s = stamp_s
        is_open = message.type in (mavlink.MAV_MISSION_INVALID_SEQUENCE, mavlink.MAV_MISSION_DENIED)
        if is_whole or (message.type != mavlink.MAV_MISSION_ACCEPTED and not is_open):
            self._upload = None
