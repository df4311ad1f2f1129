"""The command line, for tests of what lies behind it."""

import pytest

from tests.cli.calls import Caller


@pytest.fixture
def companion_command(monkeypatch, capsys):
    return Caller(monkeypatch, capsys)
