"""Members that share goals, with a radio that loses, delays, repeats and reorders, and members that die.

The bids and bytes are the program's own. A member moves straight to the first of its goals.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from companion.mission.team.goal_auction import GoalAuction
from companion.mission.team.pacing import Pacing
from companion.mission.team.standing import Standing
from companion.mission.team.wire import read_payload
from tests.mission.team.team_plans import BEGIN_S, FRAME, SETTINGS

LOST_S = 40.0  # A member that is not heard for so long is lost.
REACHED_M = 60.0
SPEED_M_S = 20.0


@dataclass
class Weather:
    """The radio: what is lost, how late the rest is [s], and what arrives twice."""

    loss: float = 0.0
    late_s: float = 0.0
    twice: float = 0.0


@dataclass
class Flier:
    """A member, where it is [m], and how fast it is compared with what it says."""

    auction: GoalAuction
    place: np.ndarray
    pace: float
    pacing: Pacing = field(default_factory=lambda: Pacing(SETTINGS, 4))
    heard_s: dict = field(default_factory=dict)
    goals: tuple = ()
    reached: list = field(default_factory=list)
    dies_s: float = math.inf


class AuctionGame:
    """A team in which each member looks once a second, in an order that chance decides."""

    def __init__(self, goals, starts, weather, seed, *, paces=None, kind=GoalAuction, lost_s=LOST_S):
        self.goals, self.weather, self.rng = (
            np.array(goals, dtype=float),
            weather,
            np.random.default_rng(seed),
        )
        self.lost_s = lost_s
        self.now_s, self.late = BEGIN_S, []
        paces = paces or [1.0] * len(starts)
        self.members = {
            number: Flier(kind(number, self.goals, FRAME, SPEED_M_S), np.array(start, dtype=float), pace)
            for number, (start, pace) in enumerate(zip(starts, paces, strict=True), 1)
        }
        for one in self.members.values():
            one.heard_s = dict.fromkeys(self.members, BEGIN_S)

    def living(self):
        return {number for number, one in self.members.items() if self.now_s < one.dies_s}

    def counted(self, number):
        """The members that are not lost to one of them."""
        heard = self.members[number].heard_s
        return {other for other, at_s in heard.items() if other == number or self.now_s - at_s < self.lost_s}

    def lists(self):
        """What each living member believes of everybody that it counts."""
        return {number: self.members[number].auction.lists(self.counted(number)) for number in self.living()}

    def pass_time(self, seconds, *, moves=True):
        for _ in range(seconds):
            self.now_s += 1.0
            self._deliver()
            for number in self.rng.permutation(sorted(self.living())).tolist():
                one = self.members[number]
                if moves:
                    self._move(one)
                one.goals = one.auction.look(
                    self.now_s, tuple(one.place), self.counted(number), reached=one.reached
                )
                for payload in one.auction.payloads(Standing(), one.pacing, self.now_s):
                    self._send(number, payload)

    def until_over(self, limit_s):
        """Pass time until all living members know that all goals are flown; returns whether they do."""
        while self.now_s < BEGIN_S + limit_s:
            self.pass_time(5)
            if all(self.members[number].auction.is_over for number in self.living()):
                return True
        return False

    def _move(self, one):
        if not one.goals:
            return
        away = self.goals[one.goals[0]] - one.place
        far = float(np.hypot(*away))
        one.place = one.place + away * min(1.0, one.pace * SPEED_M_S / max(far, 1e-9))
        if far - one.pace * SPEED_M_S <= REACHED_M:
            one.reached.append(one.goals[0])

    def _send(self, sender, payload):
        weather = self.weather
        for receiver in self.members:
            for _ in range(1 + int(self.rng.random() < weather.twice)):
                if receiver != sender and self.rng.random() >= weather.loss:
                    due_s = self.now_s + self.rng.uniform(0.0, weather.late_s)
                    self.late.append((due_s, receiver, sender, payload))

    def _deliver(self):
        due = [each for each in self.late if each[0] <= self.now_s]
        self.late = [each for each in self.late if each[0] > self.now_s]
        for place in self.rng.permutation(len(due)).tolist():
            _, receiver, sender, payload = due[place]
            one = self.members[receiver]
            if self.now_s < one.dies_s:
                one.heard_s[sender] = self.now_s
                one.auction.receive(sender, read_payload(payload).bid, self.now_s)
