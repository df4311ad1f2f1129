"""How ArduPlane flies items, and its modes, commands and links, as measured on the real one (4.7-dev)."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.sim.client import (
    ACCEPTED,
    AHEAD,
    ERROR,
    JUMP,
    LAND_START,
    LOITER,
    RTL,
    SPEED,
    TIME,
    TURNS,
    WAYPOINT,
    Client,
    autopilot,
    item,
    route,
)

# --- flying items


@pytest.mark.parametrize(
    ("turn_deg", "before_m"),
    [(30.0, 16.0), (45.0, 25.0), (90.0, 50.0), (135.0, 50.0), (10.0, 4.0), (0.0, 0.0)],
)
def test_a_waypoint_is_reached_the_earlier_the_more_it_turns_there(client, turn_deg, before_m):
    """ArduPlane 4.8-dev, seen every 1.5 m: 25 m before turns by 45 degrees, 16 m by 30, 0 to 2 m by none."""
    turn = math.radians(turn_deg)
    after = item(WAYPOINT, 800.0 + 900.0 * math.cos(turn), 900.0 * math.sin(turn))
    client.upload([item(WAYPOINT, 0.0, 0.0), item(WAYPOINT, 800.0, 0.0), after])
    client.set_current(1)
    assert client.wait("MISSION_ITEM_REACHED", 60.0).seq == 1
    assert math.dist(autopilot(client).flight.position, (800.0, 0.0)) == pytest.approx(before_m, abs=4.0)


def test_a_waypoint_that_is_abeam_when_it_comes_next_is_flown_to_from_there(client):
    """The first is reached 50 m before it; the second lies 30 m before the first (``Plane::set_next_WP``)."""
    places = ((0.0, 0.0), (800.0, 0.0), (770.0, 0.0), (1500.0, 0.0))
    client.upload([item(WAYPOINT, *place) for place in places])
    client.set_current(1)
    for sequence, east_m in ((2, 750.0), (3, 770.0)):
        assert client.until(lambda wanted=sequence: autopilot(client).current_sequence == wanted, 60.0)
        assert autopilot(client).flight.position[0] == pytest.approx(east_m, abs=5.0)


def test_reached_is_a_single_slot_that_a_do_item_takes_over(client):
    items = [*route((200.0, 0.0)), item(SPEED, 0.0, 0.0, 0.0, p2=30.0), item(WAYPOINT, 900.0, 0.0)]
    client.upload(items)
    client.set_current(1)
    assert client.wait("MISSION_ITEM_REACHED", 20.0).seq == 2
    assert autopilot(client).current_sequence == 3
    client.step(15.0)
    client.clear()
    assert client.wait("VFR_HUD", 2.0).airspeed == pytest.approx(30.0, abs=1.5)


def test_jumps_are_counted_and_land_start_is_skipped(client):
    items = [*route((250.0, 0.0), (250.0, 300.0)), item(LAND_START, 0, 0), item(JUMP, 0, 0, p1=1.0, p2=1.0)]
    items.append(item(LOITER, 0.0, 300.0, p3=-100.0))
    client.upload(items)
    client.set_current(1)
    seen = []

    def is_loitering():
        if not seen or seen[-1] != autopilot(client).current_sequence:
            seen.append(autopilot(client).current_sequence)
        return seen[-1] == 5

    assert client.until(is_loitering, 200.0)
    assert seen == [1, 2, 1, 2, 5]
    assert autopilot(client).flight.steering.direction == -1


def test_loiters_end_by_turns_and_by_time(client):
    items = [*route(), item(TURNS, 300.0, -125.0, p1=1.0, p3=125.0), item(TIME, 300.0, -125.0, p1=5.0)]
    items.append(item(LOITER, 0.0, 300.0))
    client.upload(items)
    client.set_current(1)
    assert client.until(lambda: autopilot(client).current_sequence == 2, 80.0)
    since = client.simulator.now_s
    assert since > 2 * math.pi * 125.0 / 26.0
    assert client.until(lambda: autopilot(client).current_sequence == 3, 20.0)
    assert client.simulator.now_s - since == pytest.approx(5.0, abs=1.0)


def test_a_loiter_never_ends(flying):
    flying.set_current(4)
    flying.step(120.0)
    assert autopilot(flying).mode == "AUTO"
    assert math.dist(autopilot(flying).flight.position, (2400.0, 0.0)) == pytest.approx(125.0, abs=12.0)


@pytest.mark.parametrize(
    ("slope_min_m", "options", "up_m"),
    [
        (15.0, 0.0, (110.0, 120.0, 120.0)),
        (0.0, 0.0, (110.0, 140.0, 100.0)),
        (41.0, 0.0, (110.0, 140.0, 100.0)),
        (40.0, 0.0, (110.0, 120.0, 120.0)),
        (15.0, 16_384.0, (110.0, 140.0, 120.0)),
    ],
)
def test_which_legs_are_slopes(client, slope_min_m, options, up_m):
    """Heights halfway along legs of 2 km to 110, 140 and 100 m, as flown by ArduPlane 4.8-dev."""
    parameters = autopilot(client).parameters
    parameters["ALT_SLOPE_MIN"], parameters["FLIGHT_OPTIONS"] = slope_min_m, options
    heights = (110.0, 100.0, 140.0, 100.0)
    client.upload([item(WAYPOINT, 2000.0 * n, 0.0, up) for n, up in enumerate((0.0, *heights))])
    client.set_current(1)
    for number, up in zip((1, 3, 4), up_m, strict=True):
        middle_m = 2000.0 * number - 1000.0
        assert client.until(lambda at=middle_m: autopilot(client).flight.position[0] > at, 200.0)
        assert autopilot(client).flight.estimate.up_m == pytest.approx(up, abs=3.0)


def test_a_loiter_to_height_ends_at_it(client):
    climb = item(31, 300.0, -125.0, 150.0, p2=125.0)
    client.upload([*route(), climb, item(LOITER, 0.0, 300.0, 150.0)])
    client.set_current(1)
    assert client.until(lambda: autopilot(client).current_sequence == 2, 90.0)
    assert autopilot(client).flight.estimate.up_m == pytest.approx(150.0, abs=6.0)


def course_off_rad(course_rad, position, place):
    """Angle between a course and the direction from a position to a place."""
    bearing = math.atan2(place[0] - position[0], place[1] - position[1])
    return abs(math.remainder(course_rad - bearing, 2.0 * math.pi))


@pytest.mark.parametrize("east_m", [-1500.0, 1500.0])
def test_a_loiter_to_height_is_left_on_the_course_to_the_next_item(client, east_m):
    place = (east_m, -125.0)
    client.upload([*route(), item(31, 300.0, -125.0, 140.0, p2=125.0), item(LOITER, *place, 150.0)])
    client.set_current(1)
    assert client.until(lambda: autopilot(client).current_sequence == 2, 120.0)
    flight = autopilot(client).flight
    assert course_off_rad(flight.estimate.course_rad, flight.position, place) < math.radians(11.0)


def test_an_rtl_item_changes_the_mode_and_flies_home(client):
    client.upload([*route((300.0, 0.0)), item(RTL, 0.0, 0.0)])
    client.set_current(1)
    assert client.until(lambda: autopilot(client).mode == "RTL", 30.0)
    client.step(60.0)
    assert math.hypot(*autopilot(client).flight.position) == pytest.approx(100.0, abs=15.0)


def test_a_target_left_behind_is_turned_back_to(client):
    client.upload(route((-800.0, 0.0)))
    client.set_current(1)
    client.step(20.0)
    assert autopilot(client).mode == "AUTO"
    assert client.until(lambda: autopilot(client).mode == "RTL", 60.0)
    assert "Reached waypoint #1" in " ".join(client.texts())


# --- commands and modes


def test_an_item_sent_as_guided_is_flown_in_guided_only(flying):
    message = flying.item_message(0, item(WAYPOINT, 300.0, 300.0))
    message.current = 2
    flying.send(message)
    assert flying.wait("MISSION_ACK").type == ERROR
    flying.simulator.set_mode("GUIDED")
    flying.send(message)
    assert flying.wait("MISSION_ACK").type == ACCEPTED
    assert flying.steers_to(300.0, 300.0)


def test_set_mode_by_message_and_what_is_no_mode(flying):
    flying.send(mavlink.MAVLink_set_mode_message(1, 1, 12))
    flying.step()
    assert autopilot(flying).mode == "LOITER"
    assert flying.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 99) == mavlink.MAV_RESULT_FAILED
    assert flying.command(mavlink.MAV_CMD_DO_SET_MODE, 0, 10) == mavlink.MAV_RESULT_UNSUPPORTED
    assert flying.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mavlink.MAV_RESULT_FAILED
    assert autopilot(flying).mode == "LOITER"


def test_rates_by_data_stream_as_older_ground_stations_ask(client):
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 5, 1))
    client.clear()
    client.step(2.0)
    assert len(client.all("ATTITUDE")) == pytest.approx(10, abs=1)
    assert client.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == ACCEPTED
    assert client.all("MESSAGE_INTERVAL")[-1].interval_us == 200_000
    client.send(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 5, 0))
    client.clear()
    client.step(2.0)
    assert not client.all("ATTITUDE")


def test_mission_start_takes_only_zeroes_and_pause_is_unsupported(flying):
    assert flying.command(mavlink.MAV_CMD_MISSION_START, 2, 3) == 2
    assert flying.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    assert flying.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == 3


def test_reposition_goes_to_guided_and_auto_resumes_the_same_item(flying):
    latitude, longitude = autopilot(flying).projection.degrees(300.0, 300.0)
    flying.send(
        mavlink.MAVLink_command_int_message(
            1, 1, 3, 192, 0, 0, -1, 1, 0, 0, round(latitude * 1e7), round(longitude * 1e7), 100.0
        )
    )
    assert flying.wait("COMMAND_ACK", command=192).result == ACCEPTED
    assert autopilot(flying).mode == "GUIDED"
    assert flying.wait("MISSION_ITEM_REACHED", 60.0).seq == 0
    flying.simulator.set_mode("AUTO")
    assert autopilot(flying).current_sequence == 1
    assert flying.steers_to(*AHEAD)


def test_change_speed_is_bounded_and_lasts_until_the_mode_changes(flying):
    assert flying.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 60.0) == 4
    assert flying.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 33.0) == ACCEPTED
    flying.step(0.1)
    assert autopilot(flying).flight.airspeed_m_s == 33.0
    flying.simulator.set_mode("LOITER")
    flying.step(0.1)
    assert autopilot(flying).flight.airspeed_m_s == 25.0


def test_estimator_status_is_a_message_it_does_not_have(client):
    assert client.stream(230, 1.0) == 2
    assert "No ap_message for mavlink id (230)" in client.texts()


def test_rates_are_per_link_and_in_simulated_time(client):
    other = Client.on_new_channel(client.simulator, 255, 190)
    assert client.stream(33, 10.0) == ACCEPTED
    client.clear()
    client.step(5.0)
    other.poll()
    assert len(client.all("GLOBAL_POSITION_INT")) == pytest.approx(50, abs=1)
    assert len(other.all("GLOBAL_POSITION_INT")) == pytest.approx(5, abs=2)


@pytest.mark.parametrize("mode", ["MANUAL", "CIRCLE", "FBWA", "RTL", "LOITER", "GUIDED"])
def test_modes_are_told_by_the_heartbeat(client, mode):
    number = {"MANUAL": 0, "CIRCLE": 1, "FBWA": 5, "RTL": 11, "LOITER": 12, "GUIDED": 15}[mode]
    assert client.command(mavlink.MAV_CMD_DO_SET_MODE, 1, number) == ACCEPTED
    beat = client.wait("HEARTBEAT", 2.0, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
    assert (beat.custom_mode, beat.type, beat.base_mode & 129) == (number, 1, 129)
    client.step(5.0)
    assert client.simulator.truth.path[-1][3] > 80.0


def test_parameters_are_listed_read_and_set(client):
    client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    client.step(1.0)
    listed = client.all("PARAM_VALUE")
    assert len(listed) == listed[0].param_count
    client.clear()
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"WP_RADIUS", 90.0, 4))
    assert client.wait("PARAM_VALUE", param_id="WP_RADIUS").param_value == 90.0
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"AIRSPEED_CRUISE", -1))
    assert client.wait("PARAM_VALUE", param_id="AIRSPEED_CRUISE").param_value == 25.0


def test_the_length_of_the_list_is_told_as_it_changes(flying):
    flying.upload(route(AHEAD))
    totals = [message for message in flying.all("PARAM_VALUE") if message.param_id == "MIS_TOTAL"]
    assert [(message.param_value, message.param_index) for message in totals] == [(2.0, 65535)]


def test_broadcasts_are_forwarded_between_links_with_their_own_ids(client):
    other = Client.on_new_channel(client.simulator, 255, 190)
    text = mavlink.MAVLink_statustext_message(6, b"from the companion")
    client.send(text)
    other.poll()
    assert "from the companion" not in other.texts()  # it has not been heard yet
    other.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    client.send(text)
    other.step()
    (message,) = [m for m in other.all("STATUSTEXT") if m.text == "from the companion"]
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 195)
    client.poll()
    assert "from the companion" not in client.texts()


def test_garbage_is_dropped_and_counted_and_split_frames_are_joined(client):
    good = mavlink.MAVLink_mission_request_list_message(1, 1, 0).pack(client.mav)
    for byte in b"\xfd\x00garbage" + good:
        client.simulator.receive(bytes([byte]))
    client.simulator.receive(good[:-1] + bytes([good[-1] ^ 1]))
    client.simulator.receive(good)
    assert client.wait("MISSION_COUNT", 0.5) is not None
    assert client.simulator.autopilot.channels[0].num_dropped > 0
