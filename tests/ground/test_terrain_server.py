"""Answers to TERRAIN_REQUEST: the right heights at the right places, and none where they are unknown."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.terrain_server import AT_ONCE, SQUARES, TerrainServer
from companion.link.wire.decoded_frame import Request
from companion.world.ground.served_heights import ServedHeights
from tests.ground.maps import FRAME, bilinear, hill, posts_over

CORNER = (-353632610, 1491652300)
SPACING = 30


def request(mask, corner=CORNER, spacing=SPACING):
    return Request("terrain", 0, 0, mask, (*corner, spacing))


def answered(server, asked, codec=None):
    """The messages of an answer."""
    parser = mavlink.MAVLink(None)
    return parser.parse_buffer(server.answer(asked, codec or Codec(1, ()))) or []


def east_and_north(latitude, longitude):
    """Metres from the corner, on a sphere of ArduPilot's size."""
    scale = 0.011131884502145034 * 1e7
    north = (latitude - 1e-7 * CORNER[0]) * scale
    return (longitude - 1e-7 * CORNER[1]) * scale * np.cos(np.radians(latitude)), north


def test_each_height_is_that_of_its_place():
    """Rows of eight squares from the south-west corner; in a square four rows from the south."""
    server = TerrainServer(lambda latitude, longitude: np.hypot(*east_and_north(latitude, longitude)))
    for square in (0, 7, 8, 31, 55):
        (message,) = answered(server, request(1 << square))
        assert (message.lat, message.lon, message.grid_spacing) == (*CORNER, SPACING)
        assert message.gridbit == square
        for number, height in enumerate(message.data):
            east = SPACING * (4 * (square % 8) + number % 4)
            north = SPACING * (4 * (square // 8) + number // 4)
            assert height == pytest.approx(math.hypot(east, north), abs=1.0)


def test_all_squares_are_served_in_turn():
    server = TerrainServer(lambda latitude, longitude: 0.0 * latitude + 584.0)
    wanted, served = (1 << SQUARES) - 1, 0
    for _ in range(math.ceil(SQUARES / AT_ONCE)):
        messages = answered(server, request(wanted & ~served))
        assert len(messages) == min(AT_ONCE, SQUARES - served.bit_count())
        served |= sum(1 << message.gridbit for message in messages)
    assert served == wanted
    assert answered(server, request(0)) == []


def test_squares_with_an_unknown_height_are_left_out_and_others_are_not_held_up():
    def north_is_unknown(latitude, longitude):
        return np.where(latitude > 1e-7 * CORNER[0] + 0.0017, np.nan, 600.0)

    server = TerrainServer(north_is_unknown)
    served = {message.gridbit for _ in range(10) for message in answered(server, request((1 << SQUARES) - 1))}
    assert served == set(range(8))  # 0.0017° are 189 m; the second row ends at 210 m.


@pytest.mark.parametrize("asked", [request(1, spacing=0), request(1, corner=(900000000, 0))])
def test_requests_that_nobody_can_answer_are_counted(asked):
    codec = Codec(1, ())
    assert answered(TerrainServer(lambda latitude, _: latitude), asked, codec) == []
    assert codec.counters["refused_terrain"] == 1


def test_heights_are_those_of_the_map_above_the_sea_and_unknown_beyond_it():
    posts = posts_over(hill)
    east, north = np.array([500.0, 120.0, 5000.0]), np.array([400.0, 90.0, 0.0])
    latitude, longitude = FRAME.places_from_local(east, north)
    found = ServedHeights(posts)(latitude, longitude)
    assert found[0] == pytest.approx(584.0 + bilinear(posts, 500.0, 400.0), abs=0.05)
    assert found[1] == pytest.approx(584.0 + bilinear(posts, 120.0, 90.0), abs=0.05)
    assert math.isnan(found[2])
