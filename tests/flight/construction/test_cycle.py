"""One planning cycle with hand-made paths: which plan is flown, from where, and how it ends."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import mission_from_text
from companion.config.compose import world_of
from companion.flight.construction.cycle import conclude, conclude_either, flown_passes
from companion.flight.replanning.plan_maker import Planner, plan_request
from companion.flight.state.decision import Verdict, judge
from companion.flight.state.flight_state import after_position, first_state
from companion.flight.state.list_state import FlownPath
from companion.flight.state.progress import Start, as_of_now, is_on_last_leg, lead_s, start_after, start_at
from companion.mission.waypoints import merge_close_waypoints
from companion.planning.plan_runner import StopRule
from companion.planning.problem import GoalRegion
from companion.types.mission import Mission
from companion.types.plan import Measures, Plan, PlanStatus, PursuitRisk
from companion.types.state import Ownship
from companion.types.threat import ThreatPicture, TrackState
from tests.mission.made import path_along, waypoints
from tests.sim.client import PLAIN

EAST = 0.5 * math.pi
OPEN = PLAIN.replace(
    "  - {east_m: 1750, north_m: 750, up_m: 100}",
    "  - {east_m: 1500, north_m: 0, up_m: 100, acceptance_radius_m: 400}",
).replace("total_planning_time_s: 80", "total_planning_time_s: 80, threat_level_max: 0.2")
CORNERS = "[[{1}, {2}], [{3}, {2}], [{3}, {4}], [{1}, {4}]]"
BLOCK = "  - {{name: {0}, polygon_enu_m: " + CORNERS + ", base_m: 0, top_m: 300}}\n"
WALL = "obstacles:\n" + BLOCK.format("wall", 700, -100, 750, 100)


FAR_OFF = TrackState(
    0.0, "truck", (0.0, 9000.0, 0.0), (0.0, 0.0, 0.0), np.eye(4), 1.0, 100.0, 15.0, is_airborne=False,
    observed_s=0.0,
)  # fmt: skip


def begun(extra="", text=OPEN):
    """The state of a flight that has just begun."""
    return first_state(mission_from_text(text + extra, "open.yaml"), 0.0)


def straight(north=0.0, levels=0.0, rows=60):
    """East along a line, 25 m and 1 s a row, 1500 m in all."""
    path = path_along((25.0 * rows, rows), course=EAST)
    places = path.positions_enu_m + np.array([0.0, north, 0.0])
    return replace(path, positions_enu_m=places, threat_levels=np.full(len(path), levels))


def plan(path, cost=100.0, flown_cost=None, flown_threat=0.0, status=PlanStatus.EXACT, notes=()):
    return Plan(
        status, path, Measures(path_cost=cost), 1, "safe-rrt", 1, notes=notes,
        flown_cost=flown_cost, flown_threat=flown_threat,
    )  # fmt: skip


def start(rest=None):
    return Start(None, rest)


def state(east=0.0, north=0.0, up=100.0, course=EAST, speed=25.0, stamp=50.0):
    return Ownship(stamp, (east, north, up), course, 0.0, 25.0, speed)


def flying(made, path, covered_until_s=math.inf, row=0, cost=math.inf):
    return replace(made, flown=FlownPath(path, Mission((), 1, 1), covered_until_s, row, cost))


# --- judging


def test_nothing_flown_yet():
    judged = judge(begun(), plan(straight()), start())
    assert (judged.verdict.is_swap, judged.verdict) == (True, Verdict.FIRST_PLAN)


@pytest.mark.parametrize(
    "found",
    [
        plan(None, status=PlanStatus.INVALID_START, notes=("in an obstacle",)),
        plan(straight(), status=PlanStatus.APPROXIMATE, notes=("budget",)),
    ],
)
def test_a_plan_that_does_not_arrive_is_none(found):
    judged = judge(begun(), found, start())
    assert (judged.verdict.is_swap, judged.verdict) == (False, Verdict.NO_PLAN)
    assert found.notes[0] in judged.text
    assert found.status.value in judged.text


def test_a_plan_through_a_wall_is_rejected():
    judged = judge(begun(WALL), plan(straight()), start())
    assert (judged.verdict.is_swap, judged.verdict) == (False, Verdict.REJECTED)
    assert "clearance" in judged.text


def test_a_plan_that_ends_elsewhere_is_rejected():
    judged = judge(begun(), plan(straight(rows=40)), start())  # 500 m short of it, 400 m are allowed
    assert (judged.verdict.is_swap, judged.verdict) == (False, Verdict.REJECTED)


def test_a_rejected_plan_stays_so_whatever_is_flown():
    judged = judge(begun(WALL), plan(straight(), 1.0, 100.0), start(straight(north=300.0)))
    assert (judged.verdict.is_swap, judged.verdict) == (False, Verdict.REJECTED)


def threatened(first, later):
    levels = np.full(61, later)
    levels[0] = first
    return replace(straight(), threat_levels=levels)


@pytest.mark.parametrize(
    ("first", "later", "kind"), [(0.1, 0.2, "first plan"), (0.1, 0.3, "rejected"), (0.3, 0.3, "first plan")]
)
def test_threat_levels_are_limited_but_for_a_way_out(first, later, kind):
    assert judge(begun(), plan(threatened(first, later)), start()).verdict.value == kind


def test_the_flown_path_has_become_unsafe():
    judged = judge(begun(WALL), plan(straight(north=300.0), 500.0, 100.0), start(straight()))
    assert (judged.verdict.is_swap, judged.verdict) == (True, Verdict.UNSAFE)
    assert "clearance" in judged.text


def test_what_breaks_only_a_threat_limit_can_be_flown_where_nothing_better_is():
    soft = judge(begun(), plan(threatened(0.1, 0.3)), start())
    hard = judge(begun(WALL), plan(threatened(0.1, 0.3)), start())
    assert (soft.verdict, soft.is_flyable_in_emergency) == (Verdict.REJECTED, True)
    assert (hard.verdict, hard.is_flyable_in_emergency) == (Verdict.REJECTED, False)
    assert not judge(begun(), plan(straight()), start()).is_flyable_in_emergency


def test_beside_a_flown_path_that_passes_no_emergency_plan_is_wanted():
    """The pilot then reads that the flown path is kept, and of no emergency."""
    flown, found = straight(), replace(plan(threatened(0.1, 0.3), 50.0), flown_cost=100.0)
    made, begin = flying(begun(), flown), start(flown)
    decided, emergency = conclude_either(made, found, begin, None, least_gain=0.05)
    assert (decided.decision.verdict, emergency) == (Verdict.REJECTED, None)
    assert flown_passes(made, begin)


@pytest.mark.parametrize(("reached_s", "flown_s"), [(0.0, 12.0), (40.0, 60.0), (8.0, 0.0)])
@pytest.mark.parametrize(("cost", "verdict"), [(90.0, Verdict.BETTER), (110.0, Verdict.KEEP)])
def test_costs_decide_since_they_hold_how_long_pursuers_could_reach_a_path(reached_s, flown_s, cost, verdict):
    found = replace(
        plan(straight(), cost, 100.0),
        pursuit=PursuitRisk(70.0, reached_s),
        flown_pursuit=PursuitRisk(70.0, flown_s),
    )
    assert judge(flying(begun(), straight()), found, start(straight())).verdict is verdict


@pytest.mark.parametrize(
    ("cost", "later_s", "promised", "is_pursued", "kind"),
    [
        (76.0, 1.0, 100.0, True, "keep"),
        (74.0, 1.0, 100.0, True, "better"),
        (94.0, 0.0, 100.0, True, "better"),
        (94.0, 1.0, 99.0, True, "better"),
        (94.0, 1.0, 100.0, False, "better"),
    ],
)
def test_a_safe_path_as_good_as_promised_is_left_for_a_later_arrival_only_for_a_quarter_less(
    cost, later_s, promised, is_pursued, kind
):
    """The flown path costs 100 now. Where that is more than promised, or nobody pursues, 5 % are enough."""
    path = straight()
    later = replace(path, times_s=path.times_s * (1.0 + later_s / path.times_s[-1]))
    found = replace(plan(later, cost, 100.0), flown_pursuit=PursuitRisk())
    made = flying(begun(), straight(), cost=promised)
    if is_pursued:
        made = replace(made, picture=ThreatPicture(tracks=(FAR_OFF,)))
    judged = judge(made, found, start(straight()))
    assert judged.verdict.value == kind
    assert judged.holds_flown is (is_pursued and promised == 100.0)


@pytest.mark.parametrize(("cost", "kind"), [(94.9, "better"), (95.1, "keep"), (120.0, "keep")])
def test_better_by_a_twentieth(cost, kind):
    made = flying(begun(), straight())
    judged = judge(made, plan(straight(), cost, 100.0), start(straight()))
    assert (judged.verdict.is_swap, judged.verdict.value) == (kind == "better", kind)


@pytest.mark.parametrize(("covered_s", "kind"), [(32.4, "extend"), (32.6, "keep"), (60.0, "keep")])
def test_a_mission_is_extended_when_less_than_22_seconds_and_a_half_are_left(covered_s, kind):
    """The rest begins at row 10, at 10 s; 1.5 horizons of 15 s."""
    made = flying(begun(), straight(), covered_s)
    rest = replace(straight(), **{name: getattr(straight(), name)[10:] for name in straight().__slots__})
    judged = judge(made, plan(straight(), 100.0, 100.0), start(rest))
    assert (judged.verdict.is_swap, judged.verdict.value) == (kind == "extend", kind)


def test_a_rest_too_short_to_be_costed_counts_as_none():
    assert judge(begun(), plan(straight(), 100.0, None), start(straight())).verdict is Verdict.FIRST_PLAN


# --- goals and progress

TWO_GOALS = OPEN.replace(
    "  - {east_m: 1500",
    "  - {east_m: 500, north_m: 0, up_m: 100, acceptance_radius_m: 60}\n  - {east_m: 1500",
)


def test_goals_are_counted_in_order():
    made = begun(text=TWO_GOALS)
    made = after_position(made, state(1500.0))
    assert not made.has_arrived  # the second one is not next
    assert len(made.goals_left) == 2
    made = after_position(made, state(445.0, 30.0))  # 62.6 m away
    assert not made.has_arrived
    made = after_position(made, state(445.0, 20.0))  # 58.5 m
    assert not made.has_arrived
    assert len(made.goals_left) == 1
    made = after_position(made, state(1000.0))
    assert not made.has_arrived
    made = after_position(made, state(1150.0))
    assert made.has_arrived
    assert made.goals_left == ()
    assert after_position(made, state(0.0)).has_arrived


def test_height_counts_for_a_goal():
    made = begun(text=TWO_GOALS)
    made = after_position(made, state(500.0, 0.0, 165.0))
    assert len(made.goals_left) == 2


def test_the_way_along_the_flown_path_only_goes_on():
    made = flying(begun(), straight())
    made = after_position(made, state(260.0))
    assert made.flown.row == 10
    made = after_position(made, state(100.0))
    assert made.flown.row == 10


def test_lead_by_hand():
    """1 s of planning, 2 s of margin, and an exchange of 1.3 times the longest of the last, or 0.3 s."""
    made = begun()
    expected_s = made.mission_list.exchange_s
    assert lead_s(made) == pytest.approx(1.0 + 2.0 + expected_s)
    assert lead_s(made, is_urgent=True) == pytest.approx(0.2 + 0.3 + expected_s)
    for durations_s, exchange_s in (((0.1,), 0.3), ((2.0, 1.0), 2.6)):
        measured = replace(made, mission_list=replace(made.mission_list, durations_s=durations_s))
        assert lead_s(measured) == pytest.approx(1.0 + 2.0 + exchange_s)
        assert lead_s(measured, is_urgent=True) == pytest.approx(0.2 + 0.3 + exchange_s)


@pytest.mark.parametrize(("east", "is_last"), [(1100.0, False), (1150.0, True)])
def test_the_last_leg(east, is_last):
    """5 s of lead and 10 s: 375 m from the end."""
    assert is_on_last_leg(flying(begun(), straight(), row=40), state(east), 5.0) is is_last


def test_a_path_not_carried_to_its_end_has_no_last_leg():
    assert not is_on_last_leg(flying(begun(), straight(), 50.0, row=50), state(1300.0), 5.0)
    assert not is_on_last_leg(begun(), state(1300.0), 5.0)


@pytest.mark.parametrize(("north", "is_last"), [(0.0, True), (700.0, False)])
def test_the_last_leg_has_no_goal_left_beside_it(north, is_last):
    """Another member's goal may be won while the aircraft flies to its own last one."""
    made = flying(begun(), straight(), row=40)
    won = GoalRegion((1300.0, north, 100.0), 60.0)
    made = replace(made, goals=(won, *made.goals))
    assert is_on_last_leg(made, state(1150.0), 5.0) is is_last


# --- where a plan begins


def test_a_plan_begins_on_the_flown_path():
    """At 500 m and 25 m/s, in 3.5 s: between rows 23 and 24, so from row 24, half a second later."""
    made = flying(begun(), straight())
    begin = start_after(made, state(500.0, 10.0), 3.5)
    assert len(begin.rest) == 61 - 24
    assert begin.state.stamp_s == pytest.approx(50.0 + 3.5 + 0.5)
    assert begin.state.position_enu_m == pytest.approx((600.0, 0.0, 100.0))
    assert begin.state.direction_rad == pytest.approx(0.0)
    assert begin.state.airspeed_m_s == 25.0


def test_against_the_wind_it_begins_earlier_on_it():
    """At 20 m/s over the ground 3.5 s are 70 m: row 22.8, so from row 23."""
    begin = start_after(flying(begun(), straight()), state(500.0, speed=20.0), 3.5)
    assert len(begin.rest) == 61 - 23


@pytest.mark.parametrize(("north", "is_on"), [(79.0, True), (81.0, False)])
def test_off_the_path_a_plan_begins_where_the_aircraft_is_going(north, is_on):
    begin = start_after(flying(begun(), straight()), state(500.0, north), 4.0)
    assert (begin.rest is not None) is is_on
    if not is_on:
        assert begin.state.position_enu_m == pytest.approx((600.0, north, 100.0))
        assert begin.state.stamp_s == 54.0


def test_without_a_path_or_at_its_end_too():
    assert start_after(begun(), state(), 4.0).rest is None
    assert start_after(flying(begun(), straight(), row=50), state(1450.0), 4.0).rest is None


def test_a_start_keeps_the_aircrafts_limits_and_the_missions_level():
    slow = replace(state(up=107.0), airspeed_m_s=9.0, flight_path_angle_rad=0.3)
    begin = start_after(begun(), slow, 4.0).state
    assert (begin.airspeed_m_s, begin.climb_rad, begin.position_enu_m[2]) == (12.5, 0.0, 100.0)


# --- planning


def test_equal_flights_plan_alike_and_the_next_plan_is_another():
    made, first, second = begun(WALL), Planner(1), Planner(1)
    begin = start_after(made, state(stamp=0.0), 4.0)
    request = plan_request(made, begin, world_of(mission_from_text(OPEN + WALL, "open.yaml")))
    one, other = (planner.plan(request, lambda: False) for planner in (first, second))
    assert one.reaches_goal
    np.testing.assert_array_equal(one.path.positions_enu_m, other.path.positions_enu_m)
    assert one.seed == other.seed == 100_004
    assert first.plan(request, lambda: False).seed == 100_005
    assert judge(begun(WALL), one, begin).verdict is Verdict.FIRST_PLAN


def test_once_the_last_goal_is_reached_the_rest_of_the_path_is_assessed_for_nothing():
    """Another member won the next goal before the aircraft had flown its path to the end."""
    made, world = begun(), world_of(mission_from_text(OPEN, "open.yaml"))
    begins = start_after(flying(made, straight()), state(100.0, stamp=4.0), 1.0)
    assert as_of_now(made, begins, world).risk is not None
    assert as_of_now(replace(made, next_goal=1), begins, world) is begins


def test_an_urgent_plan_is_not_kept_waiting_for_a_shorter_one():
    """In space, where paths are optimised for as long as that gains."""
    text = OPEN.replace("dimension: 2", "dimension: 3").replace(
        "planning: {", "planning: {method: safe-rrt-rs, "
    )
    made, asked = begun(WALL, text), {}
    begin = start_after(made, state(stamp=0.0), 4.0)
    world = world_of(mission_from_text(text + WALL, "open.yaml"))
    for is_urgent in (False, True):
        rule = StopRule(lambda _asked: False)
        Planner(1).plan(plan_request(made, begin, world, is_urgent=is_urgent), rule)
        asked[is_urgent] = rule.asked
    assert asked[True] < asked[False]


def crowded(*places):
    """Waypoints, and what the checker says of the legs to them from 300 m before the first."""
    made, checker = waypoints(*places), begun().rules.checker

    def wrong_with(found):
        legs = np.vstack([np.asarray(places[0]) - [300.0, 0.0, 0.0], found.positions_enu_m])
        return checker.check_legs(legs, ends_in_loiter=True, loiter_radius_m=125.0)

    return made, wrong_with


def test_waypoints_too_close_for_their_turns_lose_one():
    # Two corners of 40 degrees 12 m apart: each needs 125 m · tan(20°) = 45 m of the leg between them.
    made, wrong_with = crowded((0, 0, 100), (200, 0, 100), (209, 8, 100), (350, 300, 100), (600, 800, 100))
    assert {entry.rule for entry in wrong_with(made)} == {"corner"}
    kept, violations = merge_close_waypoints(made, wrong_with)
    assert violations == ()
    assert len(kept.positions_enu_m) == len(kept.distances_m) == 4
    assert (kept.positions_enu_m[[0, -1]] == made.positions_enu_m[[0, -1]]).all()


def test_waypoints_through_a_wall_are_not_mended():
    made, wrong_with = crowded((0, 0, 100), (900, 0, 100), (1300, 0, 100))
    walled = begun(WALL).rules.checker

    def wrong(found):
        legs = np.vstack([[-300.0, 0.0, 100.0], found.positions_enu_m])
        return walled.check_legs(legs, ends_in_loiter=True, loiter_radius_m=125.0)

    kept, violations = merge_close_waypoints(made, wrong)
    assert wrong_with(made) == ()
    assert {entry.rule for entry in violations} == {"clearance"}
    assert kept is made


@given(st.lists(st.tuples(st.floats(5, 300), st.floats(-1.2, 1.2)), min_size=3, max_size=8))
def test_mending_never_claims_what_the_checker_denies(steps):
    places, course = [(0.0, 0.0, 100.0)], EAST
    for length, turn in steps:
        course += turn
        places.append(
            (places[-1][0] + length * math.sin(course), places[-1][1] + length * math.cos(course), 100.0)
        )
    made, wrong_with = crowded(*places)
    kept, violations = merge_close_waypoints(made, wrong_with)
    assert violations == wrong_with(kept)
    assert len(violations) <= len(wrong_with(made))
    assert set(map(tuple, kept.positions_enu_m)) <= set(map(tuple, made.positions_enu_m))


# --- what is judged


def test_the_wind_is_the_one_told_last():
    made = after_position(begun(), replace(state(), wind_enu_m_s=(3.0, -1.0)))
    assert made.wind_enu_m_s == (3.0, -1.0)


def test_of_two_paths_that_both_cost_endlessly_the_flown_one_is_kept():
    made = flying(begun(), straight())
    judged = judge(made, plan(straight(north=100.0), math.inf, math.inf), start(straight()))
    assert (judged.verdict.is_swap, judged.verdict) == (False, Verdict.KEEP)
    assert judged.why["gain"] == 0.0


# --- hurried plans


def hurried_beside(walls_m):
    """What a plan along 3 km at 37.5 m/s comes to between walls so far away, and the plan."""
    sides = [
        BLOCK.format(f"wall_{side}", -900, side * walls_m, 4000, side * (walls_m + 50)) for side in (-1, 1)
    ]
    made = begun("obstacles:\n" + "".join(sides), OPEN.replace("east_m: 1500", "east_m: 3000"))
    path = straight(rows=120)
    path = replace(path, times_s=path.times_s / 1.5, speeds_m_s=np.full(len(path), 37.5))
    begin = start_at(
        made.rules, state(speed=37.5, stamp=0.0), 0.0, (0.0, 0.0, 100.0),
        course_rad=EAST, climb_rad=0.0, airspeed_m_s=37.5,
    )  # fmt: skip
    world = world_of(made.mission)
    return conclude(made, plan(path), begin, world).constructed, path


def test_a_hurried_plan_that_can_only_be_carried_slower_is_later_everywhere():
    """Between walls 330 m away there is room for circles at 25 m/s, 270 m wide, but for none at 37.5 m/s."""
    constructed, path = hurried_beside(1500.0)
    assert constructed.waypoints.airspeed_m_s == 37.5
    assert constructed.path is path
    constructed, path = hurried_beside(330.0)
    assert constructed.waypoints.airspeed_m_s == 25.0
    # 37.5 to 25 m/s at 1 m/s²: 390.6 m in 12.5 s; the other 2609.4 m at 25 m/s in 104.4 s.
    assert constructed.path.times_s[-1] == pytest.approx(116.9, abs=0.3)
    assert constructed.path.speeds_m_s[[0, -1]].tolist() == [37.5, 25.0]
    at_end = float(
        np.interp(
            constructed.covered_until_s, constructed.path.times_s, constructed.path.positions_enu_m[:, 0]
        )
    )
    assert at_end == pytest.approx(float(constructed.waypoints.positions_enu_m[-1, 0]), abs=30.0)


def test_a_hurried_plan_is_judged_as_it_is_carried(monkeypatch):
    """With the threat levels of then: beyond their limit it is not flown."""
    seen = []

    def judged(made, found, begin):
        seen.append(found)
        return judge(made, found, begin)

    monkeypatch.setattr("companion.flight.construction.cycle.judge", judged)
    hurried_beside(1500.0)
    assert [found.path.duration_s for found in seen] == pytest.approx([80.0])
    seen.clear()
    hurried_beside(330.0)
    assert [found.path.duration_s for found in seen] == pytest.approx([80.0, 116.9], abs=0.3)
    monkeypatch.setattr(
        "companion.flight.construction.cycle.reassessed",
        lambda _, path: (replace(path, threat_levels=np.linspace(0.0, 1.0, len(path))), PursuitRisk()),
    )
    assert hurried_beside(330.0)[0] is None
