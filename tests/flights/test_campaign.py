"""Ten seeds of both of the paper's maps."""

import pytest

from tests.flights.flown import reaches, shipped, touches_anything, true_places, uploads_in_flight

pytestmark = pytest.mark.xdist_group("shipped flights")  # they share flights that are made once a process

SEEDS = range(1, 11)
MAPS = ("paper-2d", "paper-3d")
MIN_REACHED = 18


@pytest.fixture(scope="module")
def campaign():
    return {(name, seed): shipped(name, seed) for name in MAPS for seed in SEEDS}


@pytest.mark.slow
def test_nine_of_ten_reach_the_goal(campaign):
    missed = [key for key, flight in campaign.items() if not reaches(flight.mission, true_places(flight))]
    assert len(campaign) - len(missed) >= MIN_REACHED, f"missed: {missed}"


@pytest.mark.slow
def test_none_touches_anything(campaign):
    hit = [key for key, flight in campaign.items() if touches_anything(flight.mission, true_places(flight))]
    assert hit == []


@pytest.mark.slow
def test_all_upload_missions_in_flight(campaign):
    few = {
        key: uploads_in_flight(flight) for key, flight in campaign.items() if uploads_in_flight(flight) < 2
    }
    assert few == {}
