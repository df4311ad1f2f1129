"""Flies a team: everybody agrees on its circle, then on a path to its goal."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from companion.frames import FloatArray
from companion.mission.team.agreement import Agreement, Outcome
from companion.mission.team.shared_plan import SharedPlan
from .candidates import CandidatePath, Circling, candidates, first_clear, paths_to
from .scenes import FRAME, Scene, starts_and_goals
from .team_radio import TeamRadio
from .true_distances import STEP_S, Flown, pairs_lost, true_places

BEGIN_S = 1.9e9  # UTC time of the beginning [s].
SENDS_EACH = 2  # An aircraft looks every second step whether it has to send.
LEAD_S = 45.0  # Time between a proposal and the moment at which it leaves the committed plan.
PLACES_EACH = 20  # Steps between two looks at who is in range.


@dataclass(frozen=True, slots=True)
class RunRow:
    """The result of one flight of a team.

    Parameters
    ----------
    seed, aircraft : int
        Seed of the flight and number of aircraft.
    shared : bool
        False if everybody flew straight without telling anybody.
    pairs_lost : int
        Pairs that lost their separation.
    blocked : int
        Aircraft that had no agreed path to their goal at the end.
    flight_s : float
        Duration of the flight [s].
    bytes_s, bytes_s_max : float
        Bytes a second of an aircraft, frames included: the mean, and that of who sent most [B/s].
    agreed_s : float
        Median time from an aircraft's last proposal to its commitment [s].
    late_s : float
        Mean time by which an arrival was later than that of a straight flight at once [s].
    proposals, refused, withdrawn : int
        Proposals of paths, and those that were refused, also at once by the proposer, or withdrawn.
    counted_lost : int
        Pairs of which one counted the other lost at the end.
    wall_s : float
        Time that the computation took [s].
    """

    seed: int
    aircraft: int
    shared: bool
    pairs_lost: int
    flight_s: float
    wall_s: float = 0.0
    blocked: int = 0
    bytes_s: float = 0.0
    bytes_s_max: float = 0.0
    agreed_s: float = 0.0
    late_s: float = 0.0
    proposals: int = 0
    refused: int = 0
    withdrawn: int = 0
    counted_lost: int = 0


class TeamMember:
    """One aircraft with its own planner and its own part in the agreement."""

    def __init__(
        self, scene: Scene, index: int, circling: Circling, goal: FloatArray, rng: np.random.Generator
    ) -> None:
        self.agreement = Agreement(
            index + 1, range(1, scene.num_aircraft + 1), FRAME, scene.settings, started_s=BEGIN_S
        )
        self.circling, self.paths = circling, paths_to(scene, circling, goal)
        self.path: FloatArray | None = None
        self.proposals = self.refused = self.withdrawn = 0
        self.agreed_s = np.nan
        self._scene, self._rng = scene, rng
        self._next_s = float(rng.uniform(0.0, 3.0))
        self._proposed: tuple[float, SharedPlan] | None = None
        self._is_circle_agreed = False

    @property
    def arrives_s(self) -> float:
        """Time at which the aircraft is in its last circle [s]; infinite until a path is agreed."""
        return np.inf if self.path is None else float(self.path[-1, 0])

    def think(self, now_s: float) -> None:
        """Note what became of a proposal, and make another if one is wanted."""
        outcome = self.agreement.outcome()
        if self.path is not None or outcome is Outcome.PENDING:
            return
        if self._proposed is not None:
            self._note(outcome, now_s)
        elif now_s >= self._next_s:
            self._propose(now_s)

    def _note(self, outcome: Outcome, now_s: float) -> None:
        assert self._proposed is not None
        proposed_s, plan = self._proposed
        self._proposed = None
        self._next_s = now_s + float(self._rng.uniform(1.0, 6.0))
        if outcome is not Outcome.COMMITTED:
            self.refused += outcome is Outcome.REFUSED
            self.withdrawn += outcome is Outcome.WITHDRAWN
        elif not self._is_circle_agreed:
            self._is_circle_agreed = True
        else:
            self.path = plan.rows[1:] - np.array([BEGIN_S, 0.0, 0.0, 0.0])
            self.agreed_s = now_s - proposed_s

    def _propose(self, now_s: float) -> None:
        against, scene = self.agreement.plans_to_clear(), self._scene
        utc_s = BEGIN_S + now_s
        if not self._is_circle_agreed:
            rows = np.array([[utc_s, *self.circling.centre]])
            plan = SharedPlan(0, 0, rows, scene.radius_m, scene.tolerance_m, scene.tolerance_up_m)
            leaves_s = np.inf
        else:
            self._next_s = now_s + 5.0
            known = {other.member for other in against} | self.agreement.members_lost(utc_s)
            if len(known) < scene.num_aircraft - 1:
                return  # Somebody is in a circle that is not known.
            paths = candidates(self.circling, self.paths, now_s + LEAD_S)
            utc_paths = (path + np.array([BEGIN_S, 0.0, 0.0, 0.0]) for path in paths)
            found = first_clear(scene, self.circling, utc_paths, against, utc_s)
            if found is None:
                self.refused += 1
                return
            plan = SharedPlan(
                0, 0, found.rows, scene.radius_m, scene.tolerance_m, scene.tolerance_up_m,
                room=max(0, 255 - 30 * (self.refused + self.withdrawn)), first_radius_m=scene.radius_m,
            )  # fmt: skip
            leaves_s = float(found.rows[1, 0])
            self.proposals += 1
        self.agreement.propose(plan, utc_s, leaves_s)
        self._proposed = (now_s, plan)

    def place_at(self, now_s: float) -> tuple[float, float]:
        """Return east and north of the plan at an instant [m]."""
        committed = self.agreement.committed
        if committed is None:
            return float(self.circling.centre[0]), float(self.circling.centre[1])
        return committed.place_at(BEGIN_S + now_s)[:2]


def fly(seed: int, scene: Scene) -> RunRow:
    """Fly a team that shares its plans.

    Parameters
    ----------
    seed : int
        Seed of everything that is drawn.
    scene : Scene
        The team.
    """
    began_s = time.perf_counter()
    rng = np.random.default_rng(seed)
    circlings, goals = _drawn(scene, rng)
    members = [
        TeamMember(scene, n, circling, goal, np.random.default_rng((seed, n)))
        for n, (circling, goal) in enumerate(zip(circlings, goals, strict=True))
    ]
    radio = TeamRadio(scene, STEP_S, rng)
    now_s = _pass_time(scene, members, radio)
    flown = [Flown(member.circling, member.path) for member in members]
    arrived = [member for member in members if member.path is not None]
    late_s = [member.arrives_s - float(_straight(member.circling, member.paths)[-1, 0]) for member in arrived]
    return RunRow(
        seed, scene.num_aircraft, True, len(_pairs_lost(scene, flown, now_s, rng)), now_s,
        blocked=len(members) - len(arrived),
        bytes_s=round(float(radio.sent_bytes.mean()) / now_s, 2),
        bytes_s_max=round(float(radio.sent_bytes.max()) / now_s, 2),
        agreed_s=round(float(np.median([member.agreed_s for member in arrived] or [0.0])), 2),
        late_s=round(float(np.mean(late_s or [0.0])), 2),
        wall_s=round(time.perf_counter() - began_s, 2),
        **_counts(members, now_s),
    )  # fmt: skip


def _counts(members: list[TeamMember], now_s: float) -> dict[str, int]:
    """Return what all members together counted."""
    return {
        "proposals": sum(member.proposals for member in members),
        "refused": sum(member.refused for member in members),
        "withdrawn": sum(member.withdrawn for member in members),
        "counted_lost": sum(len(member.agreement.members_lost(BEGIN_S + now_s)) for member in members),
    }


def _pass_time(scene: Scene, members: list[TeamMember], radio: TeamRadio) -> float:
    """Let everybody receive, think and send until all have arrived; returns when that is [s]."""
    step, now_s = 0, 0.0
    places_m = np.array([member.place_at(0.0) for member in members])
    receive = [member.agreement.receive for member in members]
    while now_s < scene.end_s and any(member.arrives_s + 10.0 > now_s for member in members):
        step, now_s = step + 1, now_s + STEP_S
        for receivers, sender, payload in radio.arrived(step):
            for receiver in receivers:
                receive[receiver](sender + 1, payload, BEGIN_S + now_s)
        if step % PLACES_EACH == 0:
            places_m = np.array([member.place_at(now_s) for member in members])
        for n in range(step % SENDS_EACH, scene.num_aircraft, SENDS_EACH):
            members[n].think(now_s)
            for payload in members[n].agreement.outgoing(BEGIN_S + now_s):
                radio.send(n, payload, step, places_m)
    return now_s


def fly_straight(seed: int, scene: Scene) -> RunRow:
    """Fly the same team without sharing: everybody leaves at once and flies straight to its goal.

    Parameters
    ----------
    seed : int
        Seed of everything that is drawn.
    scene : Scene
        The team.
    """
    began_s = time.perf_counter()
    rng = np.random.default_rng(seed)
    circlings, goals = _drawn(scene, rng)
    pairs = zip(circlings, goals, strict=True)
    paths = [_straight(circling, paths_to(scene, circling, goal)) for circling, goal in pairs]
    flown = [Flown(circling, path) for circling, path in zip(circlings, paths, strict=True)]
    end_s = max(path[-1, 0] for path in paths) + 10.0
    lost = _pairs_lost(scene, flown, end_s, rng)
    wall_s = round(time.perf_counter() - began_s, 2)
    return RunRow(seed, scene.num_aircraft, False, len(lost), flight_s=float(end_s), wall_s=wall_s)


def _drawn(scene: Scene, rng: np.random.Generator) -> tuple[list[Circling], FloatArray]:
    """Draw circles and goals, (N, 3) [m]."""
    starts, goals = starts_and_goals(scene, rng)
    rate = scene.speed_m_s / scene.radius_m
    angles = rng.uniform(0.0, 2.0 * np.pi, len(starts))
    return [Circling(start, float(angle), rate) for start, angle in zip(starts, angles, strict=True)], goals


def _straight(circling: Circling, paths: list[CandidatePath]) -> FloatArray:
    """Return the path that costs least if nobody is in it, from time zero on, (M, 4) [s, m]."""
    return next(candidates(circling, paths, 0.0))


def _pairs_lost(
    scene: Scene, flown: list[Flown], end_s: float, rng: np.random.Generator
) -> set[tuple[int, int]]:
    times_s = np.arange(0.0, end_s, STEP_S)
    return pairs_lost(scene, np.array([true_places(scene, each, times_s, rng) for each in flown]))
