"""Decodes MAVLink bytes into events and encodes messages into bytes. Only this module imports pymavlink.

Received data never raises an exception. Damaged, unknown and impossible data is dropped and counted by its
reason in ``Codec.counters``.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.flight_modes import DIALECTS
from companion.link.messages.track_messages import Tracks
from companion.link.messages.vehicle_identity import VehicleIdentity
from companion.link.messages.vehicle_telemetry import TEAM_PAYLOAD, RefusedError, Telemetry
from companion.link.missions.mission_items import item_from_payload
from companion.link.wire.decoded_frame import (
    AutopilotVersion,
    CommandAck,
    DecodedFrame,
    MissionAck,
    MissionCount,
    MissionItemReceived,
    MissionItemRequest,
    ParameterValue,
    Reply,
    Request,
)
from companion.link.wire.framing import (
    MAGIC_V2,
    SIGNATURE,
    RawFrame,
    checksum,
    packed_frame,
    raw_frame,
    renumbered,
)
from companion.link.wire.incoming import Incoming
from companion.link.wire.signing import SETUP_SIGNING, Signer, Timestamps, without_signature
from companion.link.wire.source_limits import SourceLimits
from companion.link.wire.transport import Address
from companion.types.events import Event
from companion.types.mavlink_enums import ComponentId, MessageId, MissionType, SystemState
from companion.types.mission import MissionItem

COMPONENT_ID = ComponentId.PATHPLANNER
STATUSTEXT_CHARACTERS = 50

_EXTRAS = {number: kind.crc_extra for number, kind in mavlink.mavlink_map.items()}
# COMPONENT_METADATA is missing from pymavlink's dialects. It is only sent; its fields give this extra byte.
_SENT_EXTRAS = _EXTRAS | {MessageId.COMPONENT_METADATA: 182}
_LENGTHS_MAX = {number: kind.unpacker.size for number, kind in mavlink.mavlink_map.items()}
_OWN_SYSTEM_UNTIL_KNOWN = 1


def signer_of(
    key: bytes,
    link_id: int,
    timestamps: Timestamps,
    allow_unsigned: Collection[int] = (),
    *,
    allow_mavlink1: bool = False,
) -> Signer:
    """Return a signer that knows the CRC extra bytes of the dialect."""
    return Signer(key, link_id, timestamps, _SENT_EXTRAS, allow_unsigned, allow_mavlink1=allow_mavlink1)


def is_intact(raw: bytes) -> bool:
    """Return whether a frame's checksum is correct; true for messages that the dialect does not know."""
    extra = _SENT_EXTRAS.get(raw_frame(raw).message_id)
    if extra is None:
        return True
    body = len(raw) - 2 - (SIGNATURE if raw[0] == MAGIC_V2 and raw[2] & 1 else 0)
    return checksum(raw[1:body], extra) == int.from_bytes(raw[body : body + 2], "little")


class Codec:
    """Decodes and encodes the messages of one link.

    Parameters
    ----------
    vehicle_system_id : int, optional
        System id of the vehicle; by default that of the first autopilot that sends for a while. Messages are
        sent with the same system id and component id 195.
    track_sources : collection of int, optional
        System ids whose track messages are accepted; by default all.
    signer : Signer, optional
        Verifies received frames and signs sent ones; by default unsigned frames are accepted.
    limits : SourceLimits, optional
        Rate limits for senders other than the vehicle's autopilot.
    """

    def __init__(
        self,
        vehicle_system_id: int | None = None,
        track_sources: Collection[int] | None = None,
        *,
        signer: Signer | None = None,
        limits: SourceLimits | None = None,
    ) -> None:
        self.counters: Counter[str] = Counter()
        self.identity = VehicleIdentity(vehicle_system_id)
        self._incoming = Incoming(_EXTRAS, self.counters, _LENGTHS_MAX)
        self._reader = mavlink.MAVLink(None)
        self._writer = mavlink.MAVLink(None, srcComponent=COMPONENT_ID)
        self._telemetry = Telemetry(self.identity)
        self._tracks = Tracks(self._telemetry, track_sources)
        self._chunk_id, self._state = 0, int(SystemState.BOOT)
        self._signer = signer
        self._limits = limits
        if signer is not None:
            signer.count_in(self.counters)

    @property
    def vehicle_system_id(self) -> int | None:
        """System id of the vehicle; None until it is known."""
        return self.identity.system_id

    @property
    def home_altitude_amsl_m(self) -> float | None:
        """Altitude that the autopilot's relative altitudes refer to; None until the autopilot reports it."""
        return self._telemetry.home_altitude_amsl_m

    @property
    def own_ids(self) -> tuple[int, int]:
        """System id and component id of sent messages."""
        return self.identity.system_id or _OWN_SYSTEM_UNTIL_KNOWN, COMPONENT_ID

    def feed(self, data: bytes, stamp_s: float, address: Address | None = None) -> list[DecodedFrame]:
        """Decode received bytes.

        Parameters
        ----------
        data : bytes
            Received bytes, in arbitrary portions.
        stamp_s : float
            Time of arrival on the service's clock [s].
        address : tuple of str and int, optional
            Sender of the bytes; left out on a line, which has one sender.

        Returns
        -------
        list of DecodedFrame
            Frames that became complete, in order, without echoes of our own.
        """
        frames = []
        is_peer = address in (None, self.identity.peer)
        for raw in self._incoming.frames(data, stamp_s, address, is_peer=is_peer):
            if (raw.system_id, raw.component_id) == self.own_ids:
                self.counters["own"] += 1
            elif not self._is_accepted(raw, stamp_s, address):
                continue
            elif not raw.is_verified:
                self.counters["unknown_message"] += 1
                frames.append(DecodedFrame(raw.raw, raw.system_id, raw.component_id, raw.message_id))
            else:
                frames.append(self._decoded(raw, stamp_s, address))
        return frames

    def _is_accepted(self, raw: RawFrame, stamp_s: float, address: Address | None) -> bool:
        """Return whether a frame is signed as required and its sender may send it."""
        if raw.message_id == SETUP_SIGNING:
            self.counters["setup_signing"] += 1  # It holds a key, so it is not forwarded or recorded either.
            return False
        if self._signer is not None and not self._signer.accepts(raw):
            return False
        is_vehicle = self.identity.is_autopilot(raw.system_id, raw.component_id)
        if is_vehicle and not self.identity.is_from_vehicle_address(
            stamp_s, address, is_verified=raw.is_verified
        ):
            self.counters["other_address"] += 1
            return False
        if self._limits is None:
            return True
        refusal = self._limits.refusal(raw.system_id, raw.component_id, stamp_s, is_vehicle=is_vehicle)
        if refusal:
            self.counters[refusal] += 1
        return not refusal

    def signed(self, data: bytes) -> bytes:
        """Return packed frames as they are sent: signed if there is a key."""
        return data if self._signer is None else self._signer.signed(data)

    @staticmethod
    def unsigned(raw: bytes) -> bytes:
        """Return a received frame without its signature, for a reader that has no key."""
        return without_signature(raw, _SENT_EXTRAS)

    def _decoded(self, raw: RawFrame, stamp_s: float, address: Address | None) -> DecodedFrame:
        try:
            message = self._reader.decode(bytearray(raw.raw))
        except mavlink.MAVError:
            self.counters["undecodable"] += 1
            return DecodedFrame(raw.raw, raw.system_id, raw.component_id, raw.message_id)
        self.counters["accepted"] += 1
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._tracks.note_heartbeat(message, raw)
        if raw.component_id == ComponentId.AUTOPILOT1:
            if kind != "HEARTBEAT":
                self.identity.note_frame(raw.system_id, stamp_s, address)
            elif message.autopilot in DIALECTS:
                self.identity.note_heartbeat(raw.system_id, stamp_s, address)
        events: list[Event] = []
        try:
            for event in self._telemetry.events(kind, message, raw, stamp_s):
                events.append(event)  # noqa: PERF402 - A later refusal must keep the events before it.
            report = self._tracks.report(kind, message, raw, stamp_s)
            if report is not None:
                events.append(report)
        except RefusedError as refused:
            self.counters[f"refused_{refused.reason}"] += 1
        return DecodedFrame(
            raw.raw,
            raw.system_id,
            raw.component_id,
            raw.message_id,
            tuple(events),
            _reply(kind, message, raw, stamp_s) if raw.system_id == self.vehicle_system_id else None,
            None if (make := _REQUESTS.get(kind)) is None else make(message),
        )

    def renumbered(self, raw: bytes) -> bytes:
        """Give a frame that MAVSDK packed with our ids the next sequence number, so that no gap appears."""
        data = renumbered(raw, self._writer.seq, _EXTRAS[raw_frame(raw).message_id])
        self._writer.seq = (self._writer.seq + 1) % 256
        return data

    def _packed(self, message: Any) -> bytes:  # noqa: ANN401
        self._writer.srcSystem = self.own_ids[0]
        data = bytes(message.pack(self._writer))
        self._writer.seq = (self._writer.seq + 1) % 256
        return data

    def heartbeat(self, state: int = SystemState.ACTIVE) -> bytes:
        """Pack a HEARTBEAT of an onboard controller."""
        self._state = state
        return self.repeat_heartbeat()

    def repeat_heartbeat(self) -> bytes:
        """Pack a HEARTBEAT with the state of the last one, or "starting" before the first."""
        return self._packed(
            mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, self._state, 3
            )
        )

    def status_text(self, severity: int, text: str) -> bytes:
        """Pack a STATUSTEXT in as many chunks as needed; characters beyond ASCII become '?'.

        A ground station takes the first chunk that is not full for the last. If all chunks are full, an empty
        chunk follows.
        """
        encoded = text.encode("ascii", "replace")
        chunks = [
            encoded[start : start + STATUSTEXT_CHARACTERS]
            for start in range(0, max(len(encoded), 1), STATUSTEXT_CHARACTERS)
        ]
        if len(chunks) > 1:
            chunks += [b""] if len(chunks[-1]) == STATUSTEXT_CHARACTERS else []
            self._chunk_id = self._chunk_id % 0xFFFF + 1
        number = self._chunk_id if len(chunks) > 1 else 0
        return b"".join(
            self._packed(mavlink.MAVLink_statustext_message(severity, chunk, number, index))
            for index, chunk in enumerate(chunks[:256])
        )

    def team_message(self, payload: bytes) -> bytes:
        """Pack a payload of :mod:`companion.mission.team.wire` as a TUNNEL message to everybody."""
        fields = 0, 0, TEAM_PAYLOAD, len(payload), payload.ljust(128, b"\0")
        return self._packed(mavlink.MAVLink_tunnel_message(*fields))

    def named_value(self, boot_s: float, name: str, value: float) -> bytes:
        """Pack a NAMED_VALUE_FLOAT; the name is cut to ten characters."""
        milliseconds = int(boot_s * 1e3) % 2**32
        encoded = name.encode("ascii", "replace")[:10]
        return self._packed(mavlink.MAVLink_named_value_float_message(milliseconds, encoded, value))

    def computer_status(
        self, uptime_s: float, cores_percent: Sequence[float], temperature_c: float | None,
        memory_mb: tuple[float, float], disk_mb: tuple[float, float],
    ) -> bytes:  # fmt: skip
        """Pack an ONBOARD_COMPUTER_STATUS: up to eight cores; memory and disk as used and total [MiB]."""
        cores = [round(min(max(load, 0.0), 100.0)) for load in cores_percent[:8]]
        celsius = 127 if temperature_c is None else round(min(max(temperature_c, -127.0), 126.0))
        unknown, no_load, no_link = [2**32 - 1] * 3, [255] * 10, [2**32 - 1] * 6
        message = mavlink.MAVLink_onboard_computer_status_message(
            time_usec=0,
            uptime=int(uptime_s * 1e3) % 2**32,
            type=0,
            cpu_cores=[*cores, *no_load][:8],
            cpu_combined=no_load,
            gpu_cores=no_load[:4],
            gpu_combined=no_load,
            temperature_board=127,
            temperature_core=[celsius, *[127] * 7],
            fan_speed=[2**15 - 1] * 4,
            ram_usage=round(memory_mb[0]),
            ram_total=round(memory_mb[1]),
            storage_type=[0, *unknown],
            storage_usage=[round(disk_mb[0]), *unknown],
            storage_total=[round(disk_mb[1]), *unknown],
            link_type=no_link,
            link_tx_rate=no_link,
            link_rx_rate=no_link,
            link_tx_max=no_link,
            link_rx_max=no_link,
        )
        return self._packed(message)

    def command_long(self, command: int, parameters: tuple[float, ...] = (), confirmation: int = 0) -> bytes:
        """Pack a COMMAND_LONG to the autopilot; missing parameters are 0."""
        filled = (*parameters, *(0.0,) * 7)[:7]
        return self._packed(
            mavlink.MAVLink_command_long_message(self.own_ids[0], 1, command, confirmation, *filled)
        )

    def set_message_interval(self, message_id: int, rate_hz: float) -> bytes:
        """Pack a request for a message at a rate."""
        return self.command_long(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (float(message_id), 1e6 / rate_hz))

    def request_message(self, message_id: int) -> bytes:
        """Pack a request for one message."""
        return self.command_long(mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))

    def set_current_command(self, sequence: int, confirmation: int = 0) -> bytes:
        """Pack DO_SET_MISSION_CURRENT, which ArduPlane acknowledges and PX4 does not know."""
        return self.command_long(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, (float(sequence),), confirmation)

    def set_current_message(self, sequence: int) -> bytes:
        """Pack MISSION_SET_CURRENT, which is answered by MISSION_CURRENT only."""
        return self._packed(mavlink.MAVLink_mission_set_current_message(self.own_ids[0], 1, sequence))

    def set_mode(self, custom_mode: int) -> bytes:
        """Pack DO_SET_MODE with a ``custom_mode`` as in HEARTBEAT.

        PX4 takes main mode and sub mode as two parameters, ArduPilot takes the number. The upper bits are
        zero on ArduPilot and the lower bits are zero on PX4, so the number shows which encoding applies.
        """
        main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
        chosen = (float(main), float(sub)) if main else (float(custom_mode),)
        return self.command_long(mavlink.MAV_CMD_DO_SET_MODE, (1.0, *chosen))

    def command_ack(self, command: int, result: int, target_system: int, target_component: int) -> bytes:
        """Pack a COMMAND_ACK with a MAV_RESULT."""
        return self._packed(
            mavlink.MAVLink_command_ack_message(command, result, 0, 0, target_system, target_component)
        )

    def ping_answer(self, time_us: int, sequence: int, target_system: int, target_component: int) -> bytes:
        """Pack the answer to a PING, with the time and number of the PING."""
        return self._packed(mavlink.MAVLink_ping_message(time_us, sequence, target_system, target_component))

    def mission_opening(self, first: int, count: int, *, is_part: bool) -> bytes:
        """Pack a MISSION_COUNT, or a MISSION_WRITE_PARTIAL_LIST for a part of a list."""
        if is_part:
            last = first + count - 1
            return self._packed(
                mavlink.MAVLink_mission_write_partial_list_message(self.own_ids[0], 1, first, last)
            )
        return self._packed(mavlink.MAVLink_mission_count_message(self.own_ids[0], 1, count))

    def mission_item(self, item: MissionItem) -> bytes:
        """Pack a MISSION_ITEM_INT of an upload."""
        values = (math.nan if value is None else value for value in item.parameters)
        return self._packed(
            mavlink.MAVLink_mission_item_int_message(
                self.own_ids[0], 1, item.sequence, item.frame, item.command, int(item.is_current),
                int(item.autocontinue), *values, item.latitude_e7, item.longitude_e7, item.altitude_m,
            )
        )  # fmt: skip

    def mission_request(self, sequence: int | None, mission_type: int = MissionType.MISSION) -> bytes:
        """Pack a MISSION_REQUEST_INT for an item of the autopilot's list, or a MISSION_REQUEST_LIST."""
        target = self.own_ids[0], 1
        if sequence is None:
            return self._packed(mavlink.MAVLink_mission_request_list_message(*target, mission_type))
        return self._packed(mavlink.MAVLink_mission_request_int_message(*target, sequence, mission_type))

    def mission_refusal(self, target_system: int, target_component: int) -> bytes:
        """Pack a MISSION_ACK "unsupported": this component stores no missions."""
        unsupported = mavlink.MAV_MISSION_UNSUPPORTED
        return self._packed(mavlink.MAVLink_mission_ack_message(target_system, target_component, unsupported))

    def mission_ack(self, result: int, mission_type: int = MissionType.MISSION) -> bytes:
        """Pack a MISSION_ACK: "accepted" ends a download, and "cancelled" an aborted transfer on PX4."""
        return self._packed(mavlink.MAVLink_mission_ack_message(self.own_ids[0], 1, result, mission_type))

    def terrain_data(self, lat_e7: int, lon_e7: int, spacing_m: int, square: int, up_m: list[int]) -> bytes:
        """Pack 16 heights of the ground."""
        return self._packed(mavlink.MAVLink_terrain_data_message(lat_e7, lon_e7, spacing_m, square, up_m))

    def parameter_request(self, name: str) -> bytes:
        """Pack a PARAM_REQUEST_READ of an autopilot parameter, by name."""
        return self._packed(mavlink.MAVLink_param_request_read_message(self.own_ids[0], 1, name.encode(), -1))

    def parameter_set(self, name: str, value: int, *, is_bytewise: bool) -> bytes:
        """Pack a PARAM_SET of a whole-number parameter; ``is_bytewise`` as in ``ParameterValue.number``."""
        kind = mavlink.MAV_PARAM_TYPE_INT32 if is_bytewise else mavlink.MAV_PARAM_TYPE_REAL32
        sent = struct.unpack("<f", struct.pack("<i", value))[0] if is_bytewise else float(value)
        return self._packed(mavlink.MAVLink_param_set_message(self.own_ids[0], 1, name.encode(), sent, kind))

    def parameter_value(self, name: str, value: float, index: int, count: int) -> bytes:
        """Pack a PARAM_VALUE of one of our parameters; the name has at most 16 characters."""
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        return self._packed(
            mavlink.MAVLink_param_value_message(name.encode("ascii"), value, kind, count, index)
        )

    def autopilot_version(self, version: int) -> bytes:
        """Pack an AUTOPILOT_VERSION of this component, with its version encoded as 0xMMmmpptt."""
        nothing = [0] * 8
        able = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2 | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        able |= mavlink.MAV_PROTOCOL_CAPABILITY_FTP
        return self._packed(
            mavlink.MAVLink_autopilot_version_message(
                able, version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
            )
        )

    def component_metadata(self, boot_s: float, file_crc: int, uri: str) -> bytes:
        """Pack a COMPONENT_METADATA: CRC-32 and URI, below 100 characters, of the general document."""
        payload = struct.pack("<II100s", int(boot_s * 1e3) % 2**32, file_crc, uri.encode("ascii"))
        number, sequence = MessageId.COMPONENT_METADATA, self._writer.seq
        self._writer.seq = (sequence + 1) % 256
        return packed_frame(number, payload, sequence, self.own_ids, _SENT_EXTRAS[number])

    def file_transfer(self, payload: bytes, target_system: int, target_component: int) -> bytes:
        """Pack a FILE_TRANSFER_PROTOCOL with a payload of 251 bytes."""
        return self._packed(
            mavlink.MAVLink_file_transfer_protocol_message(0, target_system, target_component, list(payload))
        )


def _reply(kind: str, message: Any, raw: RawFrame, stamp_s: float) -> Reply | None:  # noqa: ANN401
    if kind == "COMMAND_ACK":
        return CommandAck(stamp_s, message.command, message.result)
    if kind == "MISSION_ACK":
        payload = raw.payload.ljust(8, b"\0")  # The dialect does not know opaque_id yet.
        opaque = int.from_bytes(payload[4:8], "little")
        return MissionAck(stamp_s, message.type, message.mission_type, opaque)
    if kind == "PARAM_VALUE":
        bits = int.from_bytes(raw.payload[:4].ljust(4, b"\0"), "little", signed=True)
        is_whole = message.param_type <= mavlink.MAV_PARAM_TYPE_INT32
        return ParameterValue(message.param_id, message.param_value, bits, is_whole)
    if kind == "AUTOPILOT_VERSION":
        major, minor, patch, release = message.flight_sw_version.to_bytes(4, "big")
        return AutopilotVersion((major, minor, patch), release)
    if kind not in _TRANSFERS or message.target_component not in (0, COMPONENT_ID):
        return None
    return _TRANSFERS[kind](message, raw)


_TRANSFERS: dict[str, Callable[[Any, RawFrame], Reply]] = {
    "MISSION_REQUEST": lambda m, _: MissionItemRequest(m.seq, m.mission_type),
    "MISSION_REQUEST_INT": lambda m, _: MissionItemRequest(m.seq, m.mission_type),
    "MISSION_COUNT": lambda m, _: MissionCount(m.count, m.mission_type),
    "MISSION_ITEM_INT": lambda _, raw: MissionItemReceived(*item_from_payload(raw.message_id, raw.payload)),
}


def _command(message: Any) -> Request:  # noqa: ANN401
    parameters = tuple(float(getattr(message, f"param{index}")) for index in range(1, 5))
    return Request(
        "command",
        message.target_system,
        message.target_component,
        message.command,
        tuple(value if math.isfinite(value) else -1.0 for value in parameters),
    )


_REQUESTS: dict[str, Callable[[Any], Request]] = {
    "COMMAND_LONG": _command,
    "COMMAND_INT": _command,
    "PING": lambda m: Request("ping", m.target_system, m.target_component, m.seq, (m.time_usec,)),
    "PARAM_REQUEST_LIST": lambda m: Request("parameter_list", m.target_system, m.target_component),
    "PARAM_REQUEST_READ": lambda m: Request(
        "parameter_read", m.target_system, m.target_component, m.param_index, name=m.param_id
    ),
    "PARAM_SET": lambda m: Request(
        "parameter_set", m.target_system, m.target_component, m.param_type, (m.param_value,), m.param_id
    ),
    "FILE_TRANSFER_PROTOCOL": lambda m: Request(
        "file", m.target_system, m.target_component, data=bytes(m.payload)
    ),
    "MISSION_REQUEST_LIST": lambda m: Request("mission_list", m.target_system, m.target_component),
    "MISSION_COUNT": lambda m: Request("mission_list", m.target_system, m.target_component),
    "TERRAIN_REQUEST": lambda m: Request("terrain", 0, 0, m.mask, (m.lat, m.lon, m.grid_spacing)),
}
