"""What stations read about our parameters, with pymavlink's and MAVSDK's clients over loopback."""

import contextlib
import json
import socket
import struct
import threading
import time

import pytest
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc
from pymavlink.mavftp import MAVFTP

from companion.config import mission_from_text
from companion.config.parameters.pilot_parameters import TABLE, Parameters
from companion.flight.messages.send_budgets import SendBudgets
from companion.link.messages.codec import Codec, signer_of
from companion.link.wire.framing import raw_frame
from companion.link.wire.signing import Timestamps
from tests.support.sitl_harness import FIRST_FLIGHT

MISSION = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")
SYSTEM, COMPONENT = 1, 195
PARAMETERS, GENERAL = "/parameters.json", "/general.json"


class Vehicle(threading.Thread):
    """Component 195 with its answers and their budget, and an autopilot's heartbeat, on a UDP port."""

    def __init__(self, peer=None):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.05)
        self.port, self.peer = self.socket.getsockname()[1], peer
        self.parameters, self.codec = Parameters(MISSION, None), Codec(SYSTEM)
        self._budgets = SendBudgets(self.codec, None)
        self._budgets.begin(self.parameters)
        self._autopilot = mavlink.MAVLink(None, srcSystem=SYSTEM, srcComponent=1)
        self._is_over = threading.Event()

    def run(self):
        told_s = 0.0
        while not self._is_over.is_set():
            now_s = time.monotonic()
            with contextlib.suppress(TimeoutError):
                data, self.peer = self.socket.recvfrom(2048)
                for frame in self.codec.feed(data, now_s):
                    self._send(self._budgets.answer(frame, now_s))
            if self.peer and now_s - told_s > 0.2:
                told_s = now_s
                heartbeat = mavlink.MAVLink_heartbeat_message(1, 3, 0, 0, 4, 3)
                self._send(heartbeat.pack(self._autopilot) + self.codec.heartbeat())

    def _send(self, data):
        if data:
            self.socket.sendto(data, self.peer)

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        self._is_over.set()
        self.join()
        self.socket.close()


def test_pymavlinks_client_lists_and_reads_both_documents():
    with (
        Vehicle() as vehicle,
        contextlib.closing(
            mavutil.mavlink_connection(f"udpout:127.0.0.1:{vehicle.port}", source_system=255)
        ) as station,
    ):
        station.mav.heartbeat_send(6, 8, 0, 0, 0)
        station.wait_heartbeat(timeout=10)
        client = MAVFTP(station, SYSTEM, COMPONENT)
        told = vehicle.parameters.files
        for path in (GENERAL, PARAMETERS):
            assert bytes(client.read(path, len(told[path]))) == told[path]
        listing = client.cmd_list(["/"]).directory_listing
        sizes = {entry.name: entry.size_b for entry in listing}
        assert sizes == {path[1:]: len(data) for path, data in told.items()}


def exchange(message, codec=None):
    """What answers a station's message, as raw frames."""
    codec, station = codec or Codec(SYSTEM), mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    budgets = SendBudgets(codec, None)
    budgets.begin(Parameters(MISSION, None))
    (frame,) = codec.feed(message.pack(station), 1.0)
    return budgets.answer(frame, 1.5)


def test_the_message_is_packed_as_its_definition_says():
    fields = (("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0), ("char", "uri", 100))
    extra = x25crc()
    extra.accumulate_str("COMPONENT_METADATA ")
    for kind, name, length in fields:
        extra.accumulate_str(f"{kind} {name} ")
        if length:
            extra.accumulate([length])
    asked = mavlink.MAVLink_command_long_message(SYSTEM, COMPONENT, 512, 0, 397.0, *[0.0] * 6)
    said = exchange(asked)
    accepted = raw_frame(said[: 12 + said[1]])
    assert (accepted.message_id, accepted.payload[:2]) == (77, (512).to_bytes(2, "little"))
    raw = said[12 + said[1] :]
    frame = raw_frame(raw)
    assert (frame.system_id, frame.component_id, frame.message_id) == (SYSTEM, COMPONENT, 397)
    time_ms, crc, uri = struct.unpack("<II100s", frame.payload.ljust(108, b"\0"))
    general = Parameters(MISSION, None).files[GENERAL]
    assert (time_ms, uri.rstrip(b"\0")) == (1500, b"mftp:///general.json")
    assert crc == plain_crc(general)
    check = x25crc(raw[1:-2])
    check.accumulate(bytes(((extra.crc & 0xFF) ^ (extra.crc >> 8),)))
    assert check.crc == int.from_bytes(raw[-2:], "little")


def plain_crc(data):
    """CRC-32 bit by bit, begun at 0 and not inverted."""
    value = 0
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xEDB88320 if value & 1 else 0)
    return value


def test_it_goes_out_signed_where_there_is_a_key():
    signer = signer_of(b"k" * 32, 1, Timestamps(None, lambda: 1.8e9))
    codec = Codec(SYSTEM, signer=signer)
    data = codec.signed(codec.component_metadata(0.0, 1, "mftp:///general.json"))
    assert (data[2], len(data)) == (1, 10 + 28 + 2 + 13)
    assert Codec.unsigned(data) == Codec(SYSTEM).component_metadata(0.0, 1, "mftp:///general.json")


def test_what_is_told_is_what_is_allowed():
    told = Parameters(MISSION, None).files
    general = json.loads(told[GENERAL])
    assert general["metadataTypes"] == [
        {"type": 1, "uri": f"mftp://{PARAMETERS}", "fileCrc": plain_crc(told[PARAMETERS])}
    ]
    document = json.loads(told[PARAMETERS])
    assert document.keys() == {"version", "uid", "scope", "parameters"}
    entries = {entry["name"]: entry for entry in document["parameters"]}
    assert list(entries) == [entry.name for entry in TABLE]
    ranges = {name: (entry["min"], entry["max"], entry.get("units", "")) for name, entry in entries.items()}
    assert ranges == {
        "SRRT_ENABLE": (0, 1, ""),
        "SRRT_HORIZON": (0.1, 86400.0, "s"),
        "SRRT_SWAP_GAIN": (0.0, 1.0, ""),
        "SRRT_SWAP_MARG": (0.0, 600.0, "s"),
        "SRRT_THREAT_MAX": (0.01, 1.0, ""),
    }
    values = Parameters(MISSION, None)
    for name, entry in entries.items():
        assert entry["default"] == values.value(name)
        assert entry["min"] <= entry["default"] <= entry["max"]
        assert entry["shortDesc"]
        assert entry["longDesc"]
        assert entry["type"] == "Float"
        assert 0 < entry["increment"] <= entry["max"] - entry["min"]
        assert round(entry["increment"], entry["decimalPlaces"]) == entry["increment"]


def test_a_value_that_is_set_is_no_new_default():
    values = Parameters(MISSION, None)
    before = values.files
    assert values.set("SRRT_HORIZON", 30.0, (255, 190)) == ""
    assert values.files == before


@pytest.fixture
def sdk():
    """MAVSDK as a ground station, at a UDP port, and the vehicle that it finds there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    client = Mavsdk(Configuration.create_manual(255, 190, True))
    client.add_any_connection(f"udpin://127.0.0.1:{port}")
    with Vehicle(("127.0.0.1", port)):
        yield client
    client.destroy()


def test_mavsdk_lists_our_parameters_with_their_metadata(sdk):
    system, found = sdk.first_autopilot(10.0), threading.Event()
    plugin, told = ComponentMetadata(system), []

    def take(update, _):
        if update.compid == COMPONENT and update.type == MetadataType.PARAMETER:
            told.append(update.json_metadata)
            found.set()

    plugin.subscribe_metadata_available(take)
    plugin.request_component(COMPONENT)
    assert found.wait(20.0)
    entries = {entry["name"]: entry for entry in json.loads(told[0])["parameters"]}
    assert list(entries) == [entry.name for entry in TABLE]
    assert entries["SRRT_HORIZON"]["units"] == "s"
    plugin.destroy()


def test_mavsdk_agrees_with_our_checksum(sdk, tmp_path):
    plugin = Ftp(sdk.first_autopilot(10.0))
    plugin.set_target_compid(COMPONENT)
    same, other = tmp_path / "same.json", tmp_path / "other.json"
    data = Parameters(MISSION, None).files[PARAMETERS]
    same.write_bytes(data)
    other.write_bytes(data[:-1])
    assert plugin.are_files_identical(str(same), PARAMETERS)
    assert not plugin.are_files_identical(str(other), PARAMETERS)
    plugin.destroy()
