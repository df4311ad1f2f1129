"""Placed tracks pass as near as drawn, from every side, and the draws have the stated distribution."""

import numpy as np
import pytest
import scipy.stats

from companion.errors import ConfigError
from companion.research.encounters.encounter_model import model_from_text
from companion.research.encounters.placement import placed_track
from tests.research.encounters.made_model import text

MEETS_S = 40
TIMES = np.arange(0.0, 80.1, 0.1)
OWN = np.column_stack([TIMES, 20.0 * TIMES, -15.0 * TIMES, np.full_like(TIMES, 120.0)])  # 25 m/s, 394 ft


@pytest.fixture(scope="module")
def tracks():
    model, draw = model_from_text(text(), "made"), np.random.default_rng(5)
    return [placed_track(OWN, model, draw, meets_s=MEETS_S, spread=1.0) for _ in range(150)]


def test_each_passes_as_near_as_it_says(tracks):
    for entry in tracks:
        there = entry.rows[MEETS_S, 1:4]
        assert np.hypot(there[0] - 800.0, there[1] + 600.0) == pytest.approx(entry.miss_m, abs=1e-6)
        assert there[2] - 120.0 == pytest.approx(entry.above_m)
        away = np.hypot(*(entry.rows[:, 1:3] - OWN[::10, 1:3]).T)
        assert abs(away.argmin() - MEETS_S) <= 3
        assert away.min() == pytest.approx(entry.miss_m, abs=25.0)
        assert entry.rows[:, 3].min() >= 30.0
        assert np.diff(entry.rows[:, 1:4], axis=0) == pytest.approx(entry.rows[:-1, 4:7])


def test_miss_distances_are_uniform_in_the_well_clear_volume(tracks):
    miss, above = (np.array([getattr(entry, name) for entry in tracks]) for name in ("miss_m", "above_m"))
    assert scipy.stats.kstest(miss, scipy.stats.uniform(0.0, 609.6).cdf).pvalue > 0.01
    assert scipy.stats.kstest(above, scipy.stats.uniform(-76.2, 152.4).cdf).pvalue > 0.01


def test_they_come_more_often_the_faster_they_close(tracks):
    # Head on is met more often than overtaken: the means of the relative speed's share say so.
    ahead = np.array([entry.rows[MEETS_S, 4:6] @ (0.8, -0.6) < 0.0 for entry in tracks])
    assert 0.52 < ahead.mean() < 0.9
    sides = np.array([entry.rows[MEETS_S, 4:6] @ (0.6, 0.8) < 0.0 for entry in tracks])
    assert 0.4 < sides.mean() < 0.6


def test_the_same_seed_places_the_same_track():
    model = model_from_text(text(), "made")
    one, other = (
        placed_track(OWN, model, np.random.default_rng(7), meets_s=MEETS_S, spread=1.5) for _ in range(2)
    )
    assert np.array_equal(one.rows, other.rows)


def test_a_model_of_other_heights_fits_nothing():
    model = model_from_text(
        text(boundaries="2000 3000 4000\n60 100 140\n-2 -1 1 2\n-9 -2 2 9\n-6 -1 1 6"), "made"
    )
    with pytest.raises(ConfigError, match="no fitting track"):
        placed_track(OWN, model, np.random.default_rng(1), meets_s=MEETS_S, spread=1.0)
