"""What to do when no plan passes the checker: the steps in their order, as a pure function.

Theory of operation: the table below is read from the top; the first row whose condition holds is the
step. Whoever carries it out announces the step and records the reason.

======================  ==================================================================
step                    taken when
======================  ==================================================================
``KEEP_FLOWN``          the plan being flown still passes the checker
``LEAST_THREAT``        a plan keeps the hard constraints, though threat or quality are past their limits
``LOITER``              a reachable point has a loiter circle and a way to it that pass
``RALLY_POINT``         a plan to a rally point of the autopilot's keeps the hard constraints
``RETURN_TO_LAUNCH``    the mission file allows it, and the way that the autopilot takes keeps clear
``LEAVE_TO_AUTOPILOT``  always: nothing is sent, the autopilot goes on with the mission it holds
======================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from companion.assurance.violation import SOFT_RULES, Violation, keeps_hard_constraints


class EmergencyStep(Enum):
    """Steps, the most wanted first."""

    KEEP_FLOWN = "keep the flown plan"
    LEAST_THREAT = "fly the least-threat plan"
    LOITER = "loiter at the safest reachable point"
    RALLY_POINT = "fly to a rally point"
    RETURN_TO_LAUNCH = "return to launch"
    LEAVE_TO_AUTOPILOT = "leave the autopilot with its mission"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmergencyOptions:
    """What the steps are chosen by; ``None`` stands for something that there is not.

    Parameters
    ----------
    flown : sequence of Violation or None
        What the rest of the plan being flown breaks.
    least_threat : sequence of Violation or None
        What the least-threat plan breaks.
    loiter : sequence of Violation or None
        What the safest reachable loiter and the way to it break.
    rally : sequence of Violation or None
        What the plan to a rally point breaks.
    may_return : bool
        Whether the mission file allows return to launch.
    return_path : sequence of Violation or None
        What the way breaks that the autopilot would take.
    """

    flown: Sequence[Violation] | None
    least_threat: Sequence[Violation] | None
    loiter: Sequence[Violation] | None
    rally: Sequence[Violation] | None = None
    may_return: bool
    return_path: Sequence[Violation] | None = None


class EmergencyDecision(NamedTuple):
    """A step and why it was taken."""

    step: EmergencyStep
    reason: str


def _passes(violations: Sequence[Violation] | None) -> bool:
    """Whether there is something, and it breaks nothing."""
    return violations is not None and not violations


def _is_flyable(violations: Sequence[Violation] | None) -> bool:
    """Whether there is something, and it keeps the hard constraints."""
    return violations is not None and keeps_hard_constraints(violations)


_TABLE: tuple[tuple[EmergencyStep, Callable[[EmergencyOptions], bool], str], ...] = (
    (EmergencyStep.KEEP_FLOWN, lambda s: _passes(s.flown), "the flown plan still passes"),
    (EmergencyStep.LEAST_THREAT, lambda s: _is_flyable(s.least_threat), "it keeps the hard constraints"),
    (EmergencyStep.LOITER, lambda s: _passes(s.loiter), "a loiter within reach passes"),
    (EmergencyStep.RALLY_POINT, lambda s: _is_flyable(s.rally), "the way there keeps the hard constraints"),
    (
        EmergencyStep.RETURN_TO_LAUNCH,
        lambda s: s.may_return and _passes(s.return_path),
        "the mission file allows it, and the way there keeps clear",
    ),
    (EmergencyStep.LEAVE_TO_AUTOPILOT, lambda _: True, "nothing better is left"),
)


def emergency_decision(options: EmergencyOptions) -> EmergencyDecision:
    """Choose the first step that can be taken, and say why those before it could not.

    Parameters
    ----------
    options : EmergencyOptions
        What the checker said of each candidate.
    """
    refused = {
        EmergencyStep.KEEP_FLOWN: _refusal("the flown plan", options.flown),
        EmergencyStep.LEAST_THREAT: _refusal("the least-threat plan", options.least_threat),
        EmergencyStep.LOITER: _refusal("the loiter", options.loiter),
        EmergencyStep.RALLY_POINT: _refusal(
            "the way to a rally point", options.rally, "no rally point that can be planned to"
        ),
        EmergencyStep.RETURN_TO_LAUNCH: (
            _refusal("the way home", options.return_path, "the way home is not known")
            if options.may_return
            else "the mission file does not allow return to launch"
        ),
    }
    reasons: list[str] = []
    for step, can_be_taken, because in _TABLE:
        if can_be_taken(options):
            return EmergencyDecision(step, "; ".join([*reasons, because]))
        reasons.append(refused[step])
    raise AssertionError("the table's last row always holds")


def _refusal(name: str, violations: Sequence[Violation] | None, missing: str = "") -> str:
    """Why a candidate is not taken: that there is none, or the first hard rule it breaks."""
    if violations is None:
        return missing or f"no {name.removeprefix('the ')}"
    ordered = sorted(violations, key=lambda violation: violation.rule in SOFT_RULES)
    more = f" and {len(ordered) - 1} more" if len(ordered) > 1 else ""
    return f"{name} breaks {ordered[0]}{more}" if ordered else f"{name} passes"
