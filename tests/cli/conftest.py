"""The caller of the command line."""

import pytest

from tests.cli.calls import Caller


@pytest.fixture
def companion(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("NO_COLOR", "1")
    return Caller(monkeypatch, capsys)
