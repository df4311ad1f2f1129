"""The part of an autopilot that all kinds share: telemetry, parameters, commands, routing.

Missions and modes belong to :mod:`sim.autopilot.arduplane` (and to its peers): they differ in everything.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.types.mission import MissionItem
from ..projection import FastProjection
from ..vehicle.control import Flight
from .autopilot_parameters import Parameters
from .battery_failsafe import BatteryFailsafe
from .channel import Channel, Message, Stream
from .telemetry import Home, Telemetry

SYSTEM_ID = 1
COMPONENT_ID = mavlink.MAV_COMP_ID_AUTOPILOT1
_SECOND_US = 1_000_000
_TOUCHDOWN_M = 1.5  # Below this height above ground a landing is finished.
_ROLL_US = 2 * _SECOND_US  # Time from arming to the catapult.
_DISARM_US = 20 * _SECOND_US  # After this time armed on the ground it disarms by itself.
_INTERVAL_MAX_US = 2**31 - 1
_PARAMETERS_A_TURN = 5
_TEXT_LENGTH = 50

ACCEPTED: int = mavlink.MAV_RESULT_ACCEPTED
DENIED: int = mavlink.MAV_RESULT_DENIED
FAILED: int = mavlink.MAV_RESULT_FAILED
UNSUPPORTED: int = mavlink.MAV_RESULT_UNSUPPORTED


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """COMMAND_LONG or COMMAND_INT in one shape; position in 1e-7 degrees, ``z`` as sent."""

    channel: Channel
    command: int
    frame: int
    parameters: tuple[float, float, float, float]
    latitude_e7: int
    longitude_e7: int
    z: float
    sender: tuple[int, int] = (0, 0)


CommandHandler = Callable[[CommandRequest], int]


def _request(channel: Channel, message: Message) -> CommandRequest:
    values = (message.param1, message.param2, message.param3, message.param4)
    p1, p2, p3, p4 = (value if math.isfinite(value) else 0.0 for value in values)
    parameters = (p1, p2, p3, p4)
    sender = message.get_srcSystem(), message.get_srcComponent()
    if message.get_type() == "COMMAND_INT":
        return CommandRequest(
            channel, message.command, message.frame, parameters, message.x, message.y, message.z, sender
        )
    x, y = (value * 1e7 if math.isfinite(value) else 0.0 for value in (message.param5, message.param6))
    frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    return CommandRequest(
        channel, message.command, frame, parameters, round(x), round(y), message.param7, sender
    )


class Autopilot(ABC):
    """Channels, streams, parameters and the plain commands.

    Parameters
    ----------
    flight : Flight
        The aircraft's flight.
    projection : FastProjection
        Between local metres and degrees.
    parameters : Parameters
        The autopilot's parameters.
    home : Home
        Home position.

    Attributes
    ----------
    system_id : int
        The autopilot's system id; it is set before the first channel is added.
    """

    # Ids of messages that a client gets at 1 Hz without a request.
    default_streams: tuple[int, ...] = ()
    # Whether it answers when a message arrives, as a PX4 does (2.2 ms from an item to the next request,
    # measured), or in the next turn of its loop of 20 ms, as an ArduPlane does.
    answers_at_once = False

    def __init__(
        self, flight: Flight, projection: FastProjection, parameters: Parameters, home: Home
    ) -> None:
        self.flight = flight
        self.projection = projection
        self.parameters = parameters
        self.home = home
        self.telemetry = Telemetry(flight, projection, home)
        self.telemetry.builders[mavlink.MAVLINK_MSG_ID_HEARTBEAT] = self.heartbeat
        self.telemetry.builders[mavlink.MAVLINK_MSG_ID_MISSION_CURRENT] = self.mission_current
        self.telemetry.builders[mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION] = self.version
        if flight.ground is not None:
            self.telemetry.builders[mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR] = self.telemetry.height_sensor
            self.default_streams = (*self.default_streams, mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR)
        self.system_id = SYSTEM_ID
        self.channels: list[Channel] = []
        self.now_us = 0
        self.is_armed = True
        self.is_failsafe = False
        battery = flight.battery
        self.battery_failsafe = None if battery is None else BatteryFailsafe(battery, parameters)
        self._grounded_us = 0
        self._wanted_parameters: dict[Channel, list[str]] = {}
        self._handlers: dict[str, Callable[[Channel, Message], None]] = {
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "PARAM_REQUEST_LIST": self._list_parameters,
            "PARAM_REQUEST_READ": self._read_parameter,
            "PARAM_SET": self._set_parameter,
            "TIMESYNC": self._synchronise,
            "PING": self._ping,
            "REQUEST_DATA_STREAM": self._stream_group,
        }
        self._commands: dict[int, CommandHandler] = {
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._send_requested,
            mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._send_version,
            mavlink.MAV_CMD_GET_HOME_POSITION: self._send_home,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
        }

    @property
    @abstractmethod
    def mode(self) -> str:
        """Flight mode by its name."""

    @abstractmethod
    def set_mode(self, name: str) -> bool:
        """Switch to a mode by its name; ``False`` if there is none of that name."""

    @property
    @abstractmethod
    def mission_items(self) -> tuple[MissionItem, ...]:
        """The stored mission."""

    @property
    @abstractmethod
    def current_sequence(self) -> int:
        """Sequence of the item being flown, or to be resumed."""

    @property
    @abstractmethod
    def is_uploading(self) -> bool:
        """Whether somebody is uploading a list."""

    @property
    @abstractmethod
    def mission_revision(self) -> int:
        """Changes whenever the stored mission does."""

    @property
    def system_status(self) -> int:
        """MAV_STATE of a heartbeat: critical during a failsafe."""
        return int(mavlink.MAV_STATE_CRITICAL if self.is_failsafe else mavlink.MAV_STATE_ACTIVE)

    def fail_safe(self, mode: str) -> None:
        """Enter a mode by a failsafe."""
        self.is_failsafe = True
        self.set_mode(mode)

    @abstractmethod
    def heartbeat(self) -> Message:
        """HEARTBEAT."""

    @abstractmethod
    def mission_current(self) -> Message:
        """MISSION_CURRENT."""

    @abstractmethod
    def version(self) -> Message:
        """AUTOPILOT_VERSION."""

    @property
    @abstractmethod
    def active_command(self) -> int | None:
        """Command of the item being flown; None while none is."""

    @abstractmethod
    def disarmed(self) -> None:
        """The flight is over: the mission begins anew with the next."""

    @abstractmethod
    def navigate(self) -> None:
        """Follow the mode and the mission; called every 20 ms or more often."""

    def add_channel(self) -> Channel:
        """Open a link for one more client."""
        channel = Channel(self.system_id, COMPONENT_ID)
        self._reset_streams(channel)
        self.channels.append(channel)
        return channel

    def remove_channel(self, channel: Channel) -> None:
        """Close a client's link."""
        self.channels.remove(channel)
        self._wanted_parameters.pop(channel, None)

    def reboot(self) -> None:
        """Restart: time since boot is zero, stream rates are the defaults, requests are forgotten."""
        self.telemetry.boot_us = self.now_us
        self._wanted_parameters.clear()
        for channel in self.channels:
            self._reset_streams(channel)

    def relay_traffic(self, report: Message, source: tuple[int, int]) -> None:
        """Forward ADSB_VEHICLE of a source (system and component id) to all links."""
        for channel in self.channels:
            channel.send_as(report, *source)

    def receive(self, channel: Channel, data: bytes) -> None:
        """Act on what a client sent."""
        for message in channel.parse(data):
            target = getattr(message, "target_system", 0)
            if target != self.system_id:
                self._route(channel, message, target)
            if target in (0, self.system_id):
                handler = self._handlers.get(message.get_type())
                if handler is not None:
                    handler(channel, message)

    def update(self, now_us: int) -> None:
        """Navigate, then send what is due."""
        self.now_us = self.telemetry.now_us = now_us
        self._meet_ground()
        self._watch_battery()
        self.navigate()
        for channel in self.channels:
            self._send_streams(channel)
            names = self._wanted_parameters.get(channel)
            if names:
                for name in names[:_PARAMETERS_A_TURN]:
                    channel.send(self.parameters.message(name))
                del names[:_PARAMETERS_A_TURN]

    def _meet_ground(self) -> None:
        """Leave the ground when a take-off is flown, come to rest at a landing's end, disarm by itself."""
        flight = self.flight
        if not flight.is_standing:
            is_landing = self.active_command == mavlink.MAV_CMD_NAV_LAND
            if is_landing and flight.estimate.up_m <= flight.ground_up_m + _TOUCHDOWN_M:
                flight.stand(flight.ground_up_m)
                self._grounded_us = self.now_us
        elif self.is_armed and self.active_command == mavlink.MAV_CMD_NAV_TAKEOFF:
            if self.now_us - self._grounded_us >= _ROLL_US:
                flight.launch()
        elif self.is_armed and self.now_us - self._grounded_us >= _DISARM_US:
            self._disarm()

    def _watch_battery(self) -> None:
        """Tell of a low battery, and return to launch if the parameters say so and it is not landing."""
        if self.battery_failsafe is None or not self.is_armed:
            return
        low = self.battery_failsafe.check()
        if low is not None:
            self.say(mavlink.MAV_SEVERITY_WARNING, low.text)
            is_down = self.flight.is_standing or self.active_command == mavlink.MAV_CMD_NAV_LAND
            if low.returns and not is_down:
                self.fail_safe("RTL")

    def arm(self) -> None:
        """Move the pilot's arming switch."""
        if not self.is_armed:
            self.is_armed, self._grounded_us = True, self.now_us

    def _disarm(self) -> None:
        self.is_armed = False
        self.disarmed()

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT to every client."""
        self.broadcast(
            mavlink.MAVLink_statustext_message(severity, text[:_TEXT_LENGTH].encode("ascii", "replace"))
        )

    def broadcast(self, message: Message) -> None:
        """Send to every client."""
        for channel in self.channels:
            channel.send(message)

    def _reset_streams(self, channel: Channel) -> None:
        channel.streams = {
            message_id: Stream(_SECOND_US, self.now_us)
            for message_id in (mavlink.MAVLINK_MSG_ID_HEARTBEAT, *self.default_streams)
        }

    def _route(self, source: Channel, message: Message, target: int) -> None:
        """Forward messages for everybody, or for a system on another channel."""
        for channel in self.channels:
            if (
                channel is not source
                and channel.systems_seen
                and (not target or target in channel.systems_seen)
            ):
                channel.forward(bytes(message.get_msgbuf()))

    def _send_streams(self, channel: Channel) -> None:
        now_us = self.now_us
        for message_id, stream in channel.streams.items():
            if now_us < stream.next_us:
                continue
            behind = now_us - stream.next_us
            stream.next_us = now_us + stream.interval_us - behind % stream.interval_us
            message = self.telemetry.builders[message_id]()
            if message is not None:
                channel.send(message)

    def _command(self, channel: Channel, message: Message) -> None:
        handler = self._commands.get(message.command)
        result = UNSUPPORTED if handler is None else handler(_request(channel, message))
        channel.send(
            mavlink.MAVLink_command_ack_message(
                message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
            )
        )

    def _set_interval(self, request: CommandRequest) -> int:
        message_id, interval = int(request.parameters[0]), request.parameters[1]
        if message_id not in self.telemetry.builders:
            self.say(mavlink.MAV_SEVERITY_INFO, f"No ap_message for mavlink id ({message_id})")
            return DENIED
        if interval < 0:
            request.channel.streams.pop(message_id, None)
        else:
            interval_us = min(max(int(interval), 20_000), _INTERVAL_MAX_US) if interval > 0 else _SECOND_US
            request.channel.streams[message_id] = Stream(interval_us, self.now_us + interval_us)
        return ACCEPTED

    def _get_interval(self, request: CommandRequest) -> int:
        message_id = int(request.parameters[0])
        if message_id not in self.telemetry.builders:
            return DENIED
        stream = request.channel.streams.get(message_id)
        interval = -1 if stream is None else stream.interval_us
        request.channel.send(mavlink.MAVLink_message_interval_message(message_id, interval))
        return ACCEPTED

    def _stream_group(self, channel: Channel, message: Message) -> None:
        """REQUEST_DATA_STREAM, which older ground stations use: one rate for all default messages."""
        interval_us = max(_SECOND_US // max(message.req_message_rate, 1), 20_000)
        for message_id in self.default_streams:
            if message.start_stop:
                channel.streams[message_id] = Stream(interval_us, self.now_us)
            else:
                channel.streams.pop(message_id, None)

    def _send_requested(self, request: CommandRequest) -> int:
        builder = self.telemetry.builders.get(int(request.parameters[0]))
        message = None if builder is None else builder()
        if message is None:
            return FAILED
        request.channel.send(message)
        return ACCEPTED

    def _send_version(self, request: CommandRequest) -> int:
        request.channel.send(self.version())
        return ACCEPTED

    def _send_home(self, request: CommandRequest) -> int:
        request.channel.send(self.telemetry.home_position())
        return ACCEPTED

    def _arm(self, request: CommandRequest) -> int:
        """Arm; in flight it does not disarm."""
        if request.parameters[0] == 1.0:
            self.arm()
            return ACCEPTED
        if not self.flight.is_standing:
            return FAILED
        self._disarm()
        return ACCEPTED

    def _list_parameters(self, channel: Channel, _message: Message) -> None:
        self._wanted_parameters[channel] = self.parameters.names

    def _read_parameter(self, channel: Channel, message: Message) -> None:
        name = self.parameters.name_of(message.param_id, message.param_index)
        if name is not None:
            channel.send(self.parameters.message(name))

    def _set_parameter(self, _channel: Channel, message: Message) -> None:
        name = self.parameters.name_of(message.param_id, -1)
        if name is not None and self.parameters.set_from_client(name, message.param_value):
            self.broadcast(self.parameters.message(name))

    def _synchronise(self, channel: Channel, message: Message) -> None:
        if message.tc1 == 0:
            channel.send(
                mavlink.MAVLink_timesync_message(self.telemetry.boot_time_us() * 1000 + 1, message.ts1)
            )

    def _ping(self, channel: Channel, message: Message) -> None:
        if message.target_system == 0:
            channel.send(
                mavlink.MAVLink_ping_message(
                    message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()
                )
            )
