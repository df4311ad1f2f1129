"""The section ``energy``: what is refused, and what ``companion check`` makes of it."""

import io
import re

import pytest
from rich.console import Console

from companion.config import mission_from_text
from companion.config.compose import energy_budget_of, goals_of, power_model_of, wind_of
from companion.config.mission_summary import energy_table, mission_budget, mission_summary
from companion.errors import ConfigError
from tests.sim.client import PLAIN

KEYS = {
    "power_cruise_w": 400.0, "power_max_airspeed_w": 1_000.0, "climb_energy_j_m": 100.0,
    "capacity_wh": 100.0, "reserve_wh": 20.0,
}  # fmt: skip


def text_with(extra="", **changes):
    keys = {**KEYS, **changes}
    section = "".join(f"  {key}: {value}\n" for key, value in keys.items() if value is not None)
    return f"{PLAIN}energy:\n{section}{extra}"


def fault(text):
    with pytest.raises(ConfigError) as caught:
        mission_from_text(text, "m.yaml")
    return caught.value


def test_without_the_section_energy_is_not_considered():
    mission = mission_from_text(PLAIN, "m.yaml")
    assert mission.energy is None
    assert power_model_of(mission) is None
    assert energy_budget_of(mission, goals_of(mission)) is None
    assert "energy" not in mission_summary(mission)


def test_the_powers_are_those_of_the_file():
    model = power_model_of(mission_from_text(text_with(), "m.yaml"))
    assert model.power_w(25.0) == pytest.approx(400.0)
    assert model.power_w(37.5) == pytest.approx(1_000.0)
    assert model.power_w(25.0, 2.0) == pytest.approx(600.0)


@pytest.mark.parametrize(
    ("changes", "key", "expected"),
    [
        # 400/1.5 W, and 400 * 1.5 ** 3 W.
        ({"power_max_airspeed_w": 260.0}, "energy.power_max_airspeed_w", "between 266.7 and 1350"),
        ({"power_max_airspeed_w": 1_357.0}, "energy.power_max_airspeed_w", "a negative drag"),
        ({"reserve_wh": 100.5}, "energy.reserve_wh", "at most capacity_wh, 100"),
        ({"power_cruise_w": 0.0}, "energy.power_cruise_w", "greater than 0 (watts)"),
        ({"climb_energy_j_m": -1.0}, "energy.climb_energy_j_m", "at least 0 (joules per metre)"),
        ({"capacity_wh": ".inf"}, "energy.capacity_wh", "finite"),
        ({"capacity_wh": None}, "energy.capacity_wh", "a value for this key (watt-hours)"),
        ({"power_cruise_kw": 0.4}, "energy.power_cruise_kw", "power_cruise_w"),
    ],
)
def test_what_cannot_be_is_refused_with_what_is_expected(changes, key, expected):
    error = fault(text_with(**changes))
    assert error.key == key
    assert expected in error.expected


@pytest.mark.parametrize("power", [265.8, 266.7, 1_349.9, 1_356.0])
def test_the_ends_of_the_range_are_taken_even_if_they_are_rounded(power):
    model = power_model_of(mission_from_text(text_with(power_max_airspeed_w=power), "m.yaml"))
    assert min(model.parasite_w_s3_m3, model.induced_w_m_s) >= -1e-9


def test_an_aircraft_of_one_airspeed_has_no_model():
    text = re.sub("airspeed_max_m_s: .*", "airspeed_max_m_s: 25", text_with())
    error = fault(text)
    assert error.key == "vehicle.airspeed_max_m_s"
    assert "power of two airspeeds" in error.expected


def test_the_budget_of_the_file_worked_by_hand():
    """To 1750 E 750 N in 5 m/s of west wind: 1903.9 m on a course of 66.8 degrees."""
    text = text_with("simulation: {wind_speed_m_s: 5, wind_from_deg: 270}\n")
    mission = mission_from_text(text, "m.yaml")
    assert wind_of(mission) == pytest.approx((5.0, 0.0), abs=1e-9)
    way, along = 1_903.943, 5.0 * 1_750.0 / 1_903.943
    across_square = 25.0 - along**2
    there, back = ((25.0**2 - across_square) ** 0.5 + sign * along for sign in (1.0, -1.0))
    (goal,) = mission_budget(mission).goals
    assert goal.used_wh == pytest.approx(400.0 * way / there / 3_600.0, rel=1e-6)
    assert goal.left_after_return_wh == pytest.approx(100.0 - 400.0 * way * (1 / there + 1 / back) / 3_600.0)
    told = mission_summary(mission)["energy"]
    assert told["goals"] == [
        {key: round(getattr(goal, key), 3) for key in ("used_wh", "left_wh", "left_after_return_wh")}
    ]
    assert told["wind_enu_m_s"] == [5.0, 0.0]
    assert told["margin_after_return_wh"] == pytest.approx(goal.left_after_return_wh - 20.0, abs=1e-3)


def test_the_table_tells_numbers_and_verdict():
    mission = mission_from_text(text_with(capacity_wh=9.0, reserve_wh=2.0), "m.yaml")
    screen = Console(width=120, file=io.StringIO())
    screen.print(energy_table(mission, mission_budget(mission)))
    told = " ".join(screen.file.getvalue().split())
    assert "9 Wh at the start, straight legs at cruise, no wind" in told
    assert "8.5 Wh" in told  # 1903.9 m at 25 m/s and 400 W.
    assert "the reserve of 2 Wh missed by 1.5 Wh" in told


def test_goals_of_the_operator_have_no_budget_before_they_are_known():
    text = re.sub(r"goals:\n  - .*\n", "goals: from_autopilot\n", text_with())
    mission = mission_from_text(text, "m.yaml")
    assert mission_budget(mission) is None
    assert "energy" not in mission_summary(mission)


def test_turning_back_needs_the_section():
    found = fault(f"{PLAIN}authority: {{turn_back: true}}\n")
    assert (found.key, found.expected) == ("authority.turn_back", "false, since there is no section energy")
    assert mission_from_text(text_with("authority: {turn_back: true}\n"), "m.yaml").authority.turn_back
