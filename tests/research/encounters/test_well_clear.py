"""The volumes of the standards by numbers worked by hand, and by modified tau as it is defined."""

import math

import numpy as np
import pytest

from companion.research.encounters.well_clear import (
    EN_ROUTE,
    NEAR_MID_AIR_COLLISION,
    NON_COOPERATIVE,
    SMALL_AIRCRAFT,
)

FOOT = 0.3048
STILL = (0.0, 0.0, 0.0)


def inside(volume, away, velocity=STILL):
    return bool(volume.is_inside(np.array([away], dtype=float), np.array([velocity], dtype=float))[0])


@pytest.mark.parametrize(
    ("volume", "far_ft", "high_ft"),
    [(NEAR_MID_AIR_COLLISION, 500, 100), (EN_ROUTE, 4000, 450), (NON_COOPERATIVE, 2200, 450),
     (SMALL_AIRCRAFT, 2000, 250)],
)  # fmt: skip
def test_the_cylinders_of_the_standards(volume, far_ft, high_ft):
    # 3-4-5: the distance is horizontal, in any direction, and both limits hold at once.
    east, north = 0.6 * far_ft * FOOT, -0.8 * far_ft * FOOT
    for share, up_share, is_in in ((0.999, 0.999, True), (1.001, 0.0, False), (0.0, 1.001, False)):
        for sign in (-1.0, 1.0):
            away = (share * east, share * north, sign * up_share * high_ft * FOOT)
            assert inside(volume, away) is is_in


def test_modified_tau_by_hand():
    # Head on at 100 m/s: τ_mod = (r² - DMOD²)/(100 r) = 35 s at r = 1750 + √(1750² + 1219.2²) = 3882.85 m.
    limit = 1750.0 + math.hypot(1750.0, 1219.2)
    assert inside(EN_ROUTE, (limit - 0.1, 0.0, 0.0), (-100.0, 0.0, 0.0))
    assert not inside(EN_ROUTE, (limit + 0.1, 0.0, 0.0), (-100.0, 0.0, 0.0))
    # The same without tau, and the same going away, is clear.
    assert not inside(NON_COOPERATIVE, (limit - 0.1, 0.0, 0.0), (-100.0, 0.0, 0.0))
    assert not inside(EN_ROUTE, (limit - 0.1, 0.0, 0.0), (100.0, 0.0, 0.0))
    # It passes abeam: 1219.2 m counts, a metre more does not, at 2000 m along.
    assert inside(EN_ROUTE, (2000.0, 1219.0, 0.0), (-100.0, 0.0, 0.0))
    assert not inside(EN_ROUTE, (2000.0, 1220.2, 0.0), (-100.0, 0.0, 0.0))


def test_severity_by_hand():
    # Along 0.6 and across 0.6 of 2000 ft: FG² = 0.36 + 0.36 - 0.1296 = 0.5904; with half the height
    # 0.5904 + 0.25 - 0.1476 = 0.6928.
    away = np.array([[1200 * FOOT, 0.0, 125 * FOOT], [0.0, 0.0, 0.0], [2000 * FOOT, 0.0, 0.0]])
    found = SMALL_AIRCRAFT.severity(away, np.zeros((3, 3)))
    assert found == pytest.approx([1.0 - math.sqrt(0.6928), 1.0, 0.0])
    # Head on there is no miss distance: half of the range at which tau is 35 s remains as 1 - 0.5.
    half = 0.5 * (1750.0 + math.hypot(1750.0, 1219.2))
    found = EN_ROUTE.severity(np.array([[0.0, half, 0.0]]), np.array([[0.0, -100.0, 0.0]]))
    assert found == pytest.approx([0.5])


@pytest.mark.parametrize("volume", [EN_ROUTE, NON_COOPERATIVE, SMALL_AIRCRAFT])
def test_severity_is_positive_just_where_well_clear_is_lost(volume):
    draw = np.random.default_rng(4)
    away = draw.uniform(-1.0, 1.0, (20_000, 3)) * (2000.0, 2000.0, 200.0)
    velocity = draw.uniform(-1.0, 1.0, (20_000, 3)) * (80.0, 80.0, 5.0)
    lost = volume.is_inside(away, velocity)
    assert 500 < lost.sum() < 19_000
    assert np.array_equal(volume.severity(away, velocity) > 0.0, lost)
