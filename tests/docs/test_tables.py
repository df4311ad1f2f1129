"""Tables on the pages tell what the code does: the autopilots' parameters, the pilot's, the decisions."""

import re
from pathlib import Path

import pytest

from companion.config import mission_from_text
from companion.config.parameters.pilot_parameters import ENABLE, TABLE, Parameters
from companion.flight.state.decision import DecisionKind, Verdict
from companion.service.doctor.failsafe_checks import failsafe_names
from companion.service.doctor.parameter_checks import FAILSAFES, PARAMETER_CHECKS, parameter_names
from companion.types.events import Dialect
from tests.support.sitl_harness import FIRST_FLIGHT

DOCS = Path(__file__).parents[2] / "docs"
SECTIONS = {Dialect.ARDUPILOT: "ArduPlane", Dialect.PX4: "PX4"}
NUMBERED = re.compile(r"(SERIAL|MAV_|SER_TEL)\d")


def table(page, heading):
    """Rows below a heading, each a list of cells, without the two lines of the table's head."""
    text = (DOCS / page).read_text(encoding="utf-8").split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    return [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| `")]


def values(dialect):
    """What the page wants a parameter to be, in its own words."""
    rows = table("connecting.md", SECTIONS[dialect])
    return {name: value for names, value, _ in rows for name in re.findall(r"`(\w+)`", names)}


@pytest.mark.parametrize("dialect", Dialect)
def test_the_page_has_the_parameters_that_doctor_needs_and_no_others_than_are_read(dialect):
    needed = {NUMBERED.sub(r"\1n", name) for name in parameter_names(dialect)}
    also = {*failsafe_names(FAILSAFES[dialect]), *dialect.parameter_names.values()}
    assert needed <= values(dialect).keys() <= needed | also


@pytest.mark.parametrize(
    ("check", "words"),
    [(check, values(dialect)[check.name]) for dialect in Dialect for check in PARAMETER_CHECKS[dialect]],
    ids=lambda entry: getattr(entry, "name", ""),
)
def test_doctor_is_content_with_the_page_s_values_and_with_no_others(check, words):
    numbers = [float(number) for number in re.findall(r"\d+", words)]
    assert numbers
    assert all(map(check.is_good, numbers))
    assert not check.is_good(max(numbers) + 1.0)
    if " to " in words:
        assert not check.is_good(min(numbers) - 1.0)


def test_the_pilot_s_parameters_are_those_of_the_code_with_the_ranges_of_the_mission_file():
    rows = table("connecting.md", "What the pilot may change in the field")
    assert [row[0].strip("`") for row in rows] == [entry.name for entry in TABLE]
    allowed = {row[0].strip("`"): row[2] for row in table("mission-file.md", "planning")}
    for entry, (_, range_, default, _) in zip(TABLE, rows, strict=True):
        if entry.name == ENABLE:
            assert (range_, default) == ("0 or 1", "1")
        else:
            assert (f"number {range_}", default) == (allowed[entry.key], f"`{entry.key}`")


def test_the_switch_takes_what_the_page_says():
    station = (255, 190)
    parameters = Parameters(mission_from_text(FIRST_FLIGHT, "first-flight.yaml"), None)
    assert parameters.value(ENABLE) == 1.0
    assert parameters.set(ENABLE, 0.0, station) == parameters.set(ENABLE, 1.0, station) == ""
    assert parameters.set(ENABLE, 2.0, station) == parameters.set(ENABLE, 0.5, station) == "0 or 1"


def test_every_kind_of_decision_is_explained():
    rows = table("first-flight.md", "Why did it replan at 12:03?")
    explained = {name for row in rows for name in re.findall(r"`([a-z: ]+)`", row[0])}
    told = {kind.value for kind in DecisionKind if kind is not DecisionKind.SWAP}
    swaps = {f"swap: {verdict.value}" for verdict in Verdict if verdict.is_swap}
    assert explained == told | swaps
