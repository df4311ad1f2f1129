"""The least of an autopilot that a mission client needs: heartbeats and the mission protocol.

It stands on pymavlink alone, so that what it says is not what the code under test thinks it says.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink


class FakeAutopilot:
    """Answers bytes with bytes.

    ``request_id`` is the message with which items are asked for: 40 as ArduPlane does, or 51.
    ``silent_after`` stops the answers once that many items were received.
    """

    def __init__(self, *, autopilot=3, custom_mode=10, request_id=40, silent_after=None, ack=0):
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.autopilot = autopilot
        self.custom_mode = custom_mode
        self.request_id = request_id
        self.silent_after = silent_after
        self.ack = ack
        self.items = []
        self.incoming = []
        self.first = self.expected = 0
        self.current = 0
        self.heard = []

    def pack(self, message):
        data = bytes(message.pack(self.writer))
        self.writer.seq = (self.writer.seq + 1) % 256
        return data

    def heartbeat(self):
        return self.pack(mavlink.MAVLink_heartbeat_message(1, self.autopilot, 217, self.custom_mode, 4, 3))

    def mission_current(self):
        return self.pack(
            mavlink.MAVLink_mission_current_message(self.current, max(len(self.items) - 1, 0), 3, 1)
        )

    def receive(self, data):
        replies = []
        for message in self.parser.parse_buffer(data) or []:
            self.heard.append(message)
            answer = getattr(self, "on_" + message.get_type().lower(), None)
            if answer is not None:
                replies += [self.pack(reply) for reply in answer(message)]
        return replies

    def _request(self, sequence):
        kind = (
            mavlink.MAVLink_mission_request_message
            if self.request_id == 40
            else mavlink.MAVLink_mission_request_int_message
        )
        return kind(1, 195, sequence, 0)

    def repeat(self):
        """The request for the item that is awaited, as autopilots send it again after a while."""
        return (
            self.pack(self._request(self.first + len(self.incoming)))
            if len(self.incoming) < self.expected
            else b""
        )

    def on_mission_write_partial_list(self, message):
        self.incoming = []
        self.first, self.expected = message.start_index, message.end_index - message.start_index + 1
        return [self._request(message.start_index)]

    def on_mission_count(self, message):
        self.incoming = []
        self.first, self.expected = 0, message.count
        if self.silent_after == 0:
            return []
        return [self._request(0)]

    def on_mission_item_int(self, message):
        if message.seq != self.first + len(self.incoming):
            return []
        self.incoming.append(message)
        if self.silent_after is not None and len(self.incoming) >= self.silent_after:
            return []
        if len(self.incoming) < self.expected:
            return [self._request(self.first + len(self.incoming))]
        if self.ack == 0 and self.first:
            self.items[self.first : self.first + self.expected] = self.incoming
        elif self.ack == 0:
            self.items = self.incoming
        return [mavlink.MAVLink_mission_ack_message(1, 195, self.ack, 0)]

    def on_mission_request_list(self, _message):
        return [mavlink.MAVLink_mission_count_message(1, 195, len(self.items), 0)]

    def on_mission_request_int(self, message):
        item = self.items[message.seq]
        return [
            mavlink.MAVLink_mission_item_int_message(
                1,
                195,
                item.seq,
                item.frame,
                item.command,
                int(item.seq == self.current),
                item.autocontinue,
                item.param1,
                item.param2,
                item.param3,
                item.param4,
                item.x,
                item.y,
                item.z,
                0,
            )
        ]

    def on_command_long(self, message):
        if message.command != 224:
            return [mavlink.MAVLink_command_ack_message(message.command, 3, 0, 0, 1, 195)]
        accepted = 0 <= int(message.param1) < len(self.items)
        if accepted:
            self.current = int(message.param1)
        return [mavlink.MAVLink_command_ack_message(224, 0 if accepted else 2, 0, 0, 1, 195)]

    def on_mission_set_current(self, message):
        if message.seq >= len(self.items):
            return []
        self.current = message.seq
        return [mavlink.MAVLink_mission_current_message(self.current, len(self.items) - 1, 3, 1)]
