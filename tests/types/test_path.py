"""Paths flown slower than planned, by numbers worked by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.types.path import FASTER_M_S, slowed_path, straight_path


def fast(airspeed=37.5, wind=(0.0, 0.0), course=0.0):
    """1,500 m over the ground, to the north unless told, a second a row at first."""
    rows = np.arange(41.0)
    return straight_path(
        rows, 100.0, np.zeros(3), course, airspeed,
        covariance_m2=np.eye(3), threat_level=0.5, wind_enu_m_s=wind,
    )  # fmt: skip


def test_it_slows_down_and_goes_on_slower():
    """37.5 to 25 m/s at 1 m/s² takes 12.5 s and 390.6 m; the other 1,109.4 m take 44.4 s."""
    slowed = slowed_path(fast(), 25.0)
    assert slowed.times_s[0] == 100.0
    assert slowed.times_s[-1] == pytest.approx(100.0 + 12.5 + 44.4, abs=0.2)
    assert slowed.speeds_m_s[0] == 37.5
    assert slowed.speeds_m_s[4] == pytest.approx(math.sqrt(37.5**2 - 2.0 * 150.0))  # after 150 m
    assert set(slowed.speeds_m_s[11:]) == {25.0}
    assert np.array_equal(slowed.positions_enu_m, fast().positions_enu_m)


def test_the_wind_slows_it_more():
    """Against 10 m/s a row of 27.5 m, a second at 37.5 m/s, takes 27.5 / 15 s at 25 m/s."""
    slowed = slowed_path(fast(wind=(0.0, -10.0)), 25.0)
    assert np.diff(slowed.times_s)[-1] == pytest.approx(27.5 / 15.0)


def test_what_is_no_faster_is_left_as_it_is():
    path = fast(25.0 + FASTER_M_S)
    assert slowed_path(path, 25.0) is path


@given(
    airspeed=st.floats(26.0, 40.0), to=st.floats(15.0, 25.0), course=st.floats(0.0, 6.28),
    east=st.floats(-12.0, 12.0), north=st.floats(-12.0, 12.0),
)  # fmt: skip
def test_it_is_never_earlier_nor_faster(airspeed, to, course, east, north):
    path = fast(airspeed, (east, north), course)
    slowed = slowed_path(path, to)
    assert (np.diff(slowed.times_s) >= np.diff(path.times_s) - 1e-9).all()
    assert (np.diff(slowed.speeds_m_s) <= 1e-9).all()
    assert slowed.speeds_m_s.min() >= to
