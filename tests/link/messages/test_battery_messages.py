"""What the battery's monitor tells, by pymavlink's own encoder, and what is no battery."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.streams import Streams
from companion.types.events import BatteryReported
from companion.types.mavlink_enums import MessageId
from tests.link.pymavlink_frames import heartbeat, packed

NONE = 65_535


def started():
    codec = Codec(1)
    codec.feed(heartbeat(), 0.0)
    codec.counters.clear()
    return codec


def battery(charge=1_000, energy=720, percent=80, cells=(22_200,), number=0, function=0, more=(0,) * 4):
    voltages = [*cells, *[NONE] * (10 - len(cells))]
    return packed(
        mavlink.MAVLink_battery_status_message(
            number, function, 1, 32_767, voltages, 1_000, charge, energy, percent, 0, 0, list(more)
        )
    )


def status(millivolts=22_200, percent=80):
    return packed(mavlink.MAVLink_sys_status_message(0, 0, 0, 250, millivolts, 0, percent, 0, 0, 0, 0, 0, 0))


def reports(codec, data, stamp_s=10.0):
    return [event for frame in codec.feed(data, stamp_s) for event in frame.events]


def test_arduplanes_energy_is_taken_in_hectojoules():
    (told,) = reports(started(), battery())
    assert told == BatteryReported(10.0, 0.8, pytest.approx(20.0), pytest.approx(22.2))


def test_cells_are_added_with_those_beyond_the_tenth():
    (told,) = reports(started(), battery(cells=(3_700,) * 10, more=(3_700, 3_700, 0, 0)))
    assert told.voltage_v == pytest.approx(12 * 3.7)


def test_px4s_charge_is_multiplied_by_the_voltage_at_which_it_flows():
    codec, energies = started(), []
    for charge, millivolts in ((0, 25_000), (1_000, 24_000), (2_000, 20_000)):
        (told,) = reports(codec, battery(charge, -1, cells=(millivolts,)))
        energies.append(told.consumed_wh)
    assert energies == pytest.approx([0.0, 24.0, 44.0])
    (told,) = reports(codec, battery(100, -1, cells=(25_000,)))
    assert told.consumed_wh == pytest.approx(2.5)  # The monitor was restarted.


def test_sys_status_tells_share_and_voltage():
    assert reports(started(), status()) == [BatteryReported(10.0, 0.8, None, pytest.approx(22.2))]


@pytest.mark.parametrize(
    "data",
    [
        battery(number=1),
        battery(function=3),
        battery(function=4),
        battery(-1, -1, -1, ()),
        status(NONE, -1),
        status(0, -1),
    ],
    ids=["the second", "avionics", "payload", "nothing known", "no monitor", "no voltage"],
)
def test_what_is_no_battery_of_ours_tells_nothing(data):
    codec = started()
    assert reports(codec, data) == []
    assert set(codec.counters) == {"accepted"}


@pytest.mark.parametrize(
    "data",
    [
        battery(percent=101),
        battery(percent=-2),
        battery(cells=(65_000,) * 10, more=(65_000,) * 4) + battery(charge=2**31 - 1, energy=-1),
        status(percent=120),
        status(percent=-100),
    ],
)
def test_bad_values_are_dropped_and_counted(data):
    codec = started()
    assert [event for event in reports(codec, data) if event.voltage_v is None] == []
    assert codec.counters["refused_battery"] == 1


@pytest.mark.parametrize("charge", [-1, -50])
def test_a_charge_below_zero_is_not_known(charge):
    """PX4 without a current sensor integrates -1 A: tests/data/px4-1.17dev-replace.tlog ends at -50 mAh."""
    (told,) = reports(started(), battery(charge, -1))
    assert (told.remaining, told.consumed_wh) == (0.8, None)


def test_only_the_vehicles_autopilot_has_our_battery():
    other = packed(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 9_000, 0, 5, 0, 0, 0, 0, 0, 0), system=9)
    assert reports(started(), other) == []


@example(charge=0, energy=36_000_001, percent=0, cells=[], number=0, function=0, millivolts=0)
@given(
    charge=st.integers(-(2**31), 2**31 - 1), energy=st.integers(-(2**31), 2**31 - 1),
    percent=st.integers(-128, 127), cells=st.lists(st.integers(0, NONE), max_size=10),
    number=st.integers(0, 255), function=st.integers(0, 255), millivolts=st.integers(0, NONE),
)  # fmt: skip
def test_whatever_is_told_is_possible_or_refused(
    charge, energy, percent, cells, number, function, millivolts
):
    codec = started()
    data = battery(charge, energy, percent, tuple(cells), number, function) + status(millivolts, percent)
    for told in reports(codec, data):
        assert told.remaining is None or 0.0 <= told.remaining <= 1.0
        assert told.consumed_wh is None or 0.0 <= told.consumed_wh <= 1e6
        assert told.voltage_v is None or 0.0 < told.voltage_v <= 1_000.0


def test_the_messages_are_asked_for_every_two_seconds_and_only_if_wanted():
    codec = started()
    for wanted in (True, False):
        streams = Streams(10.0, with_battery=wanted)
        for frame in codec.feed(heartbeat(), 0.0):
            streams.note(frame, 0.0)
        messages = mavlink.MAVLink(None).parse_buffer(streams.due(codec, 0.0))
        asked = {int(message.param1): message.param2 for message in messages if hasattr(message, "param2")}
        for number in (MessageId.BATTERY_STATUS, MessageId.SYS_STATUS):
            assert asked.get(number) == (2e6 if wanted else None)
