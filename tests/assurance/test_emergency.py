"""Emergency steps in their order, over every combination of what there is."""

import itertools

import pytest

from companion.assurance.emergency import EmergencyOptions, EmergencyStep, emergency_decision
from companion.assurance.violation import Violation, keeps_hard_constraints

HARD = Violation("clearance", 4, 3.0, 15.0, "distance to barn [m]")
SOFT = Violation("threat", 7, 0.9, 0.5, "threat level")
GOOD, RISKY, BAD, NONE = (), (SOFT,), (SOFT, HARD), None


def decide(flown=NONE, least_threat=NONE, loiter=NONE, rally=NONE, may_return=False, return_path=NONE):
    return emergency_decision(
        EmergencyOptions(
            flown=flown, least_threat=least_threat, loiter=loiter, rally=rally, may_return=may_return,
            return_path=return_path,
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("situation", "step"),
    [
        ({"flown": GOOD, "least_threat": GOOD, "loiter": GOOD, "may_return": True}, EmergencyStep.KEEP_FLOWN),
        ({"flown": RISKY, "least_threat": GOOD}, EmergencyStep.LEAST_THREAT),
        ({"flown": RISKY, "least_threat": RISKY, "loiter": GOOD}, EmergencyStep.LEAST_THREAT),
        ({"flown": BAD, "least_threat": BAD, "loiter": GOOD, "may_return": True}, EmergencyStep.LOITER),
        (
            {"flown": NONE, "least_threat": NONE, "loiter": RISKY, "may_return": True, "return_path": GOOD},
            EmergencyStep.RETURN_TO_LAUNCH,
        ),
        ({"loiter": BAD, "rally": RISKY, "may_return": True, "return_path": GOOD}, EmergencyStep.RALLY_POINT),
        ({"rally": BAD, "may_return": True, "return_path": GOOD}, EmergencyStep.RETURN_TO_LAUNCH),
        ({"rally": BAD, "may_return": True, "return_path": BAD}, EmergencyStep.LEAVE_TO_AUTOPILOT),
        ({"may_return": True}, EmergencyStep.LEAVE_TO_AUTOPILOT),  # where it leads is not known
        ({"return_path": GOOD}, EmergencyStep.LEAVE_TO_AUTOPILOT),
        ({"flown": BAD, "loiter": BAD}, EmergencyStep.LEAVE_TO_AUTOPILOT),
        ({}, EmergencyStep.LEAVE_TO_AUTOPILOT),
    ],
)
def test_steps_by_hand(situation, step):
    assert decide(**situation).step is step


def test_every_combination_takes_the_first_step_that_can_be_taken():
    order = list(EmergencyStep)
    kinds = (GOOD, RISKY, BAD, NONE)
    for flown, least, loiter, rally, may_return, home in itertools.product(
        kinds, kinds, kinds, kinds, (False, True), kinds
    ):
        possible = [
            flown == GOOD, least in (GOOD, RISKY), loiter == GOOD, rally in (GOOD, RISKY),
            may_return and home == GOOD, True,
        ]  # fmt: skip
        expected = order[possible.index(True)]
        decision = decide(flown, least, loiter, rally, may_return, home)
        assert decision.step is expected
        assert decision.reason


def test_the_reason_says_why_better_steps_were_not_taken():
    reason = decide(flown=BAD, least_threat=None, loiter=GOOD).reason
    assert reason == (
        "the flown plan breaks row 4: distance to barn [m]: 3, limit 15 (clearance) and 1 more; "
        "no least-threat plan; a loiter within reach passes"
    )


@pytest.mark.parametrize(
    ("home", "words"),
    [
        (NONE, "the way home is not known"),
        (BAD, "the way home breaks row 4: distance to barn [m]: 3, limit 15 (clearance) and 1 more"),
    ],
)
def test_the_reason_says_why_it_is_not_returned_to_launch(home, words):
    reason = decide(may_return=True, return_path=home).reason
    assert reason == (
        f"no flown plan; no least-threat plan; no loiter; no rally point that can be planned to; {words}; "
        "nothing better is left"
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
