"""What the service knows of a team: UTC, the plan that it proposes, and where the others will be."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from companion.assurance.violation import Violation
from companion.clock import ManualClock
from companion.config import mission_from_text
from companion.config.models import Bounds, Origin
from companion.config.sections.team_section import TeamConfig
from companion.flight.exchange.announced_plan import STEERED_S, AnnouncedPlan, announced_rows
from companion.flight.exchange.team_exchange import TeamExchange, UtcClock
from companion.flight.state.decision import Verdict
from companion.flight.state.flight_state import StateOwner, after_position, first_state
from companion.flight.state.modes import Mode
from companion.flight.state.team_part import settings_of
from companion.mission.team.agreement import Agreement, Outcome
from companion.mission.team.goal_auction import GoalAuction
from companion.mission.team.shared_plan import SharedPlan, circled
from companion.mission.team.team_settings import TeamSettings
from companion.mission.waypoints import Waypoints
from companion.planning.problem import GoalRegion
from companion.types.events import ClockReported, Motion, TeamMessage
from companion.types.state import AutopilotSettings, Ownship
from companion.types.threat import TrackState
from tests.flight.construction.test_cycle import state
from tests.flight.prediction.test_mode_tracks import in_mode
from tests.flight.prediction.test_return_path import made
from tests.flight.replanning.test_surprise import LONG
from tests.mission.team.team_plans import FRAME
from tests.support.paths import path_of

BOUNDS = Bounds(east_m=(-2000.0, 2000.0), north_m=(-2000.0, 2000.0), up_m=(0.0, 200.0))
AHEAD_S = 1.9e9  # UTC less the clock
TEAM = TeamConfig(members=(1, 2, 3), apart_m=100.0, apart_up_m=30.0, tolerance_m=50.0, tolerance_up_m=10.0)


class Team:
    """The exchange of system 1, with stand-ins for the rest of the service; ``owner`` holds a whole state."""

    def __init__(self, team=TEAM, owner=None):
        self.clock, self.sent, self.told = ManualClock(), [], []
        self.met = []
        checker = SimpleNamespace(
            limits=SimpleNamespace(margin_m=10.0), check_track=lambda _places, _margin: self.met
        )
        self.state = SimpleNamespace(
            mission=SimpleNamespace(
                team=team, frame=FRAME, bounds=BOUNDS, team_members=team.members if team else ()
            ), flown=None, turn_radius_m=80.0, next_own=None, tail_enu_m=None,
            home_enu_m=None, settings=AutopilotSettings(),
            motion=Motion.STEERED, target_enu_m=None, rules=SimpleNamespace(checker=checker),
        )  # fmt: skip
        self.own = Ownship(0.0, (0.0, 0.0, 100.0), 0.0, 0.0, 20.0, 0.0)
        codec = SimpleNamespace(vehicle_system_id=1, team_message=lambda payload: payload)
        self.exchange = TeamExchange(
            owner or SimpleNamespace(state=self.state), SimpleNamespace(state=self._own_at),
            SimpleNamespace(codec=codec, send=self.sent.append, autopilot=SimpleNamespace(current=None)),
            self.clock,
            SimpleNamespace(decide=lambda kind, text, **_more: self.told.append(text)),
        )  # fmt: skip
        self.others = {}

    def _own_at(self, now_s):
        return replace(self.own, stamp_s=now_s)

    def begin(self):
        self.exchange.take(ClockReported(0.0, AHEAD_S))
        settings = TeamSettings(apart_m=100.0, apart_up_m=30.0, lost_after_s=60.0)
        self.others = {
            member: Agreement(member, TEAM.members, FRAME, settings, started_s=AHEAD_S) for member in (2, 3)
        }
        return self

    def talk(self, until_s, without=()):
        """Everybody hears everybody, twice a second."""
        while self.clock.now_s() < until_s:
            self.clock.advance_to(self.clock.now_s() + 0.5)
            utc_s = self.clock.now_s() + AHEAD_S
            self.exchange.keep_up()
            said = [(1, payload) for payload in self.sent]
            self.sent.clear()
            for member, other in self.others.items():
                if member not in without:
                    said += [(member, payload) for payload in other.outgoing(utc_s)]
            for sender, payload in said:
                for member, other in self.others.items():
                    if member not in (sender, *without):
                        other.receive(sender, payload, utc_s)
                if sender != 1:
                    self.exchange.take(TeamMessage(self.clock.now_s(), sender, payload))


def mission(*places, start_s=10.0, verdict=Verdict.FIRST_PLAN):
    """A mission from ``start_s`` on through places at 20 m/s, with a circle of 80 m about the last one."""
    steps = np.linalg.norm(np.diff(np.array(places), axis=0), axis=1)
    times = start_s + np.concatenate([[0.0], np.cumsum(steps / 20.0)])
    path = path_of(times, np.array(places), np.full(len(places), 0.5 * math.pi))
    end = np.array(places[-1], dtype=float)
    return SimpleNamespace(
        path=path, covered_until_s=float(path.times_s[-1]), verdict=verdict,
        start=SimpleNamespace(state=SimpleNamespace(stamp_s=start_s)),
        waypoints=Waypoints(end[None], np.zeros(1), 20.0, end, 80.0),
    )  # fmt: skip


AHEAD = ((200.0, 0.0, 100.0), (1200.0, 0.0, 100.0))


def test_the_earliest_report_of_the_time_counts():
    """Reports that are 0.3 and 0.1 s late say 100 s; the next, 0.5 s late, changes nothing but the drift."""
    utc = UtcClock()
    for stamp_s, late_s in ((10.0, 0.3), (11.0, 0.1), (12.0, 0.5)):
        utc.note(ClockReported(stamp_s + late_s, stamp_s + 100.0))
    assert utc.ahead_s == pytest.approx(100.0 - 0.1 - 1.4e-4)


def test_without_a_team_or_utc_nobody_is_asked():
    for team in (Team(None), Team()):
        if team.state.mission.team is None:
            team.begin()
        assert team.exchange.propose(mission(*AHEAD)) == ""
        assert team.exchange.is_given
        team.exchange.keep_up()
        assert team.sent == []


def test_a_system_that_is_no_member_asks_nobody():
    team = Team(TeamConfig(members=(2, 3)))
    team.exchange.take(ClockReported(0.0, AHEAD_S))
    assert team.exchange.agreement is None


def test_a_mission_may_be_entered_once_all_have_approved_and_is_committed_once_it_is_flown():
    team = Team().begin()
    assert team.exchange.propose(mission(*AHEAD)) == ""
    assert not team.exchange.is_given
    team.talk(4.0)
    assert team.exchange.is_given
    assert team.exchange.agreement.committed.end_s == AHEAD_S  # Where it stood.
    team.exchange.hold()
    team.talk(30.0)  # The autopilot has not answered for a long while: the proposal is still kept clear of.
    assert team.exchange.is_given
    assert [plan.member for plan in team.others[2].plans_to_clear()] == [1, 1]
    team.exchange.end(is_flown=True)
    told = team.exchange.agreement.committed
    assert told.radius_m == pytest.approx(80.0)
    assert told.place_at(AHEAD_S + 10.0 + 20.0) == pytest.approx((600.0, 0.0, 100.0), abs=3.0)
    assert told.place_at(AHEAD_S + 500.0) == pytest.approx((1200.0, 0.0, 100.0), abs=1.0)
    assert told.end_s == pytest.approx(AHEAD_S + 10.0 + (1000.0 - 80.0) / 20.0, abs=0.2)  # where it enters


def test_nobody_is_waited_for_while_the_flown_path_meets_an_obstacle():
    team = Team().begin()
    team.met = [Violation("clearance", 3, 5.0, 10.0, "distance to tower [m]")]
    assert team.exchange.propose(mission(*AHEAD)) == ""
    assert team.exchange.is_given
    assert team.exchange.agreement.committed.rows[-1, 1:] == pytest.approx(AHEAD[-1], abs=0.5)  # Rounded.
    team.talk(1.0)
    assert [plan.member for plan in team.others[2].plans_to_clear()] == [1]


def test_what_is_not_approved_in_time_may_not_be_entered():
    team = Team().begin()
    team.exchange.propose(mission(*AHEAD))
    team.talk(9.0, without=(3,))
    assert not team.exchange.is_given
    assert team.exchange.refusal == ""
    team.talk(11.0, without=(3,))
    assert team.exchange.refusal == "not approved in time"
    team.exchange.end(is_flown=False)
    assert team.exchange.is_given


def crossing(team, member=2):
    """Let a member commit a path over (700, 0) at 35 s, from south to north."""
    times = AHEAD_S + np.array([0.0, 35.0, 70.0])
    rows = np.column_stack([times, [700.0] * 3, [-700.0, 0.0, 700.0], [100.0] * 3])
    team.others[member].propose(SharedPlan(member, 0, rows, 80.0, 50.0, 10.0), AHEAD_S + team.clock.now_s())


def test_a_path_that_conflicts_with_anothers_is_not_even_proposed():
    team = Team().begin()
    crossing(team)
    team.talk(5.0)
    assert team.exchange.propose(mission(*AHEAD)) == "the path of system 2"
    assert team.exchange.refusal == "refused by system 2"


def test_the_others_are_where_they_told_and_in_their_circles_then():
    team = Team().begin()
    crossing(team)
    team.talk(5.0)
    (flies,) = team.exchange.with_members((), 5.0)
    assert flies.identity == "system:2"
    assert flies.keeps_route
    assert flies.flies_on
    assert (flies.max_threat_radius_m, flies.clear_up_m) == (225.0, 50.0)
    at = AHEAD_S + np.array([35.0, 200.0]) - AHEAD_S
    assert flies.places_enu_m(at[:1])[0] == pytest.approx([700.0, 0.0, 100.0], abs=5.0)
    assert flies.places_enu_m(at[1:])[0] == pytest.approx([700.0, 700.0, 100.0], abs=1.0)
    assert flies.circles_m(at) == pytest.approx([0.0, 80.0], abs=0.2)
    (later,) = team.exchange.with_members((), 300.0)  # It is lost by then, and its path counts still.
    assert later.places_enu_m(np.array([300.0]))[0] == pytest.approx([700.0, 700.0, 100.0], abs=1.0)


def sighted(place, stamp_s):
    return TrackState(
        stamp_s, "system:2", place, (0.0, 20.0, 0.0), np.eye(4), 30.0, 250.0, 50.0, True, stamp_s
    )


def test_a_member_that_is_not_where_it_told_is_an_aircraft_that_passes():
    team = Team().begin()
    crossing(team)
    team.talk(5.0)
    assert team.exchange.takes("system:2", (700.0, -600.0, 100.0), 5.0)
    assert not team.exchange.takes("system:9", (700.0, -600.0, 100.0), 5.0)  # It is no member.
    assert not team.exchange.takes("system:3", (700.0, -600.0, 100.0), 5.0)  # It announced nothing.
    place = (300.0, -600.0, 100.0)
    taken = [team.exchange.takes("system:2", place, now_s) for now_s in np.arange(6.0, 12.5)]
    assert taken == [True] * 5 + [False] * 2  # For 5 s it may be late news.
    found = team.exchange.with_members((sighted(place, 12.0),), 12.0)
    (off,) = (track for track in found if not track.keeps_route)
    assert len(found) == 2
    assert off.position_enu_m[0] == 300.0
    assert off.flies_on
    assert off.max_threat_radius_m == 225.0


def test_other_vehicles_stay_as_they_were_sighted():
    team = Team().begin()
    team.talk(1.0)
    stranger = sighted((0.0, 0.0, 0.0), 1.0)
    for identity in ("icao:00ABCD", "system:9"):
        other = replace(stranger, identity=identity)
        assert team.exchange.with_members((other,), 1.0) == (other,)


def test_the_pilot_is_told_of_a_member_that_is_lost_and_of_its_return():
    team = Team().begin()
    team.talk(30.0)
    team.talk(95.0, without=(3,))
    assert team.told == ["system 3 is lost"]
    assert team.exchange.agreement.outcome() is Outcome.NONE
    team.talk(110.0)
    assert team.told == ["system 3 is lost", "system 3 is received"]


def test_the_pilot_is_told_once_of_members_that_return_at_nearly_the_same_height():
    """30 m and twice 10 m are needed: 49 m are too few."""
    section = f"team: {TEAM.model_dump_json()}\n"
    team = Team(owner=StateOwner(made(extra=section))).begin()
    own_m = 584.0 + 100.0  # Home's altitude, which is that of the origin, and RTL_ALTITUDE.
    team.others[2].return_altitude_m, team.others[3].return_altitude_m = own_m + 50.0, own_m - 50.0
    team.talk(60.0)
    assert team.told == []
    assert team.others[2].return_altitudes_m == {1: own_m, 3: own_m - 50.0}
    team.others[3].return_altitude_m = own_m - 49.0
    team.talk(120.0)
    assert team.told == ["RTL height near system 3's: 50 m needed"]
    team.others[3].return_altitude_m = own_m - 50.0
    team.talk(180.0)
    team.others[2].return_altitude_m = own_m
    team.talk(240.0)
    assert team.told[1:] == ["RTL height near system 2's: 50 m needed"]


def test_an_emergency_goes_before_the_proposals_of_others():
    team = Team().begin()
    team.exchange.propose(mission(*AHEAD, verdict=Verdict.EMERGENCY))
    assert team.exchange.agreement.proposed.is_emergency
    assert math.isfinite(team.exchange.agreement.proposed.end_s)


def test_before_its_first_plan_a_member_announces_where_it_is_and_nobody_is_allowed_to_come_there():
    team = Team().begin()
    team.talk(2.0)
    for other in team.others.values():
        (announced,) = other.plans_to_clear()
        assert announced.place_at(AHEAD_S + 500.0) == pytest.approx((0.0, 0.0, 100.0), abs=1.0)
    rows = [[AHEAD_S, -500.0, 0.0, 100.0], [AHEAD_S + 50.0, 500.0, 0.0, 100.0]]
    assert team.others[2].propose(SharedPlan(2, 0, np.array(rows), 80.0, 50.0, 10.0), AHEAD_S + 2.0) is None


SHARED = TEAM.model_copy(update={"share_goals": True})
GOALS = tuple(GoalRegion((1000.0 * n, 500.0, 100.0), 60.0) for n in range(4))


def sharing():
    """Three members that share four goals; system 1 is at the first, 2 and 3 beside the last two."""
    mission = mission_from_text(LONG, "long.yaml").model_copy(update={"team": SHARED})
    own = first_state(mission, 0.0)
    owner = StateOwner(replace(own, rules=replace(own.rules, goals=GOALS), mode=Mode.ACTIVE))
    team = Team(SHARED, owner).begin()
    for member, other in team.others.items():
        other.auction = GoalAuction(member, np.array([g.position_enu_m[:2] for g in GOALS]), FRAME, 25.0)
        other.auction.look(AHEAD_S, (1000.0 * member, -200.0), {1, 2, 3})
    return team, owner


def test_a_member_flies_the_goals_that_it_wins_and_those_of_one_that_is_lost():
    team, owner = sharing()
    assert (owner.state.goals, owner.state.is_on_call) == ((), True)
    team.talk(10.0)
    assert owner.state.goals == GOALS[:2]
    assert team.told[-1] == "goals: 1, 2"
    team.talk(85.0, without=(3,))
    assert owner.state.goals == GOALS[:1]  # It is late there, and member 2 is nearer to what is free again.
    assert not owner.state.has_arrived
    team.talk(160.0, without=(2, 3))
    assert set(owner.state.goals) == set(GOALS)
    for goal in owner.state.goals:
        team.own = replace(team.own, position_enu_m=goal.position_enu_m)
        owner.apply(after_position, team.own)
        team.talk(team.clock.now_s() + 1.0, without=(2, 3))
    assert owner.state.has_arrived


def test_a_member_that_a_pilot_flies_holds_no_goals_and_the_plan_of_a_lost_one_is_forgotten():
    team, owner = sharing()
    crossing(team)
    team.talk(10.0)
    assert [plan.member for plan in team.exchange.agreement.plans_to_clear()] == [2]
    owner.apply(lambda state: replace(state, mode=Mode.SUSPENDED))
    team.talk(20.0)
    assert owner.state.goals == ()
    assert team.others[2].auction.lists({1, 2, 3}).keys() == {2, 3}
    for now_s in (60.0, 75.0):
        team.talk(now_s, without=(2, 3))
        team.exchange.takes("system:2", (700.0, 0.0, 100.0), now_s)
    team.talk(90.0, without=(2, 3))
    assert [plan.member for plan in team.exchange.agreement.plans_to_clear()] == [2]  # It is seen still.
    team.talk(140.0, without=(2, 3))
    assert team.exchange.agreement.plans_to_clear() == ()


def flying(bank_rad=0.0):
    """An aircraft that flies east at 25 m/s from (1000, 0, 100)."""
    return replace(state(east=1000.0, north=0.0, up=100.0), bank_rad=bank_rad)


def test_an_aircraft_that_a_pilot_flies_announces_straight_flight():
    rows, radius_m = circled(announced_rows(in_mode(Motion.STEERED), flying(bank_rad=0.5), None))
    seconds = rows[-1, 0] - rows[0, 0]
    assert (seconds, radius_m) == (STEERED_S, 0.0)
    assert rows[-1, 1:] == pytest.approx([1000.0 + 25.0 * seconds, 0.0, 100.0], abs=0.1)


def test_an_aircraft_that_circles_announces_its_circle():
    whole = announced_rows(in_mode(Motion.CIRCLE, (1500.0, 0.0, 100.0)), flying(), None)
    rows, radius_m = circled(whole)
    assert rows[-1, 1:] == pytest.approx([1500.0, 0.0, 100.0], abs=40.0)
    assert radius_m == pytest.approx(140.0, abs=25.0)
    assert rows[-1, 0] == rows[-2, 0] < whole[-1, 0] - 30.0
    later = whole[whole[:, 0] >= rows[-1, 0]]
    assert np.hypot(*(later[:, 1:3] - rows[-1, 1:3]).T).max() <= radius_m + 1e-6


def test_what_is_flown_is_announced_once_it_is_not_what_was_told_and_before_it_ends():
    announced = AnnouncedPlan()
    agreement = Agreement(1, (1, 2), FRAME, settings_of(TEAM), started_s=AHEAD_S)
    here = flying()

    def is_due_at(now_s, east_m, north_m=0.0):
        aircraft = replace(here, stamp_s=now_s, position_enu_m=(east_m, north_m, 100.0))
        return announced.is_due(agreement, aircraft, AHEAD_S + now_s)

    assert is_due_at(0.0, 1000.0)
    rows = announced_rows(in_mode(Motion.STEERED), replace(here, stamp_s=0.0), None)
    agreement.announce(announced.plan(rows, TEAM, AHEAD_S))
    assert not is_due_at(5.0, 1125.0)
    assert not is_due_at(6.0, 1150.0, 200.0)
    assert not is_due_at(7.0, 1175.0)  # It was off its plan for one second.
    assert not is_due_at(8.0, 1200.0, 200.0)
    assert is_due_at(10.0, 1250.0, 200.0)
    assert not is_due_at(14.0, 1350.0)
    assert is_due_at(16.0, 1400.0)  # Less than half of the 30 s is left.
    agreement.propose(SharedPlan(1, 0, agreement.committed.rows, 80.0, 50.0, 10.0), AHEAD_S + 16.0)
    assert not is_due_at(16.0, 1400.0)


def test_a_long_plan_without_a_circle_is_announced_again_a_minute_before_its_end():
    """It leads for 300 s to a landing, at 25 m/s."""
    announced, agreement = AnnouncedPlan(), Agreement(1, (1, 2), FRAME, settings_of(TEAM), started_s=AHEAD_S)
    rows = np.array([[AHEAD_S, 1000.0, 0.0, 100.0], [AHEAD_S + 300.0, 8500.0, 0.0, 100.0]])
    agreement.announce(SharedPlan(1, 0, rows, 0.0, 50.0, 10.0))
    for now_s, expected in ((200.0, False), (239.0, False), (241.0, True)):
        aircraft = replace(flying(), stamp_s=now_s, position_enu_m=(1000.0 + 25.0 * now_s, 0.0, 100.0))
        assert announced.is_due(agreement, aircraft, AHEAD_S + now_s) is expected


def test_before_its_first_plan_a_member_announces_anew_what_it_flies_with_each_proposal():
    team = Team().begin()
    team.talk(2.0)
    team.own = replace(team.own, position_enu_m=(40.0, 0.0, 100.0))
    team.exchange.propose(mission(*AHEAD))
    assert team.exchange.agreement.committed.place_at(AHEAD_S + 5.0) == pytest.approx(
        (40.0, 0.0, 100.0), abs=0.1
    )
    team.state.flown = SimpleNamespace(path=path_of(np.array([0.0, 9.0]), np.zeros((2, 3)), np.zeros(2)))
    team.own = replace(team.own, position_enu_m=(60.0, 0.0, 100.0))
    team.exchange.propose(mission(*AHEAD))
    assert team.exchange.agreement.committed.place_at(AHEAD_S + 5.0) == pytest.approx(
        (40.0, 0.0, 100.0), abs=0.1
    )


def circling_at_the_goal():
    """System 1 circles at its last goal, and no pilot flies it."""
    text = LONG.replace("{east_m: 4000, north_m: 0, up_m: 100}", "{east_m: 0, north_m: 0, up_m: 100}")
    origin = Origin(
        latitude_deg=FRAME.latitude_deg, longitude_deg=FRAME.longitude_deg,
        altitude_amsl_m=FRAME.altitude_amsl_m,
    )  # fmt: skip
    mission = mission_from_text(text, "here.yaml").model_copy(update={"team": TEAM, "origin": origin})
    own = replace(first_state(mission, 0.0), mode=Mode.ARRIVED, motion=Motion.MISSION, next_goal=1)
    owner = StateOwner(own)
    team = Team(owner=owner).begin()
    here = SharedPlan(1, 0, np.array([[AHEAD_S, 0.0, 0.0, 100.0]]), 80.0, 50.0, 10.0)
    team.exchange.agreement.announce(here)
    return team, owner


def test_a_member_at_its_last_goal_moves_for_one_that_has_to_pass_and_the_pilot_is_told():
    team, owner = circling_at_the_goal()
    team.talk(3.0)
    rows = np.array([[AHEAD_S + 3.0, -1500.0, 0.0, 100.0], [AHEAD_S + 103.0, 1000.0, 0.0, 100.0]])
    wanted = SharedPlan(2, 0, rows, 80.0, 50.0, 10.0)
    assert team.others[2].propose(wanted, AHEAD_S + 3.0) is None  # It cannot pass.
    team.others[2].request(wanted, AHEAD_S + 3.0)
    team.talk(6.0)
    (place,) = owner.state.goals_left
    assert abs(place.position_enu_m[1]) > 80.0 + 200.0  # A circle of 80 m, and twice 50 m and 100 m.
    assert team.told == ["moving out of the way of system 2"]
    team.talk(12.0)
    assert owner.state.goals_left == (place,)
    assert len(team.told) == 1


def test_a_pilot_who_circles_in_the_way_is_told_once_for_each_request():
    team, owner = circling_at_the_goal()
    owner.apply(lambda state: replace(state, mode=Mode.SUSPENDED))
    rows = np.array([[AHEAD_S + 3.0, -1500.0, 0.0, 100.0], [AHEAD_S + 103.0, 1000.0, 0.0, 100.0]])
    for number in (1, 2):
        team.talk(team.clock.now_s() + 3.0)
        team.others[2].request(SharedPlan(2, 0, rows, 80.0, 50.0, 10.0), AHEAD_S + team.clock.now_s())
        team.talk(team.clock.now_s() + 6.0)
        assert team.told == ["in the way of system 2, and does not move by itself"] * number
    assert owner.state.goals_left == ()


def test_those_are_requested_to_move_that_circle_in_the_way():
    team = Team().begin()
    for member, north_m in ((2, 0.0), (3, 900.0)):
        rows = np.array([[AHEAD_S, 600.0, north_m, 100.0]])
        team.others[member].announce(SharedPlan(member, 0, rows, 80.0, 50.0, 10.0))
    team.talk(3.0)
    assert team.exchange.circling() == {"system:2", "system:3"}
    path = path_of(np.array([0.0, 60.0]), np.array([(0.0, 0.0, 100.0), (1200.0, 0.0, 100.0)]), np.zeros(2))
    assert team.exchange.barring(path) == {2}
    team.exchange.request(path)
    assert team.told == ["system 2 bars the way to the goal, and is asked to move"]
    team.talk(6.0)
    assert [len(team.others[member].requests(AHEAD_S + 6.0)) for member in (2, 3)] == [1, 0]
    assert team.exchange.is_given  # No mission waits for an answer.
    team.talk(80.0, without=(2, 3))
    assert team.exchange.circling() == frozenset()  # Nobody can request anything of lost members.
