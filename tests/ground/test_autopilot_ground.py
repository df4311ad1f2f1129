"""The ground as an ArduPilot stores it, against one that asks for its heights and stores the answers."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from companion.link.messages.codec import Codec
from companion.link.messages.terrain_server import SQUARES, TerrainServer
from companion.link.wire.decoded_frame import Request
from companion.world.ground.autopilot_ground import AutopilotGround, stored_heights
from companion.world.ground.served_heights import ServedHeights
from tests.ground.maps import BOUNDS, FRAME, hill, posts_over, rough

SPACING = 30
METRES = 0.011131884502145034  # of 1e-7 degrees


class StoringAutopilot:
    """Scalar and slow, with a dictionary of blocks that are filled by the service's answers."""

    def __init__(self, server):
        self._server, self._blocks = server, {}

    def height(self, latitude_e7, longitude_e7):
        reference = [math.floor(at / 1e7) * 10_000_000 for at in (latitude_e7, longitude_e7)]
        scale = math.cos(math.radians(1e-7 * (latitude_e7 + reference[0]) / 2))
        north = (latitude_e7 - reference[0]) * METRES
        east = (longitude_e7 - reference[1]) * METRES * scale
        index = int(north / SPACING), int(east / SPACING)
        block = index[0] // 24, index[1] // 28
        i, j = index[0] % 24, index[1] % 28
        u, v = north / SPACING - index[0], east / SPACING - index[1]
        posts = self._block(reference, block)
        west = (1 - u) * posts[i, j] + u * posts[i + 1, j]
        return (1 - v) * west + v * ((1 - u) * posts[i, j + 1] + u * posts[i + 1, j + 1])

    def _block(self, reference, block):
        if block not in self._blocks:
            latitude = reference[0] + block[0] * 24 * SPACING / METRES
            scale = math.cos(math.radians(1e-7 * (latitude + reference[0]) / 2))
            corner = round(latitude), round(reference[1] + block[1] * 28 * SPACING / METRES / scale)
            posts, wanted = {}, (1 << SQUARES) - 1
            while wanted:
                asked = Request("terrain", 0, 0, wanted, (*corner, SPACING))
                for message in mavlink.MAVLink(None).parse_buffer(self._server.answer(asked, Codec(1, ()))):
                    wanted &= ~(1 << message.gridbit)
                    for number, height in enumerate(message.data):
                        row = 4 * (message.gridbit // 8) + number // 4
                        posts[row, 4 * (message.gridbit % 8) + number % 4] = height
            self._blocks[block] = posts
        return self._blocks[block]


@pytest.fixture(scope="module")
def heights():
    wide = (-2000.0, 3000.0, -2000.0, 3000.0)
    return ServedHeights(posts_over(rough(1), bounds=wide))


def test_stored_heights_are_those_of_an_autopilot_that_was_served(heights):
    autopilot, rng = StoringAutopilot(TerrainServer(heights)), np.random.default_rng(2)
    east, north = rng.uniform(0.0, 1000.0, (2, 40))
    latitude, longitude = FRAME.places_from_local(east, north)
    found = stored_heights(heights, latitude, longitude, SPACING)
    expected = [autopilot.height(1e7 * lat, 1e7 * lon) for lat, lon in zip(latitude, longitude, strict=True)]
    assert found == pytest.approx(expected, abs=0.05)


def test_heights_beyond_the_map_are_unknown(heights):
    latitude, longitude = FRAME.places_from_local(np.array([500.0, 9000.0]), np.array([400.0, 400.0]))
    assert np.isfinite(stored_heights(heights, latitude, longitude, 100.0)).tolist() == [True, False]


def test_the_local_grid_has_the_same_ground_between_its_nodes():
    """Slopes of the hill change by up to 0.7 from one square of posts to the next."""
    wide = (-3000.0, 4000.0, -3000.0, 4000.0)
    heights = ServedHeights(posts_over(lambda east, north: 0.35 * hill(east, north), bounds=wide))
    ground = AutopilotGround(heights, FRAME, BOUNDS, 100.0)
    east, north = np.random.default_rng(3).uniform(0.0, 800.0, (2, 500))
    stored = stored_heights(heights, *FRAME.places_from_local(east, north), 100.0) - FRAME.altitude_amsl_m
    found = ground.up_m(np.column_stack([east, north]))
    assert np.abs(found - stored).max() < 3.0
    assert np.abs(found - stored).mean() < 0.2
    # Posts 100 m apart miss what lies between: nowhere is the stored ground as high as the hill.
    assert stored.max() < 0.35 * 300.0
