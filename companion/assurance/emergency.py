"""The emergency steps in their order, for when no plan passes the checker, as a pure function.

Theory of operation: the table is read from the top, and the first row whose condition holds is the step. The
caller carries it out, announces it and records the reason.

======================  ==================================================================
step                    taken when
======================  ==================================================================
``KEEP_FLOWN``          the flown plan still passes the checker
``LEAST_THREAT``        a plan keeps the hard constraints, but breaks the limits of threat or quality
``LOITER``              a loiter circle within reach and the path to it pass
``RALLY_POINT``         a plan to one of the autopilot's rally points keeps the hard constraints
``RETURN_TO_LAUNCH``    the mission file allows it, and the path that the autopilot takes is clear
``LEAVE_TO_AUTOPILOT``  always: nothing is sent, and the autopilot continues its mission
======================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from companion.assurance.violation import SOFT_RULES, Violation, keeps_hard_constraints


class EmergencyStep(Enum):
    """The steps, the most preferred first."""

    KEEP_FLOWN = "keep the flown plan"
    LEAST_THREAT = "fly the least-threat plan"
    LOITER = "loiter at the safest reachable point"
    RALLY_POINT = "fly to a rally point"
    RETURN_TO_LAUNCH = "return to launch"
    LEAVE_TO_AUTOPILOT = "leave the autopilot with its mission"


@dataclass(frozen=True, slots=True, kw_only=True)
class EmergencyOptions:
    """The candidates for the steps; ``None`` means that there is no candidate.

    Parameters
    ----------
    flown : sequence of Violation or None
        Violations of the rest of the flown plan.
    least_threat : sequence of Violation or None
        Violations of the least-threat plan.
    loiter : sequence of Violation or None
        Violations of the safest loiter within reach and the path to it.
    rally : sequence of Violation or None
        Violations of the plan to a rally point.
    may_return : bool
        Whether the mission file allows return to launch.
    return_path : sequence of Violation or None
        Violations of the path that the autopilot would take to return.
    """

    flown: Sequence[Violation] | None
    least_threat: Sequence[Violation] | None
    loiter: Sequence[Violation] | None
    rally: Sequence[Violation] | None = None
    may_return: bool
    return_path: Sequence[Violation] | None = None


class EmergencyDecision(NamedTuple):
    """A step, and the reason for it."""

    step: EmergencyStep
    reason: str


def _passes(violations: Sequence[Violation] | None) -> bool:
    """Return whether there is a candidate that breaks nothing."""
    return violations is not None and not violations


def _is_flyable(violations: Sequence[Violation] | None) -> bool:
    """Return whether there is a candidate that keeps the hard constraints."""
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
    """Choose the first step that can be taken, and say why the earlier ones cannot.

    Parameters
    ----------
    options : EmergencyOptions
        The checker's result for each candidate.
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
    """Return why a candidate is refused: it does not exist, or the first hard rule that it breaks."""
    if violations is None:
        return missing or f"no {name.removeprefix('the ')}"
    ordered = sorted(violations, key=lambda violation: violation.rule in SOFT_RULES)
    more = f" and {len(ordered) - 1} more" if len(ordered) > 1 else ""
    return f"{name} breaks {ordered[0]}{more}" if ordered else f"{name} passes"
