"""Flights of teams over maps: the seeds cover what they should, and one is flown."""

from collections import Counter

import pytest

from tests.mission.team.map_flights import LOSS, flown, scenario


def test_five_hundred_seeds_cover_all_maps_numbers_and_autopilots():
    found = [scenario(seed) for seed in range(500)]
    assert Counter(name for _, name, _, _ in found) == {"paper-2d": 100, "city-block": 100, "random": 300}
    assert Counter((num, dialect.value) for _, _, num, dialect in found).keys() == {
        (num, kind) for num in (2, 4, 8) for kind in ("ardupilot", "px4")
    }
    assert {mission.simulation.radio_loss for mission, _, _, _ in found} == {LOSS}
    walls = {mission.model_dump_json() for mission, name, _, _ in found if name == "random"}
    assert len(walls) == 300


@pytest.mark.thorough
def test_a_team_passes_a_random_map_and_the_same_aircraft_alone_lose_separation():
    outcome = flown(7)
    assert outcome.is_kept
    assert not outcome.is_separate_alone
    assert len(outcome.ratios) == outcome.num == 2
