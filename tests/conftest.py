"""How Hypothesis searches, the command line, and which tests stay together when processes share the suite."""

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


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks for the marks
def pytest_collection_modifyitems(items):
    """Keep tests together that share what is made once a process, so that no flight is flown twice.

    Fixtures of a module say so themselves. What a cached function makes does not: modules that use one
    name their group, as ``pytestmark = pytest.mark.xdist_group("recorded flights")``.
    """
    for item in items:
        if item.get_closest_marker("xdist_group") is None and (shared := _shared(item)):
            item.add_marker(pytest.mark.xdist_group(shared))


def _shared(item):
    """Name of the widest fixture of the tests' own that an item shares with others, '' without one."""
    for name, definitions in getattr(item, "_fixtureinfo").name2fixturedefs.items():  # noqa: B009
        definition = definitions[-1]
        if definition.scope == "module" and definition.baseid:
            parameters = getattr(item, "callspec", None)
            value = "" if parameters is None else parameters.params.get(name, "")
            return f"{definition.baseid}:{name}:{value}"
    return ""
