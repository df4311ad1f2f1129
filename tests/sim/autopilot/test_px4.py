"""One test for each peculiarity of PX4's mission protocol measured on the real one (1.17-dev)."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.wire.tlog import read_tlog
from sim.autopilot.arduplane.arduplane_transfer import item_from_message
from sim.autopilot.px4.px4_store import mission_id
from tests.sim.autopilot.px4_client import (
    ACCEPTED,
    AHEAD,
    CANCELLED,
    ERROR,
    LAND_START,
    NAN,
    NO_SPACE,
    SECOND,
    THIRD,
    UNSUPPORTED,
    UNSUPPORTED_FRAME,
    Px4Client,
    extension_of,
    px4_route,
)
from tests.sim.client import SPEED, WAYPOINT, item

RECORDED = Path(__file__).parents[2] / "data" / "px4-1.17dev-replace.tlog"


CLIENT = Px4Client


def recorded_uploads():
    """Items and opaque id of every upload that the real one accepted."""
    parser, items = mavlink.MAVLink(None), []
    for entry in read_tlog(RECORDED):
        try:
            message = parser.decode(bytearray(entry.raw))
        except mavlink.MAVError:
            continue  # of a message younger than the dialect
        kind = message.get_type()
        if kind == "MISSION_COUNT":
            items = []
        elif kind == "MISSION_ITEM_INT":
            items.append(item_from_message(message))
        elif kind == "MISSION_ACK":
            yield items, extension_of(message, 4)


def test_a_missions_id_is_the_one_that_a_real_px4_gave_it():
    ids = [(mission_id(items), told) for items, told in recorded_uploads()]
    assert [given for given, _ in ids] == [told for _, told in ids]
    assert len(ids) == 3
    assert len({told for _, told in ids}) == 2  # the last upload was the one before with another flag


def test_asks_with_mission_request_int_at_once(client):
    client.count(3)
    client.poll()
    assert client.wait("MISSION_REQUEST_INT", 0.0, seq=0) is not None
    assert not client.all("MISSION_REQUEST")


def test_item_0_is_a_real_item(client):
    items = px4_route(AHEAD)
    assert client.upload(items) == ACCEPTED
    sent = client.item_message(0, items[0])
    read = client.download()[0]
    assert (read.command, read.x, read.y, read.z) == (22, sent.x, sent.y, 100.0)


def test_a_download_is_exact_but_for_the_frame(client):
    items = px4_route(AHEAD, current=1)
    items[1] |= {"frame": 3, "z": 80.127, "p2": 37.5}
    client.upload(items)
    client.step(0.2)
    read = client.download()
    assert read[1].frame == 6
    assert read[1].z == pytest.approx(80.127, abs=1e-4)
    assert read[1].param2 == 37.5
    assert math.isnan(read[1].param4)
    assert [message.current for message in read] == [0, 1, 0, 0, 0]
    assert read[2].frame == 2


def test_frames_3_and_6_give_different_ids_though_both_come_back_as_6(client):
    items, ids = px4_route(AHEAD), []
    for frame in (3, 6):
        items[1] |= {"frame": frame}
        client.upload(items)
        ids.append(client.opaque_id())
        client.step(0.2)
    assert len(set(ids)) == 2


def test_the_id_is_the_same_in_acknowledgement_mission_current_and_count(flying):
    assert flying.upload(px4_route(AHEAD, THIRD, current=1)) == ACCEPTED
    given = flying.opaque_id()
    flying.step(1.1)
    assert flying.told()[1] == given != 0
    flying.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert extension_of(flying.wait("MISSION_COUNT"), 5) == given


def test_errors_carry_no_id(flying):
    flying.upload([*px4_route(AHEAD), item(31_999, 0.0, 0.0)])
    assert flying.opaque_id() == 0


@pytest.mark.parametrize("stop_at", range(6))
def test_the_old_mission_flies_on_until_the_last_item_is_in(flying, stop_at):
    before = flying.autopilot.mission_items
    flying.upload(px4_route((600.0, 400.0), (900.0, 500.0), current=1), stop_at=stop_at)
    flying.step(0.5)
    assert flying.autopilot.mission_items == before
    assert flying.steers_to(*AHEAD)
    flying.step(5.0)
    assert flying.autopilot.mission_items == before


def test_an_upload_broken_off_is_asked_for_every_250_ms_and_given_up_after_5_s_without_a_word(flying):
    flying.upload(px4_route(AHEAD, SECOND), stop_at=3)
    flying.clear()
    flying.step(5.5)
    times = [stamp for stamp, m in flying.log if m.get_type() == "MISSION_REQUEST_INT"]
    assert len(times) == pytest.approx(19, abs=1)
    assert not flying.all("MISSION_ACK")
    assert flying.upload(px4_route(AHEAD, SECOND, current=1)) == ACCEPTED


def test_it_is_busy_for_5_s_after_a_broken_upload_and_each_new_count_restarts_them(flying):
    flying.upload(px4_route(AHEAD, SECOND), stop_at=3)
    for _ in range(3):
        flying.step(4.0)
        flying.clear()
        flying.count(4)
        assert flying.wait("MISSION_ACK").type == ERROR
    flying.step(5.1)
    assert flying.upload(px4_route(AHEAD, SECOND, current=1)) == ACCEPTED


def test_the_clients_cancellation_frees_it_at_once(flying):
    items = px4_route(AHEAD, SECOND, current=1)
    flying.upload(items, stop_at=3)
    flying.send(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))
    assert flying.upload(items) == ACCEPTED


def test_a_strangers_cancellation_frees_nothing(flying):
    other = Px4Client.on_new_channel(flying.simulator, 255, 190)
    flying.upload(px4_route(AHEAD, SECOND), stop_at=3)
    other.send(mavlink.MAVLink_mission_ack_message(1, 1, CANCELLED, 0))
    flying.count(4)
    assert flying.wait("MISSION_ACK").type == ERROR


def test_a_count_repeated_before_item_0_is_a_retry_whose_number_is_not_looked_at(flying):
    items = px4_route(AHEAD, SECOND, current=1)
    flying.count(len(items))
    flying.count(2)
    assert flying.answer(items) == ACCEPTED
    assert len(flying.autopilot.mission_items) == len(items)


def test_of_two_uploaders_the_first_wins(flying):
    other = Px4Client.on_new_channel(flying.simulator, 255, 190)
    items = px4_route(AHEAD, SECOND, current=1)
    flying.upload(items, stop_at=2)
    other.count(5)
    assert other.wait("MISSION_ACK").type == ERROR
    assert flying.answer(items) == ACCEPTED


def test_another_link_may_download_and_set_current_meanwhile(flying):
    other = Px4Client.on_new_channel(flying.simulator, 255, 190)
    flying.upload(px4_route((1.0, 1.0)), stop_at=2)
    assert len(other.download()) == len(flying.autopilot.mission_items)
    other.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    other.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert flying.autopilot.current_sequence == 2


def test_set_current_is_ignored_on_the_link_that_uploads(flying):
    flying.upload(px4_route((1.0, 1.0)), stop_at=2)
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert flying.autopilot.current_sequence == 1


def test_a_wrong_sequence_is_ignored(flying):
    items = px4_route(AHEAD, SECOND, current=1)
    flying.clear()
    flying.count(len(items))
    flying.send(flying.item_message(3, items[3]))
    flying.step(0.1)
    assert not flying.all("MISSION_ACK")
    assert flying.answer(items) == ACCEPTED


@pytest.mark.parametrize(
    ("entry", "verdict"),
    [
        (item(31_999, 0.0, 0.0, frame=6), UNSUPPORTED),
        (item(WAYPOINT, 0.0, 0.0, frame=99), UNSUPPORTED_FRAME),
        (item(LAND_START, 0.0, 0.0, frame=6), UNSUPPORTED),
        (item(SPEED, 0.0, 0.0, frame=3), UNSUPPORTED),
    ],
)
def test_refused_during_the_upload(flying, entry, verdict):
    before = flying.autopilot.mission_items
    items = px4_route(AHEAD, SECOND, current=1)
    assert flying.upload([*items[:2], entry, *items[2:]]) == verdict
    assert flying.autopilot.mission_items == before
    assert flying.steers_to(*AHEAD)


def test_neither_nan_nor_55_km_is_refused(flying):
    items = px4_route(AHEAD, (0.0, 55_000.0), current=1)
    items[1] |= {"z": NAN}
    assert flying.upload(items) == ACCEPTED
    flying.step(5.0)
    assert flying.autopilot.mode == "MISSION"
    assert math.isfinite(flying.autopilot.flight.estimate.up_m)


def test_more_than_10_000_items_have_no_space(client):
    client.count(10_001)
    assert client.wait("MISSION_ACK").type == NO_SPACE


@pytest.mark.parametrize(("component", "is_answered"), [(0, True), (1, True), (190, True), (195, False)])
def test_target_components(client, component, is_answered):
    client.send(mavlink.MAVLink_mission_request_list_message(1, component, 0))
    assert (client.wait("MISSION_COUNT", 0.5) is not None) is is_answered


def test_partial_lists_are_not_known(flying):
    flying.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 1, 0))
    flying.clear()
    flying.step(1.0)
    assert not flying.all("MISSION_REQUEST_INT")
    assert not flying.all("MISSION_ACK")


def test_fences_and_rally_points_have_lists_of_their_own(client):
    corners = [item(5002, e, n, 0.0, p1=3.0, frame=3) for e, n in [(0, 0), (90, 0), (0, 90)]]
    assert client.upload(corners, kind=1) == ACCEPTED
    assert [message.command for message in client.download(1)] == [5002] * 3
    assert len(client.download()) == 6
    client.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    client.count(1, 7)
    assert client.wait("MISSION_ACK", mission_type=7).type == UNSUPPORTED


def test_a_link_that_downloads_is_busy_until_it_acknowledges(flying):
    flying.download()
    flying.clear()
    flying.count(5)
    assert flying.wait("MISSION_ACK").type == ERROR
    flying.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
    assert flying.upload(px4_route(AHEAD, SECOND, current=1)) == ACCEPTED
