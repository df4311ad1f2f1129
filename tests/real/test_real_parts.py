"""What the flights beside real autopilots are made of, as far as it needs none."""

import random

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.config import mission_from_text
from tests.real.flights_pool import Binaries, all_wanted
from tests.real.held_missions import HeldMission
from tests.real.rig.autopilots import ARDUPLANE, KINDS
from tests.real.rig.course import CITY_FENCE, PAPER, Course
from tests.real.rig.relay import Framer
from tests.real.scenarios import SCENARIOS


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
@pytest.mark.parametrize("goal", ["near", "paper"])
def test_the_map_fits_the_aircraft(kind, goal):
    course = Course(kind.factor, goal, {"vehicle": kind.vehicle})
    mission = mission_from_text(course.text, "mission.yaml")
    paper = mission_from_text(PAPER.read_text(encoding="utf-8"), "paper-3d.yaml")
    assert mission.unit_m == pytest.approx(kind.factor * paper.unit_m)
    assert mission.obstacles[3].top_m == pytest.approx(kind.factor * paper.obstacles[3].top_m)
    masked_m = mission.radars[0].boundary_coefficient_per_m * (kind.factor * 500.0) ** 2
    assert masked_m == pytest.approx(kind.factor * paper.radars[0].boundary_coefficient_per_m * 500.0**2)
    assert mission.planning.time_horizon_s == paper.planning.time_horizon_s
    for way in ("straight", "hold", "leg"):
        course.check_departure(course.mission(way))


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.name)
def test_the_city_fits_the_aircraft(kind):
    course = Course(kind.factor, "city", {"vehicle": kind.vehicle})
    mission = mission_from_text(course.text, "mission.yaml")
    tower = next(entry for entry in mission.obstacles if entry.name == "tower_32")
    assert tower.top_m == pytest.approx(1.5 * kind.factor * 320.0)
    course.check_departure(course.mission())
    fence = course.local((*CITY_FENCE, 0.0))
    assert course.clearance_m((*fence[:2], 1.0)) >= course.factor * 100.0


def test_the_operators_goal_lies_in_the_mission_files():
    course = Course(0.5)
    goal = mission_from_text(course.text, "mission.yaml").goals[0]
    item = next(item for item in course.mission() if item.command == mavlink.MAV_CMD_NAV_WAYPOINT)
    assert course.local(item.place) == pytest.approx((goal.east_m, goal.north_m, goal.up_m))


def test_a_way_into_a_wall_is_refused():
    course = Course()
    items = course.mission("leg")
    items[2:2] = [type(items[1])(mavlink.MAV_CMD_NAV_WAYPOINT, place=(3000.0, 700.0, 150.0))]
    with pytest.raises(AssertionError, match="from an obstacle"):
        course.check_departure(items)


def test_frames_are_cut_out_of_any_pieces():
    link = mavlink.MAVLink(None, 1, 1)
    frames = [link.heartbeat_encode(1, 3, 0, number, 4).pack(link) for number in range(20)]
    stream, found, framer, chance = b"\x00\x11".join(frames), [], Framer(), random.Random(1)
    while stream:
        size = chance.randint(1, 30)
        found += framer.frames(stream[:size])
        stream = stream[size:]
    assert found == frames


def item(sequence, command=16, x=1):
    message = mavlink.MAVLink_mission_item_int_message(1, 1, sequence, 3, command, 0, 1, 0, 0, 0, 0, x, 1, 50)
    return said(message, 195)


def said(message, component):
    message._header = mavlink.MAVLink_header(message.id, srcSystem=1, srcComponent=component)
    return message


def upload(held, count, accepted=True):
    held.hear(1.0, said(mavlink.MAVLink_mission_count_message(1, 1, count), 195))
    for number in range(count):
        held.hear(2.0, item(number, x=count))
    result = 0 if accepted else 1
    held.hear(3.0, said(mavlink.MAVLink_mission_ack_message(1, 195, result), 1))


@pytest.mark.parametrize("in_place", [True, False])
def test_what_is_uploaded_is_held(in_place):
    held = HeldMission(in_place=in_place)
    upload(held, 5)
    upload(held, 3)
    assert [entry.x for entry in held.items] == [3, 3, 3]
    assert held.num_uploads == {195: 2}


def test_only_an_arduplane_holds_half_an_upload():
    for in_place, expected in ((True, [2, 5, 5]), (False, [5] * 5)):
        held = HeldMission(in_place=in_place)
        upload(held, 5)
        held.hear(4.0, said(mavlink.MAVLink_mission_count_message(1, 1, 3), 195))
        held.hear(5.0, item(0, x=2))
        assert [entry.x for entry in held.items] == expected


def test_a_part_is_written_over_in_place():
    held = HeldMission(in_place=True)
    upload(held, 5)
    held.hear(4.0, said(mavlink.MAVLink_mission_write_partial_list_message(1, 1, 2, 3), 195))
    for number in (2, 3):
        held.hear(5.0, item(number, x=9))
    held.hear(6.0, said(mavlink.MAVLink_mission_ack_message(1, 195, 0), 1))
    assert [entry.x for entry in held.items] == [5, 5, 9, 9, 5]


def test_a_half_without_a_binary_is_left_out():
    flights = all_wanted(Binaries.named({"ARDUPLANE": "/bin/true"}), [1, 2])
    assert {wanted.kind for wanted in flights} == {ARDUPLANE.name}
    assert len(flights) == 2 * len(SCENARIOS)
    assert all_wanted(Binaries.named({}), [1]) == []


def test_clearance_counts_at_the_obstacles_heights():
    course = Course()
    assert course.clearance_m((4450.0, 1450.0, 200.0)) == 0.0
    assert course.clearance_m((4700.0, 1450.0, 200.0)) == pytest.approx(100.0)
    assert np.isinf(Course().clearance_m((0.0, 0.0, 5000.0)))
