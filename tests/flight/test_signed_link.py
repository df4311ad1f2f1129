"""The whole service over a signed link."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from companion.errors import ConfigError
from companion.flight.state.modes import Mode
from companion.link.messages.codec import signer_of
from companion.link.wire.framing import raw_frame
from companion.link.wire.signing import Timestamps
from companion.link.wire.tlog import read_tlog
from companion.service.process.signing_setup import signing_of
from companion.types.events import Dialect
from sim.threats.adsb_source import SOURCE_SYSTEM
from tests.support.sitl_harness import FIRST_FLIGHT, SitlHarness

KEY = bytes(range(32))
EPOCH_S = 1_790_000_000.0
TIME = int((EPOCH_S - 1_420_070_400) * 100_000)


def deck_with(our_key, dialect=Dialect.ARDUPILOT, folder=None):
    harness = SitlHarness(
        mission_from_text(FIRST_FLIGHT, "first-flight.yaml"), folder=folder, dialect=dialect
    )
    harness.simulator._channel.use_signing(KEY, 1, TIME)
    harness.signer = signer_of(our_key, 2, Timestamps(None, lambda: EPOCH_S), allow_unsigned=(SOURCE_SYSTEM,))
    return harness


@pytest.mark.parametrize("dialect", list(Dialect))
def test_missions_are_swapped_over_a_signed_link(dialect, tmp_path):
    harness = deck_with(KEY, dialect, tmp_path).fly(12.0)
    assert harness.app.num_swaps == 1
    assert harness.simulator._channel.num_dropped == 0
    assert harness.app.link.codec.counters["bad_signature"] == 0
    assert harness.app.link.codec.counters["allowed_unsigned"] > 10  # the source of tracks
    assert len(harness.app.world_model.tracker.tracks(12.0)) == 1
    entries = [entry.raw for entry in read_tlog(tmp_path / "flight.tlog")]
    ours = [raw for raw in entries if (raw[5], raw[6]) == (1, 195)]
    assert ours
    assert all(raw[2] & 1 for raw in ours)


def test_with_another_key_nobody_is_heard_and_nothing_is_done():
    harness = deck_with(bytes(32)).fly(6.0)
    assert harness.app.mode is Mode.WAITING
    assert harness.app.link.codec.counters["bad_signature"] > 50
    assert harness.changes() == []


def test_an_attacker_without_the_key_changes_nothing():
    """Heartbeats of another mode and a mission count, unsigned, from the autopilot's own ids."""
    harness = deck_with(KEY)
    writer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def attack(harness):
        for message in (
            mavlink.MAVLink_heartbeat_message(1, 3, 217, 12, 4, 3),
            mavlink.MAVLink_mission_current_message(99, 1, 3, 1),
            mavlink.MAVLink_statustext_message(6, b"Flight plan received"),
        ):
            harness.app.link.receive(bytes(message.pack(writer)))

    harness.fly(8.0, attack)
    assert harness.app.mode is Mode.ACTIVE
    assert harness.app.num_swaps == 1
    assert harness.app.link.codec.counters["unsigned"] > 1000


def test_keys_on_the_wire_are_not_recorded(tmp_path):
    harness = deck_with(KEY, folder=tmp_path)
    setup = mavlink.MAVLink_setup_signing_message(1, 195, list(b"\xa5" * 32), 0)

    def tell(harness):
        writer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        harness.app.link.receive(bytes(setup.pack(writer)))

    harness.fly(3.0, tell)
    assert harness.app.link.codec.counters["setup_signing"] > 100
    assert b"\xa5" * 8 not in (tmp_path / "flight.tlog").read_bytes()


def signing(tmp_path, more="", *, mode=0o600):
    key = tmp_path / "key"
    key.write_bytes(KEY)
    key.chmod(mode)
    return mission_from_text(
        FIRST_FLIGHT + f"link: {{signing: {{key_file: {key}, allow_unsigned: [200]{more}}}}}\n", "signed.yaml"
    )


def test_the_mission_file_names_the_key(tmp_path):
    timestamps, signer = signing_of(signing(tmp_path), None)
    assert signer is not None
    timestamps.next()
    assert (tmp_path / "key.times").stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("is_allowed", [True, False])
def test_the_mission_file_says_whether_mavlink_1_is_heard(tmp_path, is_allowed):
    mission = signing(tmp_path, f", allow_mavlink1: {str(is_allowed).lower()}" if is_allowed else "")
    _, signer = signing_of(mission, None)
    writer = mavlink.MAVLink(None, srcSystem=200, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(1, 8, 0, 0, 4, 3).pack(writer, force_mavlink1=True)
    assert signer.accepts(raw_frame(bytes(beat))) is is_allowed
    assert signer.counters["mavlink1"] == (not is_allowed)


def test_a_key_that_others_may_read_ends_the_start(tmp_path):
    with pytest.raises(ConfigError, match="key_file"):
        signing_of(signing(tmp_path, mode=0o644), None)


def test_without_a_key_nothing_is_signed():
    assert signing_of(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"), None) == (None, None)


@pytest.mark.parametrize(
    ("keys", "place"),
    [
        ("signing: {}", "link.signing.key_file"),
        ("signing: {key_file: a, link_id: 256}", "link.signing.link_id"),
        ("signing: {key_file: a, allow_unsigned: [0]}", "link.signing.allow_unsigned.0"),
        ("source_rate_max_hz: 0", "link.source_rate_max_hz"),
        ("systems: [256]", "link.systems.0"),
    ],
)
def test_wrong_keys_are_named(keys, place):
    with pytest.raises(ConfigError) as caught:
        mission_from_text(FIRST_FLIGHT + f"link: {{{keys}}}\n", "signed.yaml")
    assert caught.value.key == place
