"""The prisms round the way out."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon

from companion.flight.prediction.outward_path import AWAY_M, FREE_M, outward_path
from tests.support.paths import straight_path


def test_the_way_out_of_600_m_is_surrounded_but_for_its_last_150_m():
    path = straight_path(num=25, speed=25.0)  # 600 m
    prisms = outward_path(path, float(path.times_s[-1]))
    ground = [Polygon(prism.polygon_enu_m) for prism in prisms]
    assert sum(entry.area for entry in ground) == np.float64(425.0 * 2.0 * AWAY_M)  # rows are 25 m apart
    assert {(prism.base_m, prism.top_m) for prism in prisms} == {(40.0, 160.0)}


def test_a_short_way_out_is_not_surrounded():
    path = straight_path(num=25, speed=25.0)
    assert outward_path(path, 5.0) == ()
    assert outward_path(path, 0.0) == ()


@given(st.floats(0.0, 24.0), st.floats(-np.pi, np.pi), st.floats(-0.2, 0.2))
def test_the_aircraft_is_inside_up_to_where_it_may_come_near(until_s, course, climb):
    path = straight_path(num=25, speed=25.0, course=course, climb=climb)
    prisms = outward_path(path, until_s)
    solid = [(Polygon(prism.polygon_enu_m).buffer(1e-6), prism.base_m, prism.top_m) for prism in prisms]
    ends = np.array([np.interp(until_s, path.times_s, path.positions_enu_m[:, k]) for k in range(3)])
    left = path.positions_enu_m[path.times_s < until_s]
    inside = [
        any(ground.covers(Point(*place[:2])) and low <= place[2] <= high for ground, low, high in solid)
        for place in left
    ]
    far = np.linalg.norm(left[:, :2] - ends[:2], axis=1) > FREE_M
    if far.sum() > 1:
        assert inside == far.tolist()
    else:
        assert not prisms
