"""Properties of threat levels that hold for every set of threats and every state."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.kernels.threat.fuzzy_threat import aggregate_overlap, line_threat, node_threat, point_threat
from companion.kernels.workspace import MAX_THREATS, threat_scene
from companion.types.threat import Radar
from companion.world.threats import packed_threats
from tests.support.paths import box
from tests.support.worlds import LITERAL, PROBABILISTIC, SHIFTED, packed, threat_model

BOUNDS = (-600.0, 600.0, -600.0, 600.0, 0.0, 300.0)
COORDINATE, HEIGHT = st.floats(-550.0, 550.0), st.floats(0.0, 300.0)
RADARS = st.lists(st.tuples(COORDINATE, COORDINATE, st.floats(50.0, 900.0)), max_size=4)
WALLS = (
    box("wall", 0.0, -200.0, 30.0, 200.0, 0.0, 250.0),
    box("house", -300.0, 100.0, -100.0, 300.0, 0.0, 120.0),
)
OPEN, WALLED = packed((), BOUNDS), packed(WALLS, BOUNDS)
NORMALS = np.random.default_rng(5).standard_normal((60, 3))
NO_POINTS, NO_REACH = np.zeros((1, 4)), np.zeros(0)


@pytest.fixture(autouse=True, scope="module")
def coarse():
    """Shadows on a node every 15 m, half the thickness of the wall: each example draws radars anew."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("companion.world.threats.SHADOW_NODES", 81)
        yield


def threats_of(radars, obstacles):
    made = tuple(Radar(str(n), (x, y, 0.0), r, 0.0002) for n, (x, y, r) in enumerate(radars))
    return packed_threats(made, obstacles, BOUNDS)


@settings(max_examples=100, deadline=None)
@given(
    RADARS,
    st.lists(st.tuples(COORDINATE, COORDINATE, HEIGHT, st.floats(50.0, 400.0)), max_size=3),
    st.tuples(
        COORDINATE, COORDINATE, HEIGHT, st.floats(-3.2, 3.2), st.floats(-0.2, 0.2), st.floats(12.5, 37.5)
    ),
    st.floats(0.0, 3.0),
    st.floats(0.0, 40.0),
    st.sampled_from([SHIFTED, LITERAL, PROBABILISTIC]),
)
def test_levels_lie_between_0_and_1(radars, movers, state, delta, spread, form):
    threats, model = threats_of(radars, WALLED), threat_model(form)
    points = np.array([(x, y, z, 1.0) for x, y, z, _ in movers]).reshape(-1, 4)
    reach = np.array([r for *_, r in movers])
    points = points if len(points) else NO_POINTS
    scene, levels, state = threat_scene(threats, points, reach, model), np.empty(60), np.array(state)
    level = node_threat(state, spread * np.eye(3), delta, NORMALS, levels, scene)
    assert 0.0 <= level <= 1.0
    assert levels.min() >= 0.0
    assert levels.max() <= 1.0
    x, y, z = state[:3]
    edge = line_threat(state, x + 25.0, y - 10.0, z, state[5], delta, 10, scene)
    assert 0.0 <= edge <= 1.0


@settings(max_examples=150, deadline=None)
@given(
    RADARS,
    st.tuples(COORDINATE, COORDINATE, HEIGHT),
    st.floats(0.0, 3.0),
    st.sampled_from([SHIFTED, PROBABILISTIC]),
)
def test_masking_only_lowers_the_level_of_slow_flight(radars, place, delta, form):
    # Below the penetration speed ν is 0. Above it the mean of the ν may fall with a threat that is masked,
    # and then the level of the others rises: IFWA is an average.
    model, levels = threat_model(form), []
    for obstacles in (OPEN, WALLED):
        scene = threat_scene(threats_of(radars, obstacles), NO_POINTS, NO_REACH, model)
        mu, nu = point_threat(*place, 0.3, 0.0, 20.0, delta, scene)
        assert nu == 0.0
        levels.append(mu)
    assert levels[1] <= levels[0] + 1e-12


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.0, 0.999), st.floats(0.0, 1.0)), min_size=1, max_size=6),
    st.floats(0.0, 3.0),
)
def test_an_overlap_is_no_less_than_its_worst_threat_and_no_more_than_all_at_once(pairs, delta):
    # Each exposure is raised by those before it, so IFWA lies between the worst alone and 1 − Π(1 − μ).
    model = threat_model(PROBABILISTIC)
    table = np.zeros((MAX_THREATS, 2))
    table[: len(pairs), 0] = [mu for mu, _ in pairs]
    table[: len(pairs), 1] = [nu * (1.0 - mu) for mu, nu in pairs]
    mu, nu = aggregate_overlap(len(pairs), delta, model, table)
    worst = max(mu for mu, _ in pairs)
    together = 1.0 - math.prod(1.0 - mu for mu, _ in pairs)
    assert worst - 1e-12 <= mu <= together + 1e-12
    assert 0.0 <= nu <= max(n * (1.0 - m) for m, n in pairs) + 1e-12
