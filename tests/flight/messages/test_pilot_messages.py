"""What a pilot reads of paths, worked by hand; and that no word is lost where two take turns."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from companion.flight.messages.announcer import REPEAT_S, Announcer
from companion.flight.messages.pilot_messages import PathNews, is_another_path
from companion.flight.state.decision import DecisionKind
from companion.flight.state.flight_state import FlightState
from companion.types.path import Path

SPEED_M_S = 20.0


def path_of(*legs, begins_s=100.0):
    """A path of straight legs, each a course [deg] and a length [m], with a row a second."""
    courses = np.concatenate(
        [np.full(round(length / SPEED_M_S), math.radians(course)) for course, length in legs]
    )
    steps = SPEED_M_S * np.column_stack([np.sin(courses), np.cos(courses), np.zeros(len(courses))])
    places = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    num = len(places)
    return Path(
        times_s=begins_s + np.arange(num, dtype=float), positions_enu_m=places,
        courses_rad=np.append(courses[:1], courses), climb_angles_rad=np.zeros(num),
        speeds_m_s=np.full(num, SPEED_M_S), position_covariances_m2=np.zeros((num, 3, 3)),
        collision_free=np.ones(num), threat_levels=np.zeros(num),
    )  # fmt: skip


def state_for(path, *, is_safe=True):
    """A flight to where a path ends."""
    goal = SimpleNamespace(position_enu_m=tuple(path.positions_enu_m[-1]), acceptance_radius_m=30.0)
    state = SimpleNamespace(
        goals=[goal], flies_aside=False, violations_of=lambda _: () if is_safe else ("threat",)
    )
    state.leads_to_goal = partial(FlightState.leads_to_goal, state)
    return state


def test_nothing_is_read_of_a_path_if_another_member_of_the_team_took_the_last_goal_meanwhile():
    news, path = PathNews(), path_of((90.0, 2000.0))
    state = state_for(path)
    state.goals = []
    assert news.of(state, path, None, 100.0) == ("", "", "")


@pytest.mark.parametrize(
    ("legs", "now_s", "turn", "time"),
    [
        (((90.0, 400.0), (10.0, 2000.0)), 100.0, "Left turn in 400 m", "2:00"),
        (((90.0, 400.0), (170.0, 2000.0)), 110.0, "Right turn in 200 m", "1:50"),
        (((350.0, 400.0), (40.0, 2000.0)), 119.0, "Right turn now", "1:41"),
        (((90.0, 400.0), (100.0, 2000.0)), 100.0, "Straight on", "2:00"),
    ],
)
def test_the_first_turn_and_the_time(legs, now_s, turn, time):
    path = path_of(*legs)
    assert PathNews().of(state_for(path), path, None, now_s) == ("path", turn, f"goal in {time}")


def test_a_path_out_of_another_members_way_arrives_in_a_circle():
    path = path_of((90.0, 2000.0))
    state = state_for(path)
    state.flies_aside = True
    assert PathNews().of(state, path, None, 100.0) == ("path", "Straight on", "circle in 1:40")


def test_nothing_is_read_of_a_path_that_looks_the_same():
    news, path = PathNews(), path_of((90.0, 2000.0))
    state, flown = state_for(path), SimpleNamespace(path=path)
    assert news.of(state, path, None, 100.0)[0] == "path"
    assert news.of(state, path, flown, 105.0)[0] == ""
    elsewhere = path_of((90.0, 400.0), (60.0, 1600.0))
    assert is_another_path(elsewhere, path, 105.0)
    assert news.of(state_for(elsewhere), elsewhere, flown, 105.0)[0] == "path"


def test_it_is_read_that_the_same_path_is_no_longer_safe_and_that_it_is_again():
    news, path = PathNews(), path_of((90.0, 2000.0))
    flown = SimpleNamespace(path=path)
    told = [
        news.of(state_for(path, is_safe=is_safe), path, flown, 100.0)[0] for is_safe in (True, False, True)
    ]
    assert told == ["path", "unsafe path", "path"]


def test_a_path_that_ends_elsewhere_is_read_of_as_an_emergency():
    path = path_of((90.0, 2000.0))
    assert PathNews().of(state_for(path_of((90.0, 4000.0))), path, None, 100.0) == ("", "", "")


class Listener:
    """Stands for the link, the recorder and the clock."""

    def __init__(self):
        self.now, self.read, self.told = 0.0, [], []

    def now_s(self):
        return self.now

    def tell(self, _severity, text):
        self.read.append((self.now, text))

    def decide(self, *_facts, told):
        self.told.append(told)


def test_the_last_word_on_a_subject_is_the_true_one():
    """NOT safe, safe, NOT safe within 20 s: the pilot reads all three; the same word again is not sent."""
    listener = Listener()
    announcer = Announcer(listener, listener, listener)
    for now, tell in (
        (0.0, "unsafe"),
        (5.0, "safe"),
        (10.0, "unsafe"),
        (15.0, "unsafe"),
        (15.0 + REPEAT_S, "unsafe"),
    ):
        listener.now = now
        announcer.decide(
            DecisionKind.HANDBACK, "", tell=f"handback {tell}", mode="AUTO", what="9 m from wall"
        )
    assert [now for now, _ in listener.read] == [0.0, 5.0, 10.0, 15.0 + REPEAT_S]
    assert [bool(text) for text in listener.told] == [True, True, True, False, True]
    assert listener.read[1][1] == "AUTO from here is safe for 10 s"
