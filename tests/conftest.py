"""How Hypothesis searches, the same examples at every run unless asked otherwise; and the command line."""

import os

import pytest
from hypothesis import settings

from tests.cli.calls import Caller

settings.register_profile("seeded", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "seeded"))


@pytest.fixture
def companion_command(monkeypatch, capsys):
    """The command line, for tests of what lies behind it."""
    return Caller(monkeypatch, capsys)
