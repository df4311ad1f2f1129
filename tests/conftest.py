"""How Hypothesis searches, the command line, coroutines as tests, and which tests stay together.

The last is for processes that share the suite.
"""

import asyncio
import functools
import inspect
import os
import re
from pathlib import Path

# Before numpy is imported, which reads it once. Matrices here have six rows: threads that share them out
# do nothing but wait for each other, and the planner's tables took 25 times the processor time for it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings
from xdist.scheduler import LoadScopeScheduling

from tests.cli.calls import Caller

settings.register_profile("seeded", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "seeded"))


ROOT = Path(__file__).parents[1]
REWIRED = (
    "tests/kernels/printed/test_rrt_star.py::test_rewiring_keeps_the_tree_whole_and_the_goal_gets_no_dearer"
)
# Tests that need compiled kernels, by how their names begin, and why: `make coverage` leaves them
# out where it runs kernels as Python.
COMPILED = {
    "tests/kernels/native/test_kernel.py::test_compiled": "as Python, nobody checks and division raises",
    "tests/kernels/native/test_kept_code.py": "as Python, nothing is kept",
    "tests/kernels/native/test_ready.py": "as Python, there are no kernels",
    **{f"{REWIRED}[{seed}": "two of eight are enough, in half a minute each" for seed in (0, 2, 3)},
    "tests/kernels/printed/test_threat_tree.py": "takes many minutes as Python",
    "tests/kernels/geometry/test_radar_shadow.py::test_the_field_is": "takes a minute as Python",
    "tests/kernels/geometry/test_line_of_sight.py::test_lines_agree": "numpy warns where numba goes on",
    "tests/kernels/geometry/test_prism_distance.py::test_boxes_crossed": "numpy warns where numba goes on",
}


# Long tests that show what others show, by how their names begin: they are left to `make test-long`.
REPEATED = (
    *(
        f"tests/flight/test_somebody_else.py::test_after_safe_a_handback_within_ten_seconds_hits_nothing[{at_s}"
        for at_s in (48, 54, 66)
    ),
    "tests/flight/monitors/test_return_watch.py::test_where_nothing_was_announced_a_return_hits_nothing[80",
    "tests/flight/monitors/test_return_watch.py::test_where_it_was_called_not_safe_it_hits[120",
    "tests/flights/test_team.py::test_two_that_fly_towards_each_other_agree_to_pass_apart[px4",
    "tests/returns/test_return_flights.py::test_by_the_checked_path_it_touches_nothing_with_the_service_killed[px4",
    "tests/flight/test_wind.py::test_where_it_will_be_in_half_a_minute_is_known_in_the_wind[px4",
    "tests/ground/test_flights_over_ground.py::test_ridges_are_passed_low_and_out_of_the_radars_sight[px4",
    "tests/flight/test_flight_day.py::test_two_flights_a_day_without_a_restart[px4",
    *(
        f"tests/service/replay/test_corruptions.py::test_a_few_corruptions_of_a_part[px4-1.17dev-replace.tlog-{kind}"
        for kind in ("flipped", "shuffled")
    ),
)


@pytest.fixture
def companion_command(monkeypatch, capsys):
    """The command line, for tests of what lies behind it."""
    return Caller(monkeypatch, capsys)


COROUTINE_S = 30.0  # Of one test; only what hangs takes so long.


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem):
    """Run a test that is a coroutine in a loop of its own."""
    test = pyfuncitem.obj
    if not inspect.iscoroutinefunction(test):
        return None
    given = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    asyncio.run(asyncio.wait_for(test(**given), COROUTINE_S))
    return True


def pytest_itemcollected(item):
    """Mark what needs compiled kernels, and what is long and repeats another test."""
    if item.nodeid.startswith(tuple(COMPILED)):
        item.add_marker("compiled")
    if item.nodeid.startswith(REPEATED):
        item.add_marker("slow")


def pytest_xdist_make_scheduler(config, log):
    """Share tests out one by one, but those together that share what is made once a process.

    pytest-xdist 3.8 does so by itself with ``--dist loadgroup``, but not under pytest 9.2, which no longer
    lets it write a group into a test's name.
    """

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.partition("::")[0]
            return _group_of(ROOT / file) or nodeid

    return Together(config, log)


@functools.cache
def _group_of(file):
    """The group that a file's ``pytestmark`` names; the file itself if it has fixtures of the module."""
    text = file.read_text(encoding="utf-8")
    named = re.search(r"^pytestmark = pytest\.mark\.xdist_group\(\"(.+)\"\)", text, flags=re.M)
    if named is not None:
        return named[1]
    return str(file) if 'scope="module"' in text else ""


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Where a test installs packages of others; they are forgotten after it."""
    from tests.support.foreign_packages import Packages  # noqa: PLC0415  # Few tests need the planner.

    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    made = Packages(folder)
    made.forget()
    yield made
    made.forget()
