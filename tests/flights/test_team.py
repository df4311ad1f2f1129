"""Two aircraft fly towards each other: with a team they pass apart, without one they nearly meet."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import sim.sitl
from companion.clock import ManualClock
from companion.config import load_mission, mission_from_text
from companion.flight.construction import way_behind
from companion.flight.exchange import announced_plan
from companion.flight.exchange.announced_plan import WAITS_S
from companion.flight.replanning import replanning
from companion.mission.list_layout import TEAM_BANK_ITEMS
from companion.types.events import Dialect
from sim.team.team_flight import NoPlaceError, TeamFlight, fly_team, team_missions
from tests.flight.replanning.test_surprise import LONG, ahead
from tests.flight.test_geofences import BOTH, CIRCLE_OUT, fence
from tests.mission.team.disturbed_flights import Disturbed
from tests.mission.team.shared_goal_flights import flown as flown_without_one
from tests.mission.team.shared_goal_flights import mission_of
from tests.mission.team.street_flights import PlacedTeam
from tests.mission.team.street_flights import flown as in_streets
from tests.sim.client import CONFIGS

FENCED_S = 30.0


def flown(mission, num, loss, dialect=Dialect.PX4, seed=1, *, kind=TeamFlight, **more):
    weather = mission.simulation.model_copy(update={"radio_loss": loss})
    team = kind(mission.model_copy(update={"simulation": weather}), num, seed, dialect, **more)
    fly_team(team)
    return team


@BOTH
def test_two_that_fly_towards_each_other_agree_to_pass_apart(dialect):
    team = flown(mission_from_text(LONG, "long.yaml"), 2, 0.2, dialect)
    assert sorted(team.arrived_s) == [1, 2]
    assert team.is_separate
    assert team.hit_s == {}
    nearest_m = team.summary()["nearest_m"]
    assert nearest_m > 60.0
    for flight in team.flights:
        assert flight.app.replanning.team.agreement.committed is not None
        assert not any("heard, too" in decision.text for decision in flight.recorder.decisions)
        if dialect is Dialect.ARDUPILOT:
            assert flight.app.state.mission_list.layout.size == TEAM_BANK_ITEMS


class CreepingClock(ManualClock):
    """A clock that goes on while the service works, as that of every computer: a microsecond a reading."""

    def now_s(self):
        self._now_s += 1e-6
        return self._now_s


def test_a_plan_is_proposed_while_time_passes(monkeypatch):
    monkeypatch.setattr(sim.sitl, "ManualClock", CreepingClock)
    team = flown(mission_from_text(LONG, "long.yaml"), 2, 0.2)
    assert sorted(team.arrived_s) == [1, 2]
    assert team.is_separate


@pytest.mark.thorough
def test_without_messages_they_nearly_meet():
    team = flown(mission_from_text(LONG, "long.yaml"), 2, 0.0, shares=False)
    assert not team.is_separate
    assert team.summary()["nearest_m"] < 60.0


@pytest.mark.thorough
@pytest.mark.parametrize("shares_landing", [True, False], ids=["shared", "not shared"])
def test_two_whose_landings_cross_fly_to_them_one_after_the_other(shares_landing, monkeypatch):
    """Each PX4 flies back past the other one's goal. Beside it a flight in which only paths are shared."""
    if not shares_landing:
        monkeypatch.setattr(way_behind, "_legs_behind", lambda _state: ([], None))
    team = flown(mission_from_text(LONG, "long.yaml"), 2, 0.2, linger_s=150.0)
    assert sorted(team.arrived_s) == [1, 2]
    assert team.is_separate is shares_landing
    texts = [entry.text for flight in team.flights for entry in flight.recorder.decisions]
    assert sum("waits before the goal" in text for text in texts) == shares_landing  # One of them.


@pytest.mark.thorough
@pytest.mark.parametrize("apart_m", [0.0, 40.0], ids=["same height", "own heights"])
@BOTH
def test_two_that_return_towards_each_other_are_kept_apart_by_their_return_heights_only(
    dialect, apart_m, monkeypatch
):
    """Returns are not agreed: on one height these two come within 40 m. Both pilots have half a minute.

    That the heights are too near is told before: when the autopilots' parameters are known.
    """
    monkeypatch.setattr(sim.sitl.Flight, "limit_s", 150.0)
    team = Disturbed(mission_from_text(LONG, "long.yaml"), 2, 1, dialect)
    for number, flight in enumerate(team.flights):
        parameters = flight.simulator.autopilot.parameters
        parameters[dialect.parameter_names["return_height_m"]] = 100.0 + number * apart_m
    team.switched = [(110.0, 1, "RTL"), (110.0, 2, "RTL")]
    fly_team(team)
    away_m, up_m, nearest_s = team.least_m[1, 2]
    assert team.is_separate is (apart_m > 0.0)
    for flight in team.flights:
        decided = flight.recorder.decisions
        checks = [entry.stamp_s for entry in decided if "RTL height near system" in entry.text]
        assert [stamp_s < 30.0 for stamp_s in checks] == ([] if apart_m else [True])
        if not apart_m:
            assert away_m < 60.0
            assert up_m < 20.0
            told_s = [entry.stamp_s for entry in decided if entry.kind == "traffic"]
            assert told_s[0] > 110.0  # Not before, while both fly what they have agreed to.
            assert nearest_s - told_s[0] > 25.0


@pytest.mark.thorough
@BOTH
def test_of_two_that_come_to_a_narrow_gap_from_both_sides_one_lets_the_other_pass(dialect):
    """160 m between two walls, and no other way: less than two aircraft keep between them and the walls."""
    walls = "obstacles:\n" + "".join(
        f"  - {{name: {name}, base_m: 0, top_m: 300, polygon_enu_m: "
        f"[[1980, {low}], [2020, {low}], [2020, {high}], [1980, {high}]]}}\n"
        for name, low, high in (("south_wall", -1500, -80), ("north_wall", 80, 1500))
    )
    bounds = "east_m: [-600, 4600], north_m: [-1500, 1500]"
    text = LONG.replace("east_m: [-6000, 6000], north_m: [-6000, 6000]", bounds) + walls
    team = flown(mission_from_text(text, "gap.yaml"), 2, 0.2, dialect)
    assert sorted(team.arrived_s) == [1, 2]
    assert team.is_separate
    assert team.hit_s == {}
    tracks = [np.array(flight.simulator.truth.path) for flight in team.flights]
    passed_s = [track[np.abs(track[:, 1] - 2000.0).argmin(), 0] for track in tracks]
    assert abs(passed_s[0] - passed_s[1]) > 8.0


# A circle in a corridor leaves no room. Member 1 flies to its middle, and member 2 through it.
THROUGH = ((1200.0, 0.0, 90.0, 2100.0, 0.0), (0.0, 0.0, 90.0, 3500.0, 0.0))
HEAD_ON = ((1000.0, 0.0, 90.0, 4000.0, 0.0), (2400.0, 0.0, 270.0, -700.0, 0.0))  # Both begin in a longer one.
CORRIDOR = LONG.replace(
    "east_m: [-6000, 6000], north_m: [-6000, 6000]", "east_m: [-1600, 4600], north_m: [-1500, 1500]"
) + "obstacles:\n" + "".join(
    f"  - {{name: {name}, base_m: 0, top_m: 300, polygon_enu_m: "
    f"[[1500, {low}], [2900, {low}], [2900, {high}], [1500, {high}]]}}\n"
    for name, low, high in (("south_block", -1500, -180), ("north_block", 180, 1500))
)  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("moves", [True, False], ids=["moves", "stays"])
def test_a_member_that_has_arrived_moves_for_one_whose_goal_lies_behind_its_circle(moves, monkeypatch):
    """Beside it the same flight in which nobody is requested to move: the second one never arrives."""
    if not moves:
        monkeypatch.setattr(replanning, "BARRED_S", math.inf)
    mission = mission_from_text(CORRIDOR, "corridor.yaml")
    team = flown(mission, 2, 0.2, Dialect.ARDUPILOT, kind=PlacedTeam, places=THROUGH)
    assert sorted(team.arrived_s) == ([1, 2] if moves else [1])
    assert team.is_separate
    assert team.hit_s == {}
    told = [decision.told for decision in team.flights[0].recorder.decisions]
    assert ("Moving aside: system 2 has to pass" in told) is moves
    assert ("Out of the way, planner is done" in told) is moves


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("dialect", "seed", "moves"),
    [
        (Dialect.ARDUPILOT, 2, True),
        (Dialect.PX4, 2, True),
        (Dialect.PX4, 6, True),
        (Dialect.ARDUPILOT, 2, False),
    ],
)
def test_of_two_that_bar_each_other_one_moves_and_flies_its_goal_afterwards(
    dialect, seed, moves, monkeypatch
):
    """Beside it the same flight in which nobody is requested to move: neither arrives.

    A PX4 passes its goal once the other one has come back through the corridor to its landing. With these
    seeds one of them circles at the end of a mission whose path leads to the goal.
    """
    if moves:
        monkeypatch.setattr(sim.sitl.Flight, "limit_s", 800.0)
    else:
        monkeypatch.setattr(replanning, "BARRED_S", math.inf)
    mission = mission_from_text(CORRIDOR.replace("[1500, ", "[300, ").replace("[2900, ", "[3100, "), "c.yaml")
    team = flown(mission, 2, 0.2, dialect, seed, kind=PlacedTeam, places=HEAD_ON)
    assert sorted(team.arrived_s) == ([1, 2] if moves else [])
    assert team.is_separate
    assert team.hit_s == {}
    told = [decision.told for flight in team.flights for decision in flight.recorder.decisions]
    assert any(text.startswith("Moving aside") for text in told) is moves


@pytest.mark.slow
@pytest.mark.parametrize("seed", [6, 8, 13])
def test_all_arrive_in_streets_that_one_circle_fills(seed):
    assert in_streets(seed).is_kept


@pytest.mark.slow
@BOTH
def test_four_pass_the_gaps_of_the_bug_trap(dialect):
    team = flown(load_mission(CONFIGS / "paper-2d.yaml"), 4, 0.2, dialect, seed=2)
    assert sorted(team.arrived_s) == [1, 2, 3, 4]
    assert team.is_separate
    assert team.hit_s == {}


@pytest.mark.slow
@BOTH
def test_four_fly_the_goals_that_they_share(dialect):
    team = flown(load_mission(CONFIGS / "team-search.yaml"), 4, 0.2, dialect)
    assert sorted(team.arrived_s) == [1, 2, 3, 4]
    assert all(passed for passed in team.summary()["goals_flown_by"])
    assert team.is_separate
    assert team.hit_s == {}


def test_the_goals_of_a_member_that_is_gone_are_flown_by_the_other_one():
    mission = mission_of(4, num_goals=3, side_m=1600.0)
    team = mission.team.model_copy(update={"lost_after_s": 10.0})
    flight = TeamFlight(mission.model_copy(update={"team": team}), 2, 1, gone_s={2: 12.0})
    fly_team(flight)
    lost = flight.flights[1].app.state
    assert len(lost.goals) > lost.next_goal  # It had goals left.
    assert all(passed for passed in flight.summary()["goals_flown_by"])
    assert (list(flight.arrived_s), flight.is_separate, flight.hit_s) == ([1], True, {})
    assert not any(decision.kind == "off path" for decision in flight.flights[0].recorder.decisions)


class FenceAhead(TeamFlight):
    """From ``FENCED_S`` on there is a fence on the path of member 1, which never hears member 2 again."""

    place = None

    def members_there(self, now_s):
        first = self.flights[0]
        if now_s >= FENCED_S and self.place is None:
            harness = SimpleNamespace(flight=first, simulator=first.simulator, app=first.app)
            self.place = ahead(harness)
            fence(harness, (CIRCLE_OUT, 150.0, *self.place))
        return super().members_there(now_s)


@BOTH
@pytest.mark.parametrize("waits_s", [WAITS_S, 0.0])
def test_a_path_that_meets_a_fence_is_left_without_the_approval_of_a_silent_member(
    waits_s, dialect, monkeypatch
):
    """Beside it the same flight by a service that always waits: it flies into the fence."""
    monkeypatch.setattr(announced_plan, "WAITS_S", waits_s)
    mission = mission_from_text(LONG, "long.yaml")
    flight = FenceAhead(mission, 2, 1, dialect, gone_s={2: FENCED_S})
    fly_team(flight)
    rows = np.array(flight.flights[0].simulator.truth.path)
    is_kept = np.hypot(*(rows[:, 1:3] - flight.place).T).min() > 150.0
    assert is_kept is np.bool_(waits_s == WAITS_S)


def test_members_start_and_end_apart_and_every_other_one_flies_back():
    mission = load_mission(CONFIGS / "paper-2d.yaml")
    missions = team_missions(mission, 5)
    assert [one.team.members for one in missions] == [(1, 2, 3, 4, 5)] * 5
    team = missions[0].team
    beside_m = team.apart_m + 2.0 * team.tolerance_m
    for way in (0, 1):  # Those that fly there, and those that fly back.
        some = missions[way::2]
        starts = [(one.start.east_m, one.start.north_m) for one in some]
        goals = [(one.goals[0].east_m, one.goals[0].north_m) for one in some]
        for places, least_m in ((starts, 1.5 * beside_m), (goals, 2.0 * 1.3 * 125.0 + beside_m)):
            for index, place in enumerate(places):
                assert all(math.dist(place, there) >= least_m for there in places[:index])
    assert (missions[0].start.east_m, missions[0].start.north_m) == (250.0, 2250.0)
    assert {one.name for one in missions} == {f"paper-2d-{number}" for number in range(1, 6)}


def test_a_world_without_room_for_all_is_refused():
    with pytest.raises(NoPlaceError, match="no free places for 20 circles"):
        team_missions(load_mission(CONFIGS / "first-flight.yaml"), 40)


@pytest.mark.slow
def test_all_goals_are_flown_though_the_last_one_goes_to_another_member_while_a_plan_fails():
    assert flown_without_one(36, Dialect.PX4).is_kept
