"""Flights of teams that anything happens to: what the seeds cover, and some of them."""

from collections import Counter

import pytest

from tests.mission.team.disturbed_flights import flown, scenario


def test_two_hundred_seeds_cover_what_may_happen():
    found = [scenario(seed) for seed in range(200)]
    counts = Counter((mission.shares_goals, num, dialect.value) for mission, num, dialect, *_ in found)
    assert len(counts) == 2 * 3 * 2
    modes = {mode for _, _, _, switched, _, _ in found for _, _, mode in switched}
    assert modes == {"LOITER", "RTL", "CIRCLE", "FBWB", "GUIDED", "POSCTL", "AUTO", "MISSION"}
    assert sum(bool(gone_s) for *_, gone_s, _ in found) > 20
    assert sum(silent_s is not None for *_, silent_s in found) > 40


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 1])
def test_no_service_ends_and_those_that_nothing_happens_to_keep_apart(seed):
    outcome = flown(seed)
    assert outcome.is_kept, outcome
