"""Pytest in processes of its own, which start with the libraries imported, and what it is told there."""

import collections
import contextlib
import json
import os
import signal
import sys
import traceback

import pytest

from tests.mutants.choice import ROOT, is_shared

QUICK = "not slow and not bench and not real and not page and not mavproxy"
# Pytest warns of plugins that are imported already.
OPTIONS = "-q", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", QUICK
SLOWER_MAX = 10.0  # A test that takes so many times longer than usual has noticed the mutant.
BROKEN = 70  # The exit code of a process that does not come to its end.
STARTING_S = 120.0  # It may take so much more, to import, and to compile kernels.


class Durations:
    """Notes how long each test takes that passes, as a plugin of pytest."""

    def __init__(self, folder):
        self._file, self._seconds, self._bad = folder / "durations.json", collections.Counter(), set()

    def pytest_runtest_logreport(self, report):
        self._seconds[report.nodeid] += report.duration
        if not report.passed:
            self._bad.add(report.nodeid)

    def pytest_sessionfinish(self):
        good = {name: took_s for name, took_s in self._seconds.items() if name not in self._bad}
        self._file.write_text(json.dumps(good, indent=0), encoding="utf-8")


class Shortest:
    """Runs chosen tests, and all of some files, the shortest first, each with a time limit.

    The limit is an alarm that ends the process, for what hangs in machine code hears no exception.
    """

    def __init__(self, tests, files, seconds):
        self._tests, self._files, self._seconds = tests, files, seconds

    def pytest_collection_modifyitems(self, config, items):
        chosen, left, together = [], [], collections.Counter()
        for item in items:
            is_chosen = item.nodeid in self._tests or item.nodeid.partition("::")[0] in self._files
            (chosen if is_chosen else left).append(item)
            together[self._group(item)] += self._usual(item.nodeid) if is_chosen else 0.0
        config.hook.pytest_deselected(items=left)
        items[:] = sorted(chosen, key=lambda item: (together[self._group(item)], self._usual(item.nodeid)))

    def pytest_runtest_logstart(self, nodeid):
        signal.setitimer(signal.ITIMER_REAL, STARTING_S + SLOWER_MAX * self._usual(nodeid))

    def _usual(self, nodeid):
        return self._seconds.get(nodeid, 0.0)

    @staticmethod
    def _group(item):
        """Tests of a file stay together if they share what is made once."""
        file = item.nodeid.partition("::")[0]
        return file if is_shared(file) else item.nodeid


def in_child(folder, arguments, plugin=None):
    """Run pytest in the copy in a folder, and write what it prints there; return its exit code."""
    child = os.fork()
    if not child:
        try:
            _child(folder, arguments, plugin)
        finally:
            traceback.print_exc()
            os._exit(BROKEN)
    status = os.waitpid(child, 0)[1]
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # What it has started may still run.
    code = os.waitstatus_to_exitcode(status)
    if code in (BROKEN, pytest.ExitCode.USAGE_ERROR):
        raise RuntimeError((folder / "log").read_text(encoding="utf-8")[-2000:])
    return code


def _child(folder, arguments, plugin):
    os.setsid()
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, STARTING_S if isinstance(plugin, Shortest) else 0.0)
    output = os.open(folder / "log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(folder / "copy")
    sys.dont_write_bytecode = isinstance(plugin, Shortest)
    sys.path[:] = [str(folder / "copy"), *(entry for entry in sys.path if entry not in ("", str(ROOT)))]
    for name in [name for name in sys.modules if name.partition(".")[0] in ("tests", "companion", "sim")]:
        del sys.modules[name]
    plugins = [] if plugin is None else [plugin]
    code = int(pytest.main([*OPTIONS, *arguments], plugins=plugins))
    sys.stdout.flush()
    os._exit(code)
