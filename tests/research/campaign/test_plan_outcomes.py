"""A row of a plan has what ``plan --json`` tells, and what the moving threats did to it."""

import itertools
import json
import math

import numpy as np
import pytest

from companion.config.load import mission_from_text, text_of
from companion.config.models import DynamicThreatConfig
from companion.research.campaign.campaign_spec import Campaign, CampaignConfig
from companion.research.campaign.engines.runners import Outcome, packed
from companion.research.campaign.plan_outcomes import PlanRunner
from companion.research.campaign.runs import plan_runs, result_of
from tests.support.sitl_harness import FIRST_FLIGHT

PLACE = {"pursuers": "tests.research.campaign.test_plan_outcomes:beside"}


def campaign(text=FIRST_FLIGHT, **more):
    config = CampaignConfig(name="c", kind="plans", missions=("m",), methods=("edbm",), seeds=(5, 6), **more)
    return Campaign("c.yaml", config, {"first-flight": text})


def beside(mission, path):
    """Threats that drive along with the aircraft: the first one 40 m aside, each next one twice as far."""
    tracks = []
    for n, _ in enumerate(mission.dynamic_threats):
        rows = np.column_stack([path.times_s, path.positions_enu_m[:, :2]])
        tracks.append(rows + np.array([0.0, 0.0, 40.0 * 2**n]))
    return tracks


def with_threats(number):
    mission = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")
    threats = tuple(
        DynamicThreatConfig(
            name=f"t{n}", east_m=100.0, north_m=1400.0, speed_m_s=5.0, max_threat_radius_m=120.0
        )
        for n in range(number)
    )
    return text_of(mission.model_copy(update={"dynamic_threats": threats, "obstacles": ()}))


def test_a_row_has_the_measures_of_plan():
    made = campaign()
    found = PlanRunner(made, {}).outcome(made.runs[1])
    mission = mission_from_text(FIRST_FLIGHT, "first-flight.yaml")
    _, (plan,) = plan_runs(mission, method="edbm", first_seed=6, runs=1, time_limit_s=None)
    told = result_of(plan)
    assert found.paths == {"path": told.pop("path")}
    assert told.pop("seed") == 6
    assert told.pop("method") == "edbm"
    assert found.timings.keys() == {"PST", "TSI"}
    told = {key: value for key, value in told.items() if key not in found.timings}
    assert found.measures == told | {
        "length_m": pytest.approx(plan.path.length_m, abs=1e-3),
        "duration_s": pytest.approx(plan.path.duration_s, abs=1e-3),
    }


def test_threats_are_summed_over_all_of_them():
    outcomes = []
    for number in (1, 2):
        made = campaign(with_threats(number))
        outcomes.append(PlanRunner(made, PLACE).outcome(made.runs[0]).measures)
    one, two = outcomes
    # At a standing distance d the threat is exp(-d⁴/R⁴) everywhere (paper (1)), R 120 m; heights add to d.
    mission = mission_from_text(with_threats(1), "m")
    levels = [math.exp(-((math.hypot(aside, 0.0) / 120.0) ** 4)) for aside in (40.0, 80.0)]
    assert mission.dimension == 2  # so that the threat is seen at the aircraft's height
    assert one["ADTP"] == pytest.approx(levels[0], abs=1e-6)
    assert two["ADTP"] == pytest.approx(1.0 - (1.0 - levels[0]) * (1.0 - levels[1]), abs=1e-6)
    points = one["TDTA"] / levels[0]
    assert points == pytest.approx(round(points), abs=1e-6)
    assert two["TDTA"] / (levels[0] + levels[1]) == pytest.approx(round(two["TDTA"] / sum(levels)), abs=1e-6)
    assert one["ETDTA/TDTA"] == pytest.approx(one["ETDTA"] / one["TDTA"])


def test_without_somebody_who_drives_there_is_no_such_measure():
    made = campaign(with_threats(1))
    assert "TDTA" not in PlanRunner(made, {}).outcome(made.runs[0]).measures


def test_a_budget_ends_a_plan(monkeypatch):
    """The clock jumps by a second at each look, so that the search is told to stop when it first asks."""
    looks = itertools.count()
    made = campaign(budget_s=0.5)
    runner = PlanRunner(made, {})
    runner.warm_up()
    monkeypatch.setattr(
        "companion.research.campaign.plan_outcomes.time.perf_counter", lambda: float(next(looks))
    )
    found = runner.outcome(made.runs[0]).measures
    assert (found["success"], found["status"]) == (False, "approximate")


def test_what_is_packed_is_the_same_for_the_same_and_has_no_numbers_that_json_lacks():
    made = packed(Outcome({"b": math.inf, "a": 1.0}, {"t": math.nan}, {"path": [[1.0]]}))
    assert (made.measures, made.timings) == ('{"a": 1.0, "b": null}', '{"t": null}')
    assert json.loads(made.measures) == {"a": 1.0, "b": None}
    assert packed(Outcome()).paths == b""
    with pytest.raises(ValueError, match="JSON"):
        packed(Outcome(paths={"path": [[math.nan]]}))
