"""Encounter models: what is drawn has the file's distributions, and errors name the place."""

import math

import numpy as np
import pytest
import scipy.stats

from companion.errors import ConfigError
from companion.research.encounters.encounter_model import model_from_text, model_text
from tests.research.encounters.made_model import LATER, text

KNOT, FOOT = 1852.0 / 3600.0, 0.3048


def fits(counted, expected_shares):
    """Whether counts agree with shares by a chi-square test; nothing is drawn where the share is 0."""
    counted, shares = np.asarray(counted, dtype=float), np.asarray(expected_shares, dtype=float)
    assert not counted[shares == 0.0].any()
    there = shares > 0.0
    expected = shares[there] / shares.sum() * counted.sum()
    return scipy.stats.chisquare(counted[there], expected).pvalue > 0.001


def test_the_beginnings_have_the_tables_as_distributions():
    model = model_from_text(text(), "made")
    draw = np.random.default_rng(1)
    bins = np.array([model.drawn_bins(draw) for _ in range(20_000)])
    assert fits(np.bincount(bins[:, 0], minlength=2), (300, 100))
    for height, shares in ((0, (70, 30)), (1, (20, 80))):
        assert fits(np.bincount(bins[bins[:, 0] == height, 1], minlength=2), shares)
    for speed, faster, turns in ((0, (10, 80, 10), (30, 40, 30)), (1, (5, 90, 5), (5, 90, 5))):
        of = bins[bins[:, 1] == speed]
        assert fits(np.bincount(of[:, 2], minlength=3), faster)
        assert fits(np.bincount(of[:, 4], minlength=3), turns)
    # The joint one of speed and turn, worked by hand: P(v = 0) = 0.75·0.7 + 0.25·0.2 = 0.575.
    joint = np.bincount(3 * bins[:, 1] + bins[:, 4], minlength=6)
    turns = np.array([30, 40, 30, 0, 0, 0]) * 0.575 + np.array([0, 0, 0, 5, 90, 5]) * 0.425
    assert fits(joint, turns)


def test_the_next_second_has_the_tables_as_distributions():
    # A table of its own for each combination: of turn (L, v, ...) the column is named by v, turn, climb(t+1).
    draw = np.random.default_rng(2)
    speeds_up, climbs, turns = (draw.integers(1, 90, (rows, 3)) for rows in (3, 6, 18))
    numbers = np.concatenate([table.ravel() for table in (speeds_up, climbs, turns)])
    model = model_from_text(text(N_transition=" ".join(map(str, numbers))), "made")
    bins = [1, 1, 0, 2, 1]
    later = np.array([model.next_bins(bins, draw) for _ in range(20_000)])
    assert (later[:, :2] == (1, 1)).all()
    assert fits(np.bincount(later[:, 2], minlength=3), speeds_up[0])
    assert fits(np.bincount(later[:, 3], minlength=3), climbs[1 + 2 * 2])
    for climb in range(3):
        of = later[later[:, 3] == climb, 4]
        assert fits(np.bincount(of, minlength=3), turns[1 + 2 * 1 + 2 * 3 * climb])


def test_what_was_never_counted_stays_as_it_is():
    model = model_from_text(text(N_transition=" ".join(["0"] * 81)), "made")
    assert model.next_bins([1, 0, 2, 0, 1], np.random.default_rng(1)) == [1, 0, 2, 0, 1]


def test_values_are_uniform_in_their_bin_and_zero_about_zero():
    model, draw = model_from_text(text(), "made"), np.random.default_rng(3)
    values = np.array([model.drawn_value(3, 2, draw) for _ in range(5_000)])
    assert scipy.stats.kstest(values, scipy.stats.uniform(200.0, 800.0).cdf).pvalue > 0.001
    assert {model.drawn_value(3, 1, draw) for _ in range(20)} == {0.0}


def test_a_track_is_the_sum_of_its_velocities_within_the_model():
    model, draw = model_from_text(text(), "made"), np.random.default_rng(4)
    tracks = [track for _ in range(200) if (track := model.track(60, draw)) is not None]
    assert len(tracks) > 100
    turned = 0
    for track in tracks:
        assert track.shape == (61, 7)
        assert np.array_equal(track[:, 0], np.arange(61.0))
        assert track[0, 1:3] == pytest.approx((0.0, 0.0))
        assert track[0, 4] == 0.0
        assert np.diff(track[:, 1:4], axis=0) == pytest.approx(track[:-1, 4:7])
        speeds = np.hypot(track[:, 4], track[:, 5]) / KNOT
        assert speeds.min() > 60.0
        assert speeds.max() < 140.0
        assert np.abs(np.diff(speeds)).max() <= 2.0 + 1e-9
        assert np.abs(track[:, 6]).max() <= 1000.0 * FOOT / 60.0 + 1e-9
        turns = np.diff(np.unwrap(np.arctan2(track[:, 4], track[:, 5])))
        assert np.abs(turns).max() <= math.radians(6.0) + 1e-9
        turned += np.abs(turns).max() > math.radians(1.0)
    assert turned > 50
    again = np.random.default_rng(4)
    assert np.array_equal(tracks[0], next(t for _ in range(9) if (t := model.track(60, again)) is not None))


@pytest.mark.parametrize(
    ("sections", "section", "expected"),
    [
        ({"boundaries": None}, "boundaries", "lines of numbers"),
        ({"r_initial": ""}, "r_initial", "lines of numbers"),
        ({"labels_initial": '"L", "v"'}, "labels_initial", r'a variable "\\dot v"'),
        ({"N_initial": "1 2 3"}, "N_initial", "21"),
        ({"N_transition": "1 two"}, "N_transition", "numbers"),
        ({"resample_rates": "0 0 0.1 -0.2 0.3"}, "resample_rates", "from 0 on"),
        ({"boundaries": "300 500 1200\n60 100 140\n*\n-9 -2 2 9\n-6 -1 1 6"}, "boundaries", "numbers"),
        ({"boundaries": "300 500 400\n60 100 140\n-2 -1 1 2\n-9 -2 2 9\n-6 -1 1 6"}, "boundaries", "rising"),
        ({"G_initial": "0 1 0 0 0\n1 0 0 0 0" + "\n0 0 0 0 0" * 3, "N_initial": " ".join(["1"] * 17)},
         "G_initial", "without one"),
        ({"G_transition": LATER[:-2]}, "G_transition", "8"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_told_by_file_section_and_what_was_expected(sections, section, expected, tmp_path):
    file = tmp_path / "wrong.txt"
    file.write_text(text(**sections), encoding="utf-8")
    with pytest.raises(ConfigError, match=expected) as caught:
        model_from_text(model_text(file), str(file))
    assert (caught.value.file, caught.value.key) == (str(file), section)


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigError, match="an encounter model's text"):
        model_text(tmp_path / "none.txt")
