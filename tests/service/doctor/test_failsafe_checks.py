"""What the doctor says of the autopilot's failsafes, by the values that the autopilots document."""

import pytest

from companion.service.doctor.failsafe_checks import failsafe_findings, failsafe_names
from companion.service.doctor.finding import Verdict
from companion.service.doctor.parameter_checks import FAILSAFES
from companion.types.events import Dialect
from sim.autopilot.autopilot_parameters import Parameters

OK, WARN = Verdict.OK, Verdict.WARN
CASES = [
    (Dialect.ARDUPILOT, {"BATT_MONITOR": 4.0, "BATT_FS_LOW_ACT": 1.0}, OK, "battery low: return to launch"),
    (
        Dialect.ARDUPILOT, {"BATT_MONITOR": 0.0, "BATT_FS_LOW_ACT": 1.0}, OK,
        "battery low: nothing (BATT_MONITOR 0)",
    ),
    (
        Dialect.ARDUPILOT, {"FS_LONG_ACTN": 2.0}, WARN,
        "remote control or ground station lost for long: it glides straight on",
    ),
    (Dialect.ARDUPILOT, {"FENCE_ENABLE": 1.0, "FENCE_ACTION": 1.0}, OK, "fence crossed: return to launch"),
    (
        Dialect.ARDUPILOT, {"FENCE_ENABLE": 0.0, "FENCE_ACTION": 6.0}, OK,
        "fence crossed: nothing (FENCE_ENABLE 0)",
    ),
    (Dialect.ARDUPILOT, {"FS_SHORT_ACTN": 9.0}, WARN, "remote control lost: unknown"),
    (Dialect.PX4, {"COM_LOW_BAT_ACT": 2.0}, WARN, "battery low: it lands where it is"),
    (Dialect.PX4, {"NAV_RCL_ACT": 2.0}, OK, "remote control lost: return to launch"),
    (Dialect.PX4, {"NAV_DLL_ACT": 5.0}, WARN, "ground station lost: it terminates"),
    (Dialect.PX4, {"GF_ACTION": 2.0}, OK, "fence crossed: it circles where it is"),
]  # fmt: skip


@pytest.mark.parametrize(("dialect", "values", "verdict", "words"), CASES)
def test_the_action_of_a_failsafe_is_told_in_words(dialect, values, verdict, words):
    (finding,) = failsafe_findings(FAILSAFES[dialect], values)
    assert (finding.verdict, finding.found) == (verdict, words)
    assert bool(finding.advice) is (verdict is WARN)


@pytest.mark.parametrize("dialect", list(Dialect))
def test_parameters_that_an_autopilot_does_not_have_are_left_out(dialect):
    assert failsafe_findings(FAILSAFES[dialect], {}) == []


@pytest.mark.parametrize(
    ("dialect", "parameters"), [(Dialect.ARDUPILOT, Parameters()), (Dialect.PX4, Parameters.px4_defaults())]
)
def test_the_defaults_of_the_autopilots_are_predicted(dialect, parameters):
    parameters.add_battery()
    values = {
        name: parameters[name] for name in failsafe_names(FAILSAFES[dialect]) if name in parameters.names
    }
    findings = failsafe_findings(FAILSAFES[dialect], values)
    assert len(findings) >= 4
    assert {finding.verdict for finding in findings} == {OK}
