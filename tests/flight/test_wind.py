"""Flights in the wind know when they will be where; beside the same flights that hear of none."""

import re

import numpy as np
import pytest

from companion.tracking.ownship import OwnshipEstimator
from companion.types.events import Dialect
from tests.support.sitl_harness import SitlHarness
from tests.torture.harness import NARROW
from tests.torture.wind import MEDIAN_MAX_S, windy_flight


@pytest.mark.parametrize("dialect", [Dialect.ARDUPILOT, pytest.param(Dialect.PX4, marks=pytest.mark.slow)])
def test_where_it_will_be_in_half_a_minute_is_known_in_the_wind(dialect, monkeypatch):
    case = ("paper-2d", dialect, 10, 135, 1)
    _, how, errors_s = windy_flight(case)
    assert how == "goal"
    assert len(errors_s) >= 8
    assert np.median(np.abs(errors_s)) <= MEDIAN_MAX_S
    monkeypatch.setattr(OwnshipEstimator, "_wind_now", lambda self, now_s: ((0.0, 0.0), 0.0))
    _, _, blind_s = windy_flight(case)
    assert np.median(np.abs(blind_s)) > 7.0 * MEDIAN_MAX_S


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
