"""The prediction of a recorded flight, from a recording made by hand."""

import pytest

from tests.energy.recorded_prediction import prediction_of
from tests.ui.page.flown import Told


def told_energy(left_wh):
    return {"left_wh": left_wh, "ratio": 1.0, "home_wh": 5.0, "margin_wh": 9.0, "turn_back_in_s": 99.0}


def test_predicted_and_used_from_the_first_plan_to_the_goal(tmp_path):
    told = Told(lambda *_: None, tmp_path)
    for stamp_s, left_wh in ((1.0, 61.0), (2.0, 60.0)):
        told.recorder.energy(stamp_s, told_energy(left_wh))
    told.recorder.decide(2.5, "swap", "first plan", 10.0, why={"left_at_goal_wh": 49.0})
    told.recorder.decide(30.0, "swap", "better", 9.0, why={"left_at_goal_wh": 51.0})
    told.recorder.energy(60.0, told_energy(50.0))
    told.recorder.decide(60.5, "arrived", "at the last goal")
    told.recorder.energy(70.0, told_energy(45.0))
    told.recorder.close()
    found = prediction_of(tmp_path)
    assert (found.predicted_wh, found.used_wh) == (11.0, 10.0)
    assert found.error == pytest.approx(0.1)


def test_a_flight_that_did_not_reach_its_goal_is_refused(tmp_path):
    told = Told(lambda *_: None, tmp_path)
    told.recorder.energy(1.0, told_energy(61.0))
    told.recorder.close()
    with pytest.raises(ValueError, match="the goal was not reached"):
        prediction_of(tmp_path)
