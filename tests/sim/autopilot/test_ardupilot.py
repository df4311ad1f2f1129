"""One test for each peculiarity of ArduPlane's missions measured on the real one (4.7-dev)."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sim.client import (
    ACCEPTED,
    AHEAD,
    CANCELLED,
    DENIED,
    ERROR,
    INVALID_SEQUENCE,
    LOITER,
    NO_SPACE,
    SPEED,
    TAKEOFF,
    TURNS,
    UNSUPPORTED,
    WAYPOINT,
    Client,
    autopilot,
    item,
    route,
)

# --- the protocol


def test_asks_with_mission_request_and_never_with_the_int_form(client):
    assert client.upload(route(AHEAD, (900.0, 0.0))) == ACCEPTED
    client.count(2)
    assert client.wait("MISSION_REQUEST", target_component=195) is not None
    assert not client.all("MISSION_REQUEST_INT")


def test_takes_about_20_ms_an_item(client):
    start = client.simulator.now_s
    assert client.upload(route(*((600.0 + 20.0 * n, 0.0) for n in range(49)))) == ACCEPTED
    assert client.simulator.now_s - start == pytest.approx(50 * 0.02, abs=0.05)


def test_the_next_request_comes_out_at_the_next_step(client):
    client.count(3)
    for sequence in range(3):
        client.clear()
        client.step(0.02)
        (request,) = client.all("MISSION_REQUEST")
        assert request.seq == sequence
        client.send(client.item_message(sequence, item(WAYPOINT, 600.0, 0.0)))
    assert client.wait("MISSION_ACK").type == ACCEPTED


def test_floating_point_items_are_taken_too(client):
    client.count(2)
    for sequence in range(2):
        client.wait("MISSION_REQUEST", seq=sequence)
        client.send(
            mavlink.MAVLink_mission_item_message(1, 1, sequence, 3, 16, 0, 1, 0, 0, 0, 0, -35.36, 149.17, 90)
        )
    assert client.wait("MISSION_ACK").type == ACCEPTED
    assert client.download()[1].x == pytest.approx(-353_600_000, abs=50)


def test_more_than_655_items_have_no_space(client):
    client.count(656)
    assert client.wait("MISSION_ACK").type == NO_SPACE


def test_item_0_is_the_home_slot_whatever_is_sent(client):
    assert client.upload([item(LOITER, 999.0, 999.0, 77.0), *route(AHEAD)[1:]]) == ACCEPTED
    home = client.download()[0]
    assert (home.command, home.frame, home.z) == (WAYPOINT, 0, 584.0)
    east, north = autopilot(client).projection.local(home.x * 1e-7, home.y * 1e-7)
    assert math.hypot(east, north) < 0.1


@pytest.mark.parametrize(
    ("sent", "stored"),
    [
        (
            {"command": WAYPOINT, "z": 80.127, "p1": 3.0, "p2": 37.5, "p4": math.nan},
            {"z": 80.12, "p1": 0, "p2": 37},
        ),
        ({"command": WAYPOINT, "z": 80.5}, {"z": 80.5}),
        ({"command": WAYPOINT, "z": 680.0, "frame": 5}, {"frame": 0}),
        ({"command": WAYPOINT, "z": 80.0, "frame": 6}, {"frame": 3}),
        ({"command": WAYPOINT, "z": 80.0, "frame": 11}, {"frame": 10}),
        ({"command": TAKEOFF, "z": 80.0, "p1": 12.5}, {"p1": 12}),
        ({"command": TURNS, "z": 80.0, "p1": 2.0, "p3": -123.4}, {"p1": 2, "p3": -123}),
        ({"command": SPEED, "z": 0.0, "p1": 0.0, "p2": 22.5}, {"p2": 22.5}),
    ],
)
def test_read_back_is_rounded(client, sent, stored):
    items = [*route(AHEAD), item(WAYPOINT, 700.0, 50.0) | sent]
    assert client.upload(items) == ACCEPTED
    message = client.download()[2]
    found = {"z": message.z, "frame": message.frame, "p1": message.param1, "p2": message.param2}
    found["p3"] = message.param3
    assert {key: found[key] for key in stored} == pytest.approx(stored, abs=1e-4)
    original = client.item_message(2, items[2])
    assert (message.x, message.y) == (original.x, original.y)
    assert (message.current, message.autocontinue, message.param4) == (0, 1, 0.0)


def test_mission_current_counts_without_home_and_has_no_id(flying):
    message = flying.wait("MISSION_CURRENT", 2.0)
    assert (message.seq, message.total, message.mission_state) == (1, 4, 3)
    flying.simulator.set_mode("LOITER")
    flying.clear()
    assert flying.wait("MISSION_CURRENT", 2.0).mission_state == 2
    assert flying.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 42) == ACCEPTED


def test_another_system_as_target_is_ignored_any_component_is_taken(client):
    client.send(mavlink.MAVLink_mission_request_list_message(2, 1, 0))
    assert client.wait("MISSION_COUNT", 0.5) is None
    for system, component in [(1, 0), (0, 0), (1, 191)]:
        client.clear()
        client.send(mavlink.MAVLink_mission_request_list_message(system, component, 0))
        assert client.wait("MISSION_COUNT", 0.5) is not None


def test_silence_ends_an_upload_after_8_s_with_requests_every_second(client):
    client.upload(route(AHEAD, (900.0, 0.0), (1200.0, 0.0)), stop_at=2)
    client.clear()
    silent_s = client.simulator.now_s
    assert client.wait("MISSION_ACK", 10.0).type == CANCELLED
    assert client.simulator.now_s - silent_s == pytest.approx(8.0, abs=0.1)
    assert len(client.all("MISSION_REQUEST")) in (7, 8)
    assert "Mission upload timeout" in client.texts()


def test_a_wrong_sequence_is_refused_and_the_upload_stays_open(client):
    items = route(AHEAD, (900.0, 0.0))
    client.count(3)
    client.wait("MISSION_REQUEST", seq=0)
    client.send(client.item_message(2, items[2]))
    assert client.wait("MISSION_ACK").type == INVALID_SEQUENCE
    client.clear()
    assert client.wait("MISSION_REQUEST", 1.5, seq=0) is not None
    client.send(client.item_message(0, items[0]))
    assert client.answer(items) == ACCEPTED


def test_an_unsupported_command_ends_the_upload(client):
    assert client.upload([*route(AHEAD), item(31_999, 0.0, 0.0)]) == UNSUPPORTED
    client.clear()
    assert client.wait("MISSION_REQUEST", 2.0) is None


def test_not_a_number_is_refused_by_parameter(client):
    assert client.upload([*route(AHEAD), item(WAYPOINT, 0.0, 0.0, p2=math.nan)]) == 7
    assert client.upload([*route(AHEAD), item(WAYPOINT, 0.0, 0.0, math.nan)]) == 12


def test_another_uploader_is_denied_and_the_same_one_starts_afresh(client):
    other = Client.on_new_channel(client.simulator, 255, 190)
    items = route(AHEAD, (900.0, 0.0))
    client.upload(items, stop_at=1)
    other.count(5)
    assert other.wait("MISSION_ACK").type == DENIED
    other.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert other.wait("MISSION_ACK").type == DENIED
    assert client.upload(items) == ACCEPTED
    assert len(other.download()) == 3


def test_an_upload_is_not_atomic(flying):
    before = flying.download()
    items = route((610.0, 10.0), (620.0, 20.0), (630.0, 30.0), (640.0, 40.0))
    flying.upload(items, stop_at=2)
    assert flying.wait("MISSION_ACK", 10.0).type == CANCELLED
    after = flying.download()
    assert len(after) == 5
    new = flying.item_message(1, items[1])
    assert (after[1].x, after[1].y) == (new.x, new.y)
    assert [(i.x, i.y) for i in after[2:]] == [(i.x, i.y) for i in before[2:]]


def test_the_count_truncates_at_once(flying):
    flying.count(3)
    assert len(autopilot(flying).mission_items) == 3


def test_an_item_nobody_asked_for_is_an_error(client):
    client.send(client.item_message(1, item(WAYPOINT, 0.0, 0.0)))
    assert client.wait("MISSION_ACK").type == ERROR


def test_fences_and_rally_points_are_stored_and_other_kinds_refused(client):
    corners = [item(5002, east, north, 0.0, p1=3.0) for east, north in [(0, 0), (90, 0), (0, 90)]]
    assert client.upload(corners, kind=1) == ACCEPTED
    assert [i.command for i in client.download(1)] == [5002] * 3
    assert client.upload([item(5100, 50.0, 50.0)], kind=2) == ACCEPTED
    assert len(client.download(2)) == 1
    assert len(client.download()) == 3
    client.count(1, 7)
    assert client.wait("MISSION_ACK", mission_type=7).type == UNSUPPORTED


# --- replacing the mission in AUTO


def test_the_item_being_flown_is_cached_until_set_current(flying):
    items = route((600.0, 400.0), (900.0, 500.0), loiter=(900.0, 800.0))
    assert flying.upload(items) == ACCEPTED
    assert "Flight plan received" in flying.texts()
    flying.step(1.0)
    assert flying.steers_to(*AHEAD)
    assert autopilot(flying).current_sequence == 1
    assert flying.set_current(1) == ACCEPTED
    assert flying.steers_to(600.0, 400.0)


def test_on_arrival_at_the_old_target_the_new_next_item_is_flown(flying):
    assert flying.upload(route((600.0, 400.0), (900.0, 500.0), loiter=(900.0, 800.0))) == ACCEPTED
    assert flying.wait("MISSION_ITEM_REACHED", 40.0).seq == 1
    east, north = autopilot(flying).flight.position
    # WP_RADIUS at 684 m, 50 m / 0.936, by a turn of 26.57 of 90 degrees
    assert math.dist((east, north), AHEAD) == pytest.approx(15.8, abs=0.6)
    assert flying.steers_to(900.0, 500.0)


def test_a_mission_shorter_than_the_index_is_complete_on_arrival(flying):
    assert flying.set_current(3) == ACCEPTED
    assert flying.upload(route(AHEAD, (900.0, 0.0))) == ACCEPTED
    message = flying.wait("MISSION_CURRENT", 2.0)
    assert (message.seq, message.total) == (3, 2)
    assert flying.until(lambda: autopilot(flying).mode == "RTL", 90.0)
    assert any("Mission complete" in text for text in flying.texts())
    flying.clear()
    assert flying.wait("MISSION_CURRENT", 2.0).mission_state == 5
    flying.simulator.set_mode("AUTO")
    assert autopilot(flying).current_sequence == 1


def test_setting_auto_in_auto_does_nothing(flying):
    flying.upload(route((600.0, 400.0), (900.0, 500.0)))
    assert flying.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10) == ACCEPTED
    assert flying.steers_to(*AHEAD)


def test_set_current_flies_straight_from_here(flying):
    flying.step(8.0)
    assert flying.set_current(3) == ACCEPTED
    leg = autopilot(flying).flight.steering
    assert math.dist(leg.start, autopilot(flying).flight.position) < 5.0
    assert flying.steers_to(1800.0, 0.0)


@pytest.mark.parametrize("sequence", [99, -1, 5])
def test_set_current_out_of_range_is_denied(flying, sequence):
    assert flying.set_current(sequence) == mavlink.MAV_RESULT_DENIED
    assert flying.steers_to(*AHEAD)


def test_set_current_by_command_int(flying):
    flying.send(mavlink.MAVLink_command_int_message(1, 1, 0, 224, 0, 0, 2, 1, 0, 0, 0, 0, 0))
    assert flying.wait("COMMAND_ACK", command=224).result == ACCEPTED
    assert autopilot(flying).current_sequence == 2


def test_mission_set_current_answers_with_mission_current_or_not_at_all(flying):
    assert flying.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 42, -1) == ACCEPTED
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 2))
    assert flying.wait("MISSION_CURRENT").seq == 2
    flying.clear()
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 9))
    assert flying.wait("MISSION_CURRENT", 1.0) is None
    assert autopilot(flying).current_sequence == 2


def test_set_current_0_says_0_once_and_is_1_then(flying):
    flying.set_current(2)
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 0))
    assert flying.wait("MISSION_CURRENT").seq == 0
    flying.clear()
    assert flying.wait("MISSION_CURRENT", 2.0).seq == 1
    assert flying.steers_to(*AHEAD)


def test_outside_auto_set_current_only_moves_the_index(flying):
    flying.simulator.set_mode("LOITER")
    assert flying.set_current(3) == ACCEPTED
    assert autopilot(flying).mode == "LOITER"
    flying.simulator.set_mode("AUTO")
    assert flying.steers_to(1800.0, 0.0)


def test_loiter_and_auto_again_takes_the_new_item_at_the_same_index(flying):
    flying.upload(route((600.0, 400.0), (900.0, 500.0)))
    flying.simulator.set_mode("LOITER")
    flying.simulator.set_mode("AUTO")
    assert autopilot(flying).current_sequence == 1
    assert flying.steers_to(600.0, 400.0)


def test_mis_restart_starts_at_item_1(flying):
    flying.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_RESTART", 1.0, 2))
    flying.set_current(3)
    flying.simulator.set_mode("LOITER")
    flying.simulator.set_mode("AUTO")
    assert autopilot(flying).current_sequence == 1


def test_takeoff_above_its_height_is_done_at_once(client):
    items = [route(AHEAD)[0], item(TAKEOFF, 0.0, 0.0, 60.0), *route(AHEAD)[1:]]
    client.upload(items)
    client.set_current(1)
    client.step(0.3)
    assert autopilot(client).current_sequence == 2


def test_clear_all_is_refused_in_auto_and_taken_in_loiter(flying):
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert flying.wait("MISSION_ACK").type == ERROR
    assert len(autopilot(flying).mission_items) == 5
    flying.simulator.set_mode("LOITER")
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert flying.wait("MISSION_ACK").type == ACCEPTED
    assert not autopilot(flying).mission_items


def test_with_count_0_it_flies_on_past_the_old_target(flying):
    flying.count(0)
    flying.step(50.0)
    assert autopilot(flying).mode == "AUTO"
    assert autopilot(flying).flight.position[0] > AHEAD[0] + 400.0
    # The first item stored ends the mission.
    flying.upload(route(AHEAD, (900.0, 0.0)))
    assert autopilot(flying).mode == "RTL"


def test_with_count_0_and_the_target_still_ahead_an_upload_saves_the_flight(flying):
    flying.count(0)
    flying.step(2.0)
    assert flying.upload(route(AHEAD, (900.0, 300.0))) == ACCEPTED
    assert flying.until(lambda: autopilot(flying).current_sequence == 2, 40.0)
    assert autopilot(flying).mode == "AUTO"


def test_auto_without_a_mission_is_acknowledged_and_ends_in_rtl(flying):
    flying.simulator.set_mode("LOITER")
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert flying.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10) == ACCEPTED
    assert autopilot(flying).mode == "RTL"


def partial(client, first, last, items):
    client.clear()
    client.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, first, last, 0))
    return client.answer(items)


def test_a_partial_list_overwrites_in_place(flying):
    items = route((600.0, 77.0), (1200.0, 377.0))
    assert partial(flying, 1, 1, items) == ACCEPTED
    assert flying.steers_to(*AHEAD)
    flying.set_current(1)
    assert flying.steers_to(600.0, 77.0)
    assert len(autopilot(flying).mission_items) == 5


def test_a_second_partial_list_and_a_reading_are_denied_while_one_is_open(flying):
    """To whoever asks, the uploader too; the first goes on (4.6.3)."""
    flying.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 1, 0))
    flying.step(0.1)
    flying.clear()
    flying.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 1, 1, 0))
    flying.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    flying.step(0.1)
    assert [ack.type for ack in flying.all("MISSION_ACK")] == [DENIED, DENIED]


def test_a_partial_list_may_add_one_item_and_not_start_beyond_the_end(flying):
    items = [None] * 4 + [item(WAYPOINT, 2400.0, 50.0), item(LOITER, 2500.0, 0.0, p3=125.0)]
    assert partial(flying, 4, 5, items) == ACCEPTED
    assert len(autopilot(flying).mission_items) == 6
    flying.send(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 7, 8, 0))
    assert flying.wait("MISSION_ACK").type == ERROR
