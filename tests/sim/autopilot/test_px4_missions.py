"""One test for each peculiarity of how PX4 flies and replaces missions (measured on 1.17-dev)."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.flight_modes import flight_mode
from companion.types.events import Dialect
from sim.autopilot.px4.px4 import MODES
from tests.sim.autopilot.px4_client import (
    ACCEPTED,
    AHEAD,
    LAND_START,
    NAN,
    SECOND,
    THIRD,
    Px4Client,
    landing,
    px4_route,
)
from tests.sim.client import SPEED, Client, item

SET_MODE = mavlink.MAV_CMD_DO_SET_MODE
LEFT, FAR_LEFT = (600.0, 400.0), (900.0, 500.0)


CLIENT = Px4Client


def state(client):
    return client.told()[0].mission_state


# --- the index after an upload


def test_the_marked_item_is_flown_to_at_once_and_directly(flying):
    flying.step(8.0)
    assert flying.upload(px4_route(LEFT, FAR_LEFT, THIRD, current=2)) == ACCEPTED
    assert flying.steers_to(*FAR_LEFT)
    leg = flying.autopilot.flight.steering
    assert math.dist(leg.start, flying.autopilot.flight.position) < 15.0


def test_without_a_flag_the_old_index_is_kept(flying):
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 3))
    assert flying.upload(px4_route(LEFT, FAR_LEFT, SECOND)) == ACCEPTED
    assert flying.autopilot.current_sequence == 3
    assert flying.steers_to(*SECOND)


def test_without_a_flag_a_shorter_list_is_clamped_to_its_landing(flying):
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 5))
    assert flying.upload(px4_route(LEFT)) == ACCEPTED
    assert flying.autopilot.current_sequence == 4
    assert flying.autopilot.mission_items[4].command == 21
    flying.step(0.2)
    assert flying.steers_to(0.0, 0.0)


def test_of_several_flags_the_last_wins(flying):
    items = px4_route(LEFT, FAR_LEFT, SECOND, current=1)
    items[3] |= {"current": 1}
    flying.upload(items)
    assert flying.autopilot.current_sequence == 3


def test_a_takeoff_marked_in_the_air_is_skipped(flying):
    flying.upload(px4_route(LEFT, FAR_LEFT, current=0))
    flying.step(0.1)
    assert flying.autopilot.current_sequence == 1


def test_an_identical_upload_does_nothing_and_its_flag_is_ignored(flying):
    flying.upload(px4_route(LEFT, FAR_LEFT, SECOND, current=1))
    first = flying.opaque_id()
    flying.step(3.0)
    leg = flying.autopilot.flight.steering
    assert flying.upload(px4_route(LEFT, FAR_LEFT, SECOND, current=3)) == ACCEPTED
    assert flying.opaque_id() == first
    assert flying.autopilot.current_sequence == 1
    assert flying.autopilot.flight.steering is leg


def test_set_current_moves_the_index_without_an_acknowledgement(flying):
    flying.clear()
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 3))
    flying.poll()
    assert not flying.all("MISSION_CURRENT")
    assert not flying.all("MISSION_ACK")
    assert flying.steers_to(*THIRD)
    assert flying.wait("MISSION_CURRENT", 1.1, seq=3) is not None


def test_set_current_out_of_range_changes_nothing(flying):
    flying.send(mavlink.MAVLink_mission_set_current_message(1, 1, 7))
    assert flying.steers_to(*AHEAD)


def test_the_command_form_of_set_current_is_unsupported(flying):
    assert flying.set_current(2) == mavlink.MAV_RESULT_UNSUPPORTED
    assert flying.steers_to(*AHEAD)


def test_mission_current_comes_once_a_second_whatever_rate_is_asked(flying):
    assert flying.stream(42, 10.0) == mavlink.MAV_RESULT_FAILED
    flying.clear()
    flying.step(5.0)
    assert len(flying.all("MISSION_CURRENT")) == pytest.approx(5, abs=1)


def test_reaching_an_item_is_told_at_once(flying):
    flying.until(lambda: flying.autopilot.current_sequence == 2, 60.0)
    stamp = flying.simulator.now_s
    told = [at for at, m in flying.log if m.get_type() == "MISSION_CURRENT" and m.seq == 2]
    assert told[0] == pytest.approx(stamp, abs=0.05)


def test_mission_start_sets_the_index_enters_the_mode_and_is_told_at_once(flying):
    flying.simulator.set_mode("LOITER")
    flying.clear()
    assert flying.command(mavlink.MAV_CMD_MISSION_START, 2) == ACCEPTED
    assert flying.autopilot.mode == "MISSION"
    assert [m.seq for m in flying.all("MISSION_CURRENT")][:1] == [2]
    assert flying.command(mavlink.MAV_CMD_MISSION_START, 99) == mavlink.MAV_RESULT_DENIED


# --- what cannot be flown


@pytest.mark.parametrize("tail", [[], [item(LAND_START, 0.0, 0.0, 0.0, frame=2) | {"is_bare": True}]])
def test_accepted_does_not_mean_flyable(flying, tail):
    assert flying.upload(px4_route(LEFT, FAR_LEFT, current=1, tail=tail)) == ACCEPTED
    bad = flying.opaque_id()
    flying.step(0.2)
    assert flying.autopilot.mode == "LOITER"
    message, identity = flying.told()
    assert (message.mission_state, identity) == (1, bad)
    # A good one afterwards is not flown by itself.
    assert flying.upload(px4_route(LEFT, FAR_LEFT, current=1)) == ACCEPTED
    flying.step(1.0)
    assert flying.autopilot.mode == "LOITER"
    flying.command(SET_MODE, 1, 4, 4)
    assert flying.autopilot.mode == "MISSION"
    assert flying.steers_to(*LEFT)


def test_without_the_requirement_no_landing_is_needed(flying):
    flying.autopilot.parameters["MIS_TKO_LAND_REQ"] = 0
    flying.upload(px4_route(LEFT, FAR_LEFT, current=1, tail=[]))
    flying.step(1.0)
    assert flying.autopilot.mode == "MISSION"


def test_without_a_takeoff_but_with_a_landing_it_is_flown(flying):
    items = px4_route(LEFT, FAR_LEFT)[1:]
    items[0] |= {"current": 1}
    assert flying.upload(items) == ACCEPTED
    flying.step(1.0)
    assert flying.autopilot.mode == "MISSION"
    assert flying.steers_to(*LEFT)


def test_too_steep_an_approach_is_not_flown(flying):
    steep = [item(16, 0.0, 300.0, 60.0, frame=6, p4=NAN), item(21, 0.0, 0.0, 0.0, frame=6, p4=NAN)]
    flying.upload(px4_route(LEFT, current=1, tail=steep))  # 60 m over 300 m, 11 degrees
    flying.step(0.2)
    assert flying.autopilot.mode == "LOITER"


@pytest.mark.parametrize(("wait_s", "mode"), [(0.02, "LOITER"), (0.1, "MISSION")])
def test_the_mission_mode_right_after_an_upload_races_the_check(flying, wait_s, mode):
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    flying.step(1.0)
    assert flying.upload(px4_route(LEFT, current=1)) == ACCEPTED
    flying.step(wait_s)
    assert flying.command(SET_MODE, 1, 4, 4) == ACCEPTED
    flying.step(0.5)
    assert flying.autopilot.mode == mode


def test_clear_all_in_flight_is_taken_and_holds(flying):
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    assert flying.wait("MISSION_ACK").type == ACCEPTED
    assert flying.autopilot.mode == "LOITER"
    message, identity = flying.told()
    assert (message.seq, message.total, message.mission_state, identity) == (0, 65535, 1, 0)


def test_a_new_mission_in_hold_is_resumed_at_its_mark(flying):
    flying.simulator.set_mode("LOITER")
    flying.upload(px4_route(LEFT, FAR_LEFT, current=2))
    flying.step(0.5)
    assert (flying.autopilot.mode, state(flying)) == ("LOITER", 2)
    flying.simulator.set_mode("MISSION")
    assert flying.steers_to(*FAR_LEFT)
    assert state(flying) == 3


# --- the end


@pytest.fixture
def finished(client):
    """Arrived at the end of a mission that needs no landing, 300 m ahead."""
    client.autopilot.parameters["MIS_TKO_LAND_REQ"] = 0
    client.upload(px4_route((300.0, 0.0), current=1, tail=[]))
    assert client.until(lambda: client.autopilot.mode == "LOITER", 60.0)
    return client


def test_the_end_changes_the_mode_by_itself_and_circles_the_last_waypoint(finished):
    assert state(finished) == 5
    circle = finished.autopilot.flight.steering
    assert math.dist(circle.centre, (300.0, 0.0)) < 1.0
    assert circle.radius_m == finished.autopilot.parameters["NAV_LOITER_RAD"]


def test_after_the_end_a_new_mission_is_stored_and_not_flown(finished):
    assert finished.upload(px4_route(LEFT, FAR_LEFT, current=2, tail=[])) == ACCEPTED
    finished.step(1.0)
    assert (finished.autopilot.mode, state(finished)) == ("LOITER", 5)
    finished.command(SET_MODE, 1, 4, 4)
    assert finished.autopilot.mode == "MISSION"
    assert finished.steers_to(*FAR_LEFT)


# --- items on the way


def test_reached_is_repeated_ten_times_and_forgotten_at_a_count(flying):
    flying.until(lambda: bool(flying.all("MISSION_ITEM_REACHED")), 60.0)
    flying.step(12.0)
    assert [m.seq for m in flying.all("MISSION_ITEM_REACHED")] == [1] * 11
    flying.until(lambda: flying.autopilot.current_sequence == 3, 60.0)
    flying.step(1.5)
    flying.clear()
    flying.count(4)
    flying.step(3.0)
    assert not flying.all("MISSION_ITEM_REACHED")


def test_of_a_waypoint_right_before_a_do_item_nothing_is_told(client):
    items = px4_route((300.0, 0.0), SECOND, current=1)
    items.insert(2, item(SPEED, 0.0, 0.0, 0.0, frame=2, p2=30.0, p3=-1.0) | {"is_bare": True})
    client.upload(items)
    assert client.until(lambda: client.autopilot.current_sequence == 3, 60.0)
    client.step(3.0)
    assert not client.all("MISSION_ITEM_REACHED")
    assert client.autopilot.flight.airspeed_m_s == 30.0


def test_an_items_own_acceptance_radius_is_for_copters(flying):
    items = px4_route(AHEAD, SECOND, current=1)
    items[1] |= {"p2": 200.0}
    flying.upload(items)
    flying.until(lambda: flying.autopilot.current_sequence == 2, 60.0)
    assert math.dist(flying.autopilot.flight.position, AHEAD) < 12.0


# --- modes, texts, traffic


def test_custom_modes_are_those_that_the_companion_knows():
    for name, number in MODES.items():
        told, is_mission = flight_mode(Dialect.PX4, 1, 1, number)
        assert (told, is_mission) == (name, name == "MISSION")
    assert MODES["MISSION"] == (4 << 24) | (4 << 16)


def test_do_set_mode_is_acknowledged_twice(flying):
    assert flying.command(SET_MODE, 1, 4, 3) == ACCEPTED
    flying.step(0.1)
    assert len(flying.all("COMMAND_ACK")) == 2
    assert flying.autopilot.mode == "LOITER"
    beat = flying.wait("HEARTBEAT", 2.0, autopilot=mavlink.MAV_AUTOPILOT_PX4)
    assert beat.custom_mode == MODES["LOITER"]


def test_texts_go_only_where_a_ground_station_was_heard(flying):
    station = Px4Client.on_new_channel(flying.simulator, 255, 190)
    station.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
    flying.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_ONBOARD_CONTROLLER, 8, 0, 0, 4, 3))
    flying.clear()
    flying.send(mavlink.MAVLink_mission_clear_all_message(1, 1, 0))
    flying.step(0.5)
    station.poll()
    assert "No valid mission available, loitering" in station.texts()
    assert flying.texts() == []


def test_adsb_vehicle_comes_back_under_the_vehicles_own_ids(flying):
    other = Client.on_new_channel(flying.simulator, 255, 190)
    other.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    report = mavlink.MAVLink_adsb_vehicle_message(
        0xABCD, -353_632_610, 1_491_652_300, 1, 600_000, 9000, 1000, 0, b"GROUND", 18, 1, 0xFFFF, 0
    )
    flying.send(report)
    flying.poll()
    other.poll()
    (echo,) = flying.all("ADSB_VEHICLE")
    assert (echo.get_srcSystem(), echo.get_srcComponent(), echo.flags) == (1, 1, 63)
    sources = {(m.get_srcSystem(), m.get_srcComponent()) for m in other.all("ADSB_VEHICLE")}
    assert sources == {(1, 195), (1, 1)}


def test_whole_numbers_of_parameters_are_sent_as_they_lie_in_memory(client):
    client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"MIS_TKO_LAND_REQ", -1))
    message = client.wait("PARAM_VALUE")
    assert message.param_type == mavlink.MAV_PARAM_TYPE_INT32
    assert message.param_value == pytest.approx(2.802596928649634e-45, rel=1e-6)
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"MIS_TKO_LAND_REQ", 0.0, 6))
    client.step()
    assert client.autopilot.parameters["MIS_TKO_LAND_REQ"] == 0.0


def test_after_a_reboot_it_holds_with_its_mission(flying):
    items = flying.autopilot.mission_items
    flying.simulator.reboot()
    flying.step(1.0)
    assert flying.autopilot.mode == "LOITER"
    assert flying.autopilot.mission_items == items


# --- the circle before a landing


@pytest.mark.parametrize("asks_for_course", [1.0, 0.0])
def test_a_circle_to_a_height_is_left_at_once_or_on_the_course_to_the_landing(client, asks_for_course):
    pattern, land = landing()[1:]
    tail = [landing()[0], pattern | {"p1": asks_for_course}, land]
    assert client.upload(px4_route(AHEAD, tail=tail, current=3)) == ACCEPTED
    assert client.until(lambda: client.autopilot.current_sequence == 4, 120.0)
    flight = client.autopilot.flight
    east, north = flight.position
    off = abs(math.remainder(flight.estimate.course_rad - math.atan2(-east, -north), 2.0 * math.pi))
    assert flight.estimate.up_m == pytest.approx(60.0, abs=5.0)
    assert (off < math.radians(11.0)) is bool(asks_for_course)
