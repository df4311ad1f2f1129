"""Flights in the wind know when they will be where; beside the same flights that hear of none."""

import re

import numpy as np
import pytest

from companion.config import mission_from_text
from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import Dialect
from sim.bench.arrival import fly_in_wind
from tests.flight.test_geofences import BOTH
from tests.support.sitl_harness import SitlHarness
from tests.torture.harness import NARROW, WORLD
from tests.torture.wind import MEDIAN_MAX_S

# Three and a half kilometres round two gates, which are planned in a tenth of what the papers' maps take.
GATES = mission_from_text(
    WORLD.replace("{east_m: 1750, north_m: 750, up_m: 100}", "{east_m: 3400, north_m: 0, up_m: 100}")
    .replace("east_m: [-600, 2600]", "east_m: [-600, 4200]")
    .replace("total_planning_time_s: 80", "total_planning_time_s: 160")
    .replace("time_horizon_s: 8", "time_horizon_s: 15"),
    "gates.yaml",
)
WIND = (10, 135, 1)  # speed, where from, seed


def assert_it_is_known(mission, dialect, num_places, *, is_compared=True):
    """By a service that hears of the wind, and, where it is compared, not by one that does not."""
    ending, errors_s = fly_in_wind(mission, dialect, *WIND)
    assert ending == "goal"
    assert len(errors_s) >= num_places
    assert np.median(np.abs(errors_s)) <= MEDIAN_MAX_S
    if not is_compared:
        return
    with pytest.MonkeyPatch.context() as deaf:
        deaf.setattr(OwnshipEstimator, "_wind_now", lambda self, now_s: ((0.0, 0.0), 0.0))
        _, blind_s = fly_in_wind(mission, dialect, *WIND)
    # One that does not hear of it may pass no place at all that it expected to.
    assert not blind_s or np.median(np.abs(blind_s)) > 7.0 * MEDIAN_MAX_S


@BOTH
@pytest.mark.thorough
def test_where_it_will_be_in_half_a_minute_is_known_in_the_wind(dialect):
    assert_it_is_known(GATES, dialect, 24, is_compared=dialect is Dialect.ARDUPILOT)


@pytest.mark.slow
@BOTH
def test_it_is_known_on_narrow_maps(dialect):
    assert_it_is_known(NARROW["paper-2d"], dialect, 8)


def test_in_a_wind_too_strong_for_plans_what_is_flown_is_kept_and_the_pilot_told():
    mission = NARROW["paper-2d"]
    air = mission.simulation.model_copy(update={"wind_speed_m_s": 17.0, "wind_from_deg": 0.0})
    harness = SitlHarness(mission.model_copy(update={"simulation": air}), dialect=Dialect.ARDUPILOT)
    harness.fly(60.0)
    told = [entry for entry in harness.recorder.decisions if "over 60 % of cruise" in entry.text]
    assert [entry.kind for entry in told] == ["emergency"]
    words = re.fullmatch(r"keep the flown plan: wind of (\d+) m/s, over 60 % of cruise", told[0].text)
    assert int(words[1]) == pytest.approx(17, abs=1)  # as it is worked out a second after the start
    later = [entry for entry in harness.recorder.decisions if entry.stamp_s > told[0].stamp_s]
    assert [entry.kind for entry in later if entry.kind in ("swap", "rejected", "no plan")] == []
    assert not harness.simulator.truth.collision
