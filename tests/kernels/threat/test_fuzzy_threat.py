"""A-IFS threat model against a plain NumPy version of the paper's formulas, and by hand."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from companion.kernels.threat import fuzzy_threat as t
from companion.kernels.workspace import threat_scene
from companion.types.threat import Radar
from companion.world.threats import packed_threats
from tests.support.paths import box
from tests.support.worlds import LITERAL, PROBABILISTIC, SHIFTED, packed, threat_model

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
RADARS = (
    Radar("a", (0.0, 0.0, 0.0), 500.0),
    Radar("b", (200.0, 100.0, 0.0), 300.0),
    Radar("c", (-100.0, 50.0, 20.0), 400.0, 0.002),
)
EMPTY = packed([])
THREATS = packed_threats(RADARS, EMPTY, BOUNDS)
ONE_RADAR = packed_threats(RADARS[:1], EMPTY, BOUNDS)
NO_DTS, NO_REACH = np.zeros((1, 4)), np.zeros(0)
UNIT_INTERVAL = st.floats(0.0, 1.0)


def oracle_membership(position, radar):
    away = np.array(position) - np.array(radar.position_enu_m)
    slant, level = np.linalg.norm(away), math.hypot(away[0], away[1])
    if slant > radar.max_threat_radius_m or away[2] < radar.boundary_coefficient_per_m * level**2:
        return 0.0
    return math.exp(-(slant**4) / radar.max_threat_radius_m**4)


def oracle_non_membership(position, velocity, v, target):
    if v < 25.0:
        return 0.0
    line = np.array(target) - np.array(position)
    norm = np.linalg.norm(line) * np.linalg.norm(velocity)
    alpha = math.acos(np.clip(line @ velocity / norm, -1.0, 1.0)) if norm > 0.0 else 0.0
    return math.sin(math.pi * (v - 12.5) / (2.0 * 25.0)) * math.sin(alpha / 2.0) ** 2


def oracle_point(pairs, delta, form=SHIFTED):
    """(μ, ν) of an overlap: certainty, normalisation, raising, IFWA, each as the paper writes it."""
    if not pairs:
        return 0.0, 0.0
    base = 0.7 * len(pairs) + 0.3 * delta
    cf = {
        SHIFTED: 1.0 - 1.0 / (1.0 + base),
        LITERAL: min(max(1.0 - 1.0 / base, 0.0), 1.0),
        PROBABILISTIC: 1.0,
    }[form]
    weighted = []
    for certain, ruled_out in pairs:
        mu, nu = cf * certain, cf * ruled_out
        if mu in (0.0, 1.0):
            nu = 0.0
        if mu + nu > 1.0:
            mu, nu = mu / (mu + nu), nu / (mu + nu)
        weighted.append((mu, nu))
    weighted.sort(key=lambda pair: -pair[0])
    raised = []
    for k, (mu, nu) in enumerate(weighted):
        up = 1.0 - (1.0 - mu) * np.prod([1.0 - other for other, _ in weighted[:k]])
        raised.append((up, min(nu, 1.0 - up) if len(weighted) > 1 else nu))
    weight = 1.0 / len(raised)
    mu = 1.0 - np.prod([(1.0 - m) ** weight for m, _ in raised])
    return float(mu), float(np.prod([n**weight for _, n in raised]))


def oracle_pairs(position, velocity, v):
    pairs = []
    for radar in RADARS:
        mu = oracle_membership(position, radar)
        if mu > 0.0:
            pairs.append((mu, oracle_non_membership(position, velocity, v, radar.position_enu_m)))
    return pairs


def test_membership_by_hand():
    # At half the radius exp(−1/16) = 0.939413; at the radius exp(−1) = 0.367879; beyond it 0.
    assert t.membership(250.0, 0.0, 250.0, 500.0, 0.0) == pytest.approx(0.9394130628)
    assert t.membership(500.0, 0.0, 500.0, 500.0, 0.0) == pytest.approx(0.3678794412)
    assert t.membership(500.1, 0.0, 500.0, 500.0, 0.0) == 0.0
    # Boundary 0.002·100² = 20 m.
    assert t.membership(102.0, 20.0, 100.0, 500.0, 0.002) > 0.9
    assert t.membership(102.0, 19.9, 100.0, 500.0, 0.002) == 0.0


def test_non_membership_by_hand():
    # v = 25: share sin(π·12.5/50) = sin 45° = 0.707107; flying away (α = π): sin² 90° = 1; abeam: ½.
    # At once in one radar, with CF = 1 − 1/1.7: ν = CF·share·sin²(α/2).
    cf = 1.0 - 1.0 / 1.7

    def nu(v, theta, form=SHIFTED):
        scene = threat_scene(ONE_RADAR, NO_DTS, NO_REACH, threat_model(form))
        return t.point_threat(0.0, 480.0, 0.0, theta, 0.0, v, 0.0, scene)[1]  # the radar is 480 m south

    assert nu(25.0, math.pi / 2.0) == pytest.approx(cf * 0.7071067812)
    assert nu(25.0, 0.0) == pytest.approx(cf * 0.3535533906)
    assert nu(37.5, 0.0) == pytest.approx(cf * 0.5)
    assert nu(37.5, -math.pi / 2.0) == pytest.approx(0.0, abs=1e-12)
    assert nu(24.9, math.pi / 2.0) == 0.0
    assert nu(37.5, math.pi / 2.0, PROBABILISTIC) == 0.0


def test_certainty_by_hand():
    # One radar, δ = 0.1: bracket 0.7 + 0.03 = 0.73. Shifted 1 − 1/1.73 = 0.421965; as printed 1 − 1/0.73 < 0.
    assert t.certainty(1.0, 0.1, threat_model()) == pytest.approx(0.4219653179)
    assert t.certainty(1.0, 0.1, threat_model(LITERAL)) == 0.0
    # Three radars, δ = 1: 2.4: 1 − 1/3.4 = 0.705882; 1 − 1/2.4 = 0.583333.
    assert t.certainty(3.0, 1.0, threat_model()) == pytest.approx(0.7058823529)
    assert t.certainty(3.0, 1.0, threat_model(LITERAL)) == pytest.approx(0.5833333333)
    assert t.certainty(3.0, 1.0, threat_model(PROBABILISTIC)) == 1.0
    assert t.certainty(0.0, 0.0, threat_model(LITERAL)) == 0.0
    assert t.certainty(3.0, 1.0, threat_model(exponent=2.0)) == pytest.approx(1.0 - (1.0 / 3.4) ** 2)


def test_normalisation_by_hand():
    assert t.weighted_pair(0.8, 0.6, 1.0) == pytest.approx((0.8 / 1.4, 0.6 / 1.4))
    assert t.weighted_pair(0.8, 0.6, 0.5) == pytest.approx((0.4, 0.3))
    assert t.weighted_pair(0.0, 0.6, 1.0) == (0.0, 0.0)
    assert t.weighted_pair(1.0, 0.6, 1.0) == (1.0, 0.0)


def test_overlap_by_hand():
    # Probabilistic, μ = 0.5 and 0.2: raised 0.5 and 1 − 0.8·0.5 = 0.6; IFWA 1 − √(0.5·0.4) = 0.552786.
    pairs = np.zeros((t.MAX_THREATS, 2))
    pairs[:2, 0] = 0.2, 0.5
    mu, nu = t.aggregate_overlap(2, 0.0, threat_model(PROBABILISTIC), pairs)
    assert (mu, nu) == pytest.approx((0.5527864045, 0.0))


PAIRS = st.lists(st.tuples(UNIT_INTERVAL, UNIT_INTERVAL), min_size=0, max_size=6)


@settings(max_examples=300, deadline=None)
@given(PAIRS, st.floats(0.0, 5.0), st.sampled_from([SHIFTED, LITERAL, PROBABILISTIC]))
def test_overlap_agrees_with_the_paper(pairs, delta, form):
    scratch = np.zeros((t.MAX_THREATS, 2))
    scratch[: len(pairs)] = np.array(pairs).reshape(-1, 2)
    if form == PROBABILISTIC:
        scratch[:, 1] = 0.0
        pairs = [(mu, 0.0) for mu, _ in pairs]
    answer = t.aggregate_overlap(len(pairs), delta, threat_model(form), scratch)
    assert answer == pytest.approx(oracle_point(pairs, delta, form), abs=1e-9)


COORDINATE = st.floats(-450.0, 450.0)
DIRECTION = st.floats(-math.pi, math.pi)


@settings(max_examples=200, deadline=None)
@given(
    COORDINATE, COORDINATE, st.floats(0.0, 250.0), DIRECTION, st.floats(-0.17, 0.17),
    st.floats(12.5, 37.5), st.floats(0.0, 3.0),
)  # fmt: skip
def test_the_threat_at_a_state_agrees_with_the_paper(x, y, z, theta, phi, v, delta):
    velocity = np.array([math.cos(phi) * math.cos(theta), math.cos(phi) * math.sin(theta), math.sin(phi)])
    expected = oracle_point(oracle_pairs((x, y, z), velocity, v), delta)
    answer = t.point_threat(
        x, y, z, theta, phi, v, delta, threat_scene(THREATS, NO_DTS, NO_REACH, threat_model())
    )
    assert answer == pytest.approx(expected, abs=1e-7)


def test_only_known_radars_count():
    unknown = THREATS._replace(known=np.zeros(3, dtype=np.int64))
    state = (10.0, 0.0, 100.0, 0.0, 0.0, 20.0, 0.0)
    assert t.point_threat(*state, threat_scene(unknown, NO_DTS, NO_REACH, threat_model())) == (0.0, 0.0)
    assert t.point_threat(*state, threat_scene(THREATS, NO_DTS, NO_REACH, threat_model()))[0] > 0.3


def test_a_moving_threat_counts_only_where_it_can_be():
    # 100 m from a DT with RD_max 200 m: exp(−1/16); one threat, δ = 0: CF = 1 − 1/1.7.
    points, reach = np.array([[300.0, 500.0, 0.0, 1.0]]), np.array([200.0])
    none = THREATS._replace(known=np.zeros(3, dtype=np.int64))
    state = (300.0, 400.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    mu, _ = t.point_threat(*state, threat_scene(none, points, reach, threat_model()))
    assert mu == pytest.approx((1.0 - 1.0 / 1.7) * math.exp(-1.0 / 16.0))
    points[0, 3] = 0.0
    assert t.point_threat(*state, threat_scene(none, points, reach, threat_model())) == (0.0, 0.0)


def test_the_level_of_a_node_is_the_mean_over_its_particles():
    rng = np.random.default_rng(1)
    normals, levels = rng.standard_normal((40, 3)), np.zeros(40)
    covariance = np.array([[90.0, 30.0, 5.0], [30.0, 60.0, -8.0], [5.0, -8.0, 40.0]])
    factor = np.linalg.cholesky(covariance)
    state = np.array([230.0, -150.0, 120.0, 0.4, 0.05, 30.0])
    velocity = np.array([math.cos(0.05) * math.cos(0.4), math.cos(0.05) * math.sin(0.4), math.sin(0.05)])
    scene = threat_scene(THREATS, NO_DTS, NO_REACH, threat_model())
    mean = t.node_threat(state, factor, 0.4, normals, levels, scene)
    expected = []
    for normal in normals:
        mu, nu = oracle_point(oracle_pairs(state[:3] + factor @ normal, velocity, 30.0), 0.4)
        expected.append(max(mu - nu, 0.0))
    assert levels == pytest.approx(expected, abs=1e-9)
    assert mean == pytest.approx(np.mean(expected))
    assert np.ptp(expected) > 0.01


@settings(max_examples=100, deadline=None)
@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE, st.floats(12.5, 37.5), st.floats(0.0, 2.0))
@example(-287.0, 0.0, -399.0, 0.0, 29.0, 0.0)  # ν above μ all along: the level is 0, not negative
def test_the_level_of_an_edge_is_ifwa_over_eleven_points_and_between_its_extremes(px, py, qx, qy, v, delta):
    p, q = np.array([px, py, 100.0]), np.array([qx, qy, 130.0])
    if np.linalg.norm(q - p) < 1.0:
        q[0] += 5.0
    velocity = (q - p) / np.linalg.norm(q - p)
    pairs = [oracle_point(oracle_pairs(p + k / 11.0 * (q - p), velocity, v), delta) for k in range(1, 12)]
    mu = 1.0 - np.prod([(1.0 - m) ** (1.0 / 11.0) for m, _ in pairs])
    nu = np.prod([n ** (1.0 / 11.0) for _, n in pairs])
    scene = threat_scene(THREATS, NO_DTS, NO_REACH, threat_model())
    level = t.line_threat(p, *q, v, delta, 10, scene)
    assert level == pytest.approx(max(mu - nu, 0.0), abs=1e-7)
    least, most = min(m for m, _ in pairs), max(m for m, _ in pairs)
    highest = max(0.0, most - min(n for _, n in pairs))  # a level is never below 0
    assert least - max(n for _, n in pairs) - 1e-9 <= level <= highest + 1e-9


def test_success_over_exposures_by_hand():
    assert t.success_over_exposures(np.array([0.1, 0.2, 0.5])) == pytest.approx(0.9 * 0.8 * 0.5)
    assert t.success_over_exposures(np.zeros(0)) == 1.0


@settings(max_examples=100, deadline=None)
@given(PAIRS.filter(lambda pairs: len(pairs) > 1), st.floats(0.0, 5.0), st.randoms(use_true_random=False))
def test_the_order_in_which_threats_come_does_not_matter(pairs, delta, random):
    shuffled = list(pairs)
    random.shuffle(shuffled)
    answers = []
    for order in (pairs, shuffled):
        scratch = np.zeros((t.MAX_THREATS, 2))
        scratch[: len(order)] = np.array(order)
        answers.append(t.aggregate_overlap(len(order), delta, threat_model(), scratch))
    # Where two memberships are equal their non-memberships may change places.
    if len({mu for mu, _ in pairs}) == len(pairs):
        assert answers[0] == pytest.approx(answers[1], abs=1e-9)
    assert answers[0][0] == pytest.approx(answers[1][0], abs=1e-9)


@settings(max_examples=300, deadline=None)
@given(PAIRS, st.floats(0.0, 5.0), st.sampled_from([SHIFTED, LITERAL]))
def test_memberships_stay_intuitionistic(pairs, delta, form):
    scratch = np.zeros((t.MAX_THREATS, 2))
    scratch[: len(pairs)] = np.array(pairs).reshape(-1, 2)
    mu, nu = t.aggregate_overlap(len(pairs), delta, threat_model(form), scratch)
    assert 0.0 <= mu <= 1.0
    assert 0.0 <= nu <= 1.0
    assert mu + nu <= 1.0 + 1e-12


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 20), st.floats(0.0, 20.0), st.integers(0, 5), st.floats(0.0, 5.0))
def test_certainty_grows_with_exposure_and_with_uncertainty(n, delta, more, wider):
    model = threat_model()
    low = t.certainty(float(n), delta, model)
    assert 0.0 <= low < 1.0
    assert t.certainty(float(n + more), delta, model) >= low
    assert t.certainty(float(n), delta + wider, model) >= low


WALLS = (box("w", 50.0, -200.0, 80.0, 200.0, 0.0, 120.0), box("v", -200.0, -120.0, -20.0, -100.0, 0.0, 80.0))
MASKED = packed_threats(RADARS[:1], packed(WALLS), BOUNDS)
OPEN = packed_threats(RADARS[:1], EMPTY, BOUNDS)


@settings(max_examples=200, deadline=None)
@given(COORDINATE, COORDINATE, st.floats(0.0, 250.0), DIRECTION, st.floats(12.5, 37.5))
def test_masking_only_lowers_the_membership(x, y, z, theta, v):
    args = (x, y, z, theta, 0.0, v, 0.3)
    masked = t.point_threat(*args, threat_scene(MASKED, NO_DTS, NO_REACH, threat_model()))
    seen = t.point_threat(*args, threat_scene(OPEN, NO_DTS, NO_REACH, threat_model()))
    assert masked in (seen, (0.0, 0.0))


def test_masking_is_complete_behind_a_wall():
    args = (200.0, 0.0, 50.0, 0.0, 0.0, 20.0, 0.3)  # the line to it is at 12.5 to 20 m in the wall
    assert t.point_threat(*args, threat_scene(OPEN, NO_DTS, NO_REACH, threat_model()))[0] > 0.3
    assert t.point_threat(*args, threat_scene(MASKED, NO_DTS, NO_REACH, threat_model())) == (0.0, 0.0)
