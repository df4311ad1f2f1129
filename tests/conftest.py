"""How Hypothesis searches, the command line, and which tests stay together when processes share the suite."""

import os

import pytest
from hypothesis import settings

from tests.cli.calls import Caller

settings.register_profile("seeded", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "seeded"))


# Tests that need compiled kernels, by how their names begin, and why: `make coverage` leaves them
# out where it runs kernels as Python.
NO_INTRINSICS = "kernels that borrow arrays use an intrinsic, which only compiled code has"
COMPILED = {
    "tests/kernels/test_borrowed.py": NO_INTRINSICS,
    "tests/kernels/search/test_rrt_star.py": NO_INTRINSICS,
    "tests/kernels/threat/test_reachability.py::test_every_estimator_finds": NO_INTRINSICS,
    "tests/kernels/threat/test_reachability.py::test_what_a_threat_reaches_by_driving": NO_INTRINSICS,
    "tests/kernels/threat/test_reachability.py::test_several_threats_are_told_apart": NO_INTRINSICS,
    "tests/kernels/threat/test_reachability.py::test_positions_along_a_path": NO_INTRINSICS,
    "tests/kernels/threat/test_threat_tree.py": "takes many minutes as Python",
    "tests/kernels/aircraft/test_motion.py::test_controls_keep": "subtracts booleans, as numba may",
    "tests/kernels/geometry/test_prism_distance.py::test_boxes_crossed": "numpy warns where numba goes on",
}


@pytest.fixture
def companion_command(monkeypatch, capsys):
    """The command line, for tests of what lies behind it."""
    return Caller(monkeypatch, capsys)


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks for the marks
def pytest_collection_modifyitems(items):
    """Mark what needs compiled kernels, and keep together what shares things made once a process.

    No flight is flown twice so. Fixtures of a module say themselves that they are shared. What a cached
    function makes does not: modules that use one name their group, as
    ``pytestmark = pytest.mark.xdist_group("recorded flights")``.
    """
    for item in items:
        if item.nodeid.startswith(tuple(COMPILED)):
            item.add_marker("compiled")
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
