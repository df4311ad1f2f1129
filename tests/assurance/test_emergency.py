"""Emergency steps in their order, over every combination of what there is."""

import itertools

import pytest

from companion.assurance.checker import Violation
from companion.assurance.emergency import (
    EmergencyOptions,
    EmergencyStep,
    emergency_decision,
    keeps_hard_constraints,
)

HARD = Violation("clearance", 4, 3.0, 15.0, "distance to barn [m]")
SOFT = Violation("threat", 7, 0.9, 0.5, "threat level")
GOOD, RISKY, BAD, NONE = (), (SOFT,), (SOFT, HARD), None


def decide(flown=NONE, least_threat=NONE, loiter=NONE, may_return=False):
    return emergency_decision(
        EmergencyOptions(flown=flown, least_threat=least_threat, loiter=loiter, may_return=may_return)
    )


@pytest.mark.parametrize(
    ("situation", "step"),
    [
        ({"flown": GOOD, "least_threat": GOOD, "loiter": GOOD, "may_return": True}, EmergencyStep.KEEP_FLOWN),
        ({"flown": RISKY, "least_threat": GOOD}, EmergencyStep.LEAST_THREAT),
        ({"flown": RISKY, "least_threat": RISKY, "loiter": GOOD}, EmergencyStep.LEAST_THREAT),
        ({"flown": BAD, "least_threat": BAD, "loiter": GOOD, "may_return": True}, EmergencyStep.LOITER),
        (
            {"flown": NONE, "least_threat": NONE, "loiter": RISKY, "may_return": True},
            EmergencyStep.RETURN_TO_LAUNCH,
        ),
        ({"flown": BAD, "loiter": BAD}, EmergencyStep.LEAVE_TO_AUTOPILOT),
        ({}, EmergencyStep.LEAVE_TO_AUTOPILOT),
    ],
)
def test_steps_by_hand(situation, step):
    assert decide(**situation).step is step


def test_every_combination_takes_the_first_step_that_can_be_taken():
    order = list(EmergencyStep)
    kinds = (GOOD, RISKY, BAD, NONE)
    for flown, least, loiter, may_return in itertools.product(kinds, kinds, kinds, (False, True)):
        possible = [flown == GOOD, least in (GOOD, RISKY), loiter == GOOD, may_return, True]
        expected = order[possible.index(True)]
        decision = decide(flown, least, loiter, may_return)
        assert decision.step is expected
        assert decision.reason


def test_the_reason_says_why_better_steps_were_not_taken():
    reason = decide(flown=BAD, least_threat=None, loiter=GOOD).reason
    assert reason == (
        "the flown plan breaks row 4: distance to barn [m]: 3, limit 15 (clearance) and 1 more; "
        "no least-threat plan; a loiter within reach passes"
    )


def test_only_threat_and_quality_are_soft():
    assert keeps_hard_constraints(())
    assert keeps_hard_constraints((SOFT, Violation("quality", 0, 0.1, 0.5, "product of p_c")))
    for rule in (
        "clearance",
        "bounds",
        "turn_radius",
        "straight",
        "climb",
        "finite",
        "time",
        "pace",
        "ending",
    ):
        assert not keeps_hard_constraints((SOFT, Violation(rule, 0, 0.0, 0.0, "")))
