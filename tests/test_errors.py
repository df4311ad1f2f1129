"""Errors made on purpose: their family, their exit codes and their words."""

import pytest

from companion import errors
from companion.errors import (
    CompanionError,
    ConfigError,
    LinkError,
    NoAutopilotError,
    PlannerError,
    PluginError,
    RecordError,
    ThreatModelError,
    TransferError,
)

CODES = {
    CompanionError: 4,
    ConfigError: 2,
    LinkError: 3,
    NoAutopilotError: 3,
    TransferError: 3,
    RecordError: 2,
    PluginError: 2,
    PlannerError: 2,
    ThreatModelError: 2,
}


def test_no_error_is_forgotten_here():
    made = {
        value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, Exception)
    }
    assert made == CODES.keys()


@pytest.mark.parametrize("kind", CODES, ids=lambda kind: kind.__name__)
def test_exit_codes(kind):
    assert issubclass(kind, CompanionError)
    assert kind.exit_code == CODES[kind]


@pytest.mark.parametrize("kind", [NoAutopilotError, TransferError])
def test_link_failures_are_caught_as_such(kind):
    assert issubclass(kind, LinkError)


def test_a_config_error_is_one_line_with_the_place():
    error = ConfigError("m.yaml", 7, "goals.0.east_m", '"far"', "a number (metres)")
    assert str(error) == 'm.yaml:7: goals.0.east_m: got "far"; expected a number (metres)'


def test_without_a_line_the_file_alone_is_named():
    assert str(ConfigError("m.yaml", None, "file", "nothing", "a mapping")).startswith("m.yaml: file: got ")


def test_a_transfer_error_names_the_operation():
    assert str(TransferError("upload", "TIMEOUT")) == "mission upload: TIMEOUT"


@pytest.mark.parametrize(
    "error", [ConfigError("m.yaml", 7, "key", "value", "other"), TransferError("upload", "TIMEOUT")]
)
def test_they_can_be_raised_caught_and_raised_from(error):
    with pytest.raises(type(error)) as caught:
        raise error from OSError("underneath")
    assert caught.value is error
    assert isinstance(error.__cause__, OSError)
