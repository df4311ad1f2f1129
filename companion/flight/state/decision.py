"""Judge whether a new plan replaces the flown one, by an ordered table of rules; all kinds of decisions.

Theory of operation. The rules of :data:`_RULES` are evaluated in their order, and the first answer decides.
Each rule notes the numbers that it used, for the record. To avoid dithering, a new plan replaces a sound
flown path only if it costs less by the mission file's ``swap_gain``, and by more if it arrives later than a
flown path that is held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

from companion.assurance.violation import Violation, keeps_hard_constraints
from companion.flight.state.flight_state import FlightState
from companion.flight.state.modes import Mode
from companion.flight.state.progress import Start, violations_of_rest
from companion.mission.glide.glide_coverage import coverage_of_path
from companion.types.path import Path
from companion.types.plan import Plan

COVERED_HORIZONS_MIN = 1.5  # A mission that covers less than this many time horizons ahead is extended.
VIOLATIONS_RECORDED_MAX = 5  # At most this many violations are recorded.
# A held path is left for one that arrives later only if that saves this multiple of swap_gain: otherwise the
# aircraft would lose its lead over pursuers bit by bit.
LATER_GAIN_FACTOR = 5.0


class DecisionKind(Enum):
    """Kinds of decisions, as recorded."""

    SWAP = "swap"
    KEEP = "keep"
    NO_PLAN = "no plan"
    REJECTED = "rejected"
    EMERGENCY = "emergency"
    MODE = "mode"
    SUSPENDED = "suspended"
    ARRIVED = "arrived"
    LANDED = "landed"
    LANDING = "landing"
    MISSION = "mission"
    TAKEOVER = "takeover"
    FAULT = "fault"
    READY = "ready"
    HANDBACK = "handback"
    AHEAD = "ahead"
    ENGINE = "engine"
    ENERGY = "energy"
    OFF_PATH = "off path"
    GROUND = "ground"
    TRAFFIC = "traffic"
    TEAM = "team"
    RETURN = "return"
    RESTART = "restart"
    LINK = "link"
    STALE = "stale"
    FRESH = "fresh"
    FENCE = "fence"
    RALLY = "rally"
    RELOAD = "reload"
    PARAMETERS = "parameters"
    RECORDING = "recording"
    STOPPED = "stopped"


MODE_ANNOUNCEMENTS = {  # Kind, recorded words and pilot's text of entering a mode.
    Mode.ACTIVE: (DecisionKind.MODE, Mode.ACTIVE.value, "flying"),
    Mode.LOST: (DecisionKind.MODE, Mode.LOST.value, "silent"),
    Mode.SUSPENDED: (DecisionKind.SUSPENDED, "another mode is flown", "paused"),
    Mode.YIELDED: (DecisionKind.SUSPENDED, "other mission or item", "other item"),
    Mode.ARRIVED: (DecisionKind.ARRIVED, "at the last goal", "arrived"),
}


def arrival_words(state: FlightState) -> tuple[str, str]:
    """Return the recorded words of an arrival, and the key of the pilot's text.

    Parameters
    ----------
    state : FlightState
        The goals, and whether the last one is the end of a return.
    """
    _, words, tell = MODE_ANNOUNCEMENTS[Mode.ARRIVED]
    if state.is_returning:
        return "at the end of the return", "return ended"
    if state.flies_aside:
        return "out of another member's way", "moved aside"
    if num_missed := len(state.goals_left[:-1]):
        return f"{words}, but {num_missed} before it not reached", "goals missed"
    return words, tell


class Verdict(Enum):
    """The judgement of a plan; those that replace the flown plan come first."""

    FIRST_PLAN = "first plan"
    UNSAFE = "unsafe"
    BETTER = "better"
    EXTEND = "extend"
    EMERGENCY = "emergency"
    KEEP = "keep"
    NO_PLAN = "no plan"
    REJECTED = "rejected"

    @property
    def kind(self) -> DecisionKind:
        """The kind of decision as which the verdict is recorded."""
        return _KINDS.get(self, DecisionKind.SWAP)

    @property
    def is_swap(self) -> bool:
        """Whether the plan replaces the flown one."""
        return self.kind is DecisionKind.SWAP

    @property
    def is_emergency(self) -> bool:
        """Whether no plan passes, so that an emergency step follows."""
        return self in (Verdict.NO_PLAN, Verdict.REJECTED)


_KINDS = {
    Verdict.KEEP: DecisionKind.KEEP,
    Verdict.NO_PLAN: DecisionKind.NO_PLAN,
    Verdict.REJECTED: DecisionKind.REJECTED,
}


@dataclass(frozen=True, slots=True)
class SwapDecision:
    """The judgement of a plan, with its reasons.

    Parameters
    ----------
    verdict : Verdict
        The verdict.
    text : str
        The reason in words.
    why : mapping
        The numbers behind the reason.
    holds_flown : bool
        Whether the flown path is held: out of pursuers' reach, and as good as when it was chosen.
    is_flyable_in_emergency : bool
        Whether a refused path leads to the goal and breaks only the limits of threat and quality.
    """

    verdict: Verdict
    text: str
    why: Mapping[str, object] = field(default_factory=dict)
    holds_flown: bool = False
    is_flyable_in_emergency: bool = False


def covered_s(state: FlightState, start: Start) -> float:
    """Return how long the autopilot's mission continues from a start [s]; infinite if it reaches the goal."""
    flown, rest = state.flown, start.rest
    if flown is None or rest is None:
        return 0.0
    return flown.covered_s(len(flown.path) - len(rest))


def covered_min_s(state: FlightState) -> float:
    """Return the time below which a mission is extended [s]."""
    return COVERED_HORIZONS_MIN * state.rules.time_horizon_s


def gain_of(plan: Plan) -> float:
    """Return the share of the flown path's cost that a plan saves; 0 if a cost is unknown or infinite."""
    flown_cost = plan.flown_cost or 0.0
    return 1.0 - plan.cost / flown_cost if flown_cost > 0.0 and plan.cost < math.inf else 0.0


@dataclass(frozen=True)
class _Case:
    """A plan to be judged, with the quantities that the rules use."""

    state: FlightState
    plan: Plan
    start: Start

    @cached_property
    def path(self) -> Path:
        """The plan's path; only valid if there is one."""
        assert self.plan.path is not None
        return self.plan.path

    @cached_property
    def threat(self) -> float:
        """The plan's highest threat level."""
        return float(self.path.threat_levels.max())

    @cached_property
    def holds_flown(self) -> bool:
        """Whether the flown path is held.

        A held path leads to the goal, no pursuer that knows it can reach it, and it costs no more than when
        it was chosen. A path assembled from the beginnings of several such paths need not be safe itself.
        """
        rest, risk, flown = self.start.rest, self.plan.flown_pursuit, self.state.flown
        if rest is None or risk is None or flown is None or risk.total_s > 0.0:
            return False
        is_pursued = any(not track.flies_on for track in self.state.picture.tracks)
        is_as_promised = (self.plan.flown_cost or 0.0) <= flown.cost
        return is_pursued and self.state.leads_to_goal(rest) and is_as_promised

    @cached_property
    def arrives_later(self) -> bool:
        """Whether the plan arrives later than the flown path does."""
        rest = self.start.rest
        return rest is not None and bool(self.path.times_s[-1] > rest.times_s[-1])

    @cached_property
    def rest_violations(self) -> tuple[Violation, ...]:
        """Violations of the rest of the flown path."""
        return () if self.start.rest is None else violations_of_rest(self.state, self.start.rest)

    @cached_property
    def violations(self) -> tuple[Violation, ...]:
        """Violations of the plan's path, apart from the threat that the aircraft is already under."""
        found = self.state.violations_of(self.path)
        if self.path.threat_levels[0] > self.state.rules.checker.limits.threat_level_max:
            return tuple(entry for entry in found if entry.rule != "threat")
        return found

    @cached_property
    def covered_s(self) -> float:
        """Time for which the mission continues from the start [s]; infinite if it reaches the goal."""
        return covered_s(self.state, self.start)


_Facts = dict[str, object]
_Answer = tuple[Verdict, str] | None


def _no_plan(case: _Case, _why: _Facts) -> _Answer:
    """Answer if no plan reaches the goal."""
    if case.plan.path is not None and case.plan.reaches_goal:
        return None
    return Verdict.NO_PLAN, "; ".join((case.plan.status.value, *case.plan.notes))


def _rejected(case: _Case, why: _Facts) -> _Answer:
    """Answer if the checker refuses the path."""
    why["threat"], violations = case.threat, case.violations
    if not violations:
        return None
    why["violations"] = [str(entry) for entry in violations[:VIOLATIONS_RECORDED_MAX]]
    return Verdict.REJECTED, f"{violations[0]} ({len(violations)} violations)"


def _flown_is_unsafe(case: _Case, why: _Facts) -> _Answer:
    """Answer if the rest of the flown path fails the check, because the world has changed."""
    if not case.rest_violations:
        return None
    why["flown_violations"] = [str(entry) for entry in case.rest_violations[:VIOLATIONS_RECORDED_MAX]]
    return Verdict.UNSAFE, f"flown plan: {case.rest_violations[0]}"


def _nothing_is_flown(case: _Case, _why: _Facts) -> _Answer:
    """Answer if there is no flown path to compare with."""
    if case.start.rest is not None and case.plan.flown_cost is not None:
        return None
    return Verdict.FIRST_PLAN, f"cost {case.plan.cost:.1f}"


def _is_better(case: _Case, why: _Facts) -> _Answer:
    """Answer if the plan saves ``swap_gain``; by (9) a path above the threat limit costs infinitely much."""
    gain = gain_of(case.plan)
    why |= {"gain": gain, "carried_s": case.covered_s, "carried_min_s": covered_min_s(case.state)}
    factor = LATER_GAIN_FACTOR if case.holds_flown and case.arrives_later else 1.0
    if gain < factor * float(case.state.mission.planning.swap_gain):
        return None
    flown_cost = case.plan.flown_cost or 0.0
    instead = f" instead of {flown_cost:.1f}"
    if flown_cost == math.inf:
        instead = ", and the flown path passes threat_level_max"
    return Verdict.BETTER, f"cost {case.plan.cost:.1f}{instead}"


def _is_extended_or_kept(case: _Case, _why: _Facts) -> _Answer:
    """Answer with extending if the autopilot's mission ends soon, otherwise with keeping."""
    is_short = case.covered_s < covered_min_s(case.state)
    text = f"cost {case.plan.cost:.1f}, flown {case.plan.flown_cost:.1f}"
    return Verdict.EXTEND if is_short else Verdict.KEEP, text


_RULES: tuple[Callable[[_Case, _Facts], _Answer], ...] = (
    _no_plan,
    _rejected,
    _flown_is_unsafe,
    _nothing_is_flown,
    _is_better,
    _is_extended_or_kept,
)


def field_facts(state: FlightState, path: Path) -> dict[str, object]:
    """Return for how many seconds of a path no field is within glide, and the stretches [s].

    Parameters
    ----------
    state : FlightState
        The rules, home, rally points and the wind.
    path : Path
        The path.
    """
    options = state.rules.glide_options(state.home_enu_m, state.rally_points)
    if options is None:
        return {}
    found = coverage_of_path(options, path, state.wind_enu_m_s)
    return {"no_field_s": found.without_s, "no_field_stretches_s": found.stretches}


def judge(state: FlightState, plan: Plan, start: Start) -> SwapDecision:
    """Judge whether a plan replaces the flown one.

    Parameters
    ----------
    state : FlightState
        The flown mission and the rules.
    plan : Plan
        The planner's answer.
    start : Start
        The start of the plan.
    """
    planning = state.mission.planning
    why: _Facts = {
        "status": plan.status.value,
        "cost": plan.cost,
        "gap": plan.gap,
        "flown_cost": plan.flown_cost,
        "flown_threat": plan.flown_threat,
        "swap_gain": float(planning.swap_gain),
        "threat_level_max": float(planning.threat_level_max),
    }
    case = _Case(state, plan, start)
    for rule in _RULES:
        answer = rule(case, why)
        if answer is not None:
            is_flyable = answer[0] is Verdict.REJECTED and keeps_hard_constraints(case.violations)
            if answer[0].is_swap:
                why |= field_facts(state, case.path)
            return SwapDecision(*answer, why, case.holds_flown, is_flyable)
    raise AssertionError("the table's last row always answers")
