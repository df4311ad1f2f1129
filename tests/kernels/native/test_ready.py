"""All kernels of the program: which there are, and who calls them."""

import ast
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from companion.kernels.native import build, kernel, kinds, ready
from companion.kernels.native.kernel import Kernel
from companion.kernels.native.store import Store
from tests.support.sources import ROOT, SOURCES, nodes_of, tree_of

pytestmark = pytest.mark.xdist_group("sources")


def called_from(path):
    """Kernels that a module imports."""
    for node in nodes_of(path):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("companion.kernels."):
            for alias in node.names:
                value = getattr(importlib.import_module(node.module), alias.name, None)
                if isinstance(value, Kernel):
                    yield value


@pytest.fixture(scope="module")
def called():
    """The kernels that Python calls, by symbol."""
    above = [path for path in SOURCES if not path.is_relative_to(ROOT / "companion" / "kernels")]
    return {one.symbol: one for path in above for one in called_from(path)}


def test_python_calls_kernels_that_are_compiled_beforehand_only(called):
    assert len(called) > 30
    assert {symbol for symbol, one in called.items() if one.is_inlined} == set()
    assert set(called) <= {one.symbol for one in ready.kernels()}


def test_every_kernel_is_there_for_another_or_for_python(called):
    """What only tests call would be compiled on every computer for nothing."""
    used = set(called)
    for module in sorted({one.py_func.__module__ for one in ready.kernels()}):
        values = vars(importlib.import_module(module)).values()
        used |= {callee.symbol for one in values if isinstance(one, Kernel) for callee in one.callees}
        source = tree_of((ROOT / Path(*module.split("."))).with_suffix(".py"))
        plain = [
            node for node in source.body if isinstance(node, ast.FunctionDef) and not node.decorator_list
        ]
        names = {name.id for node in plain for name in ast.walk(node) if isinstance(name, ast.Name)}
        used |= {f"{module}.{name}" for name in names}
    assert [one.symbol for one in ready.kernels() if one.symbol not in used] == []


def test_every_kernel_has_a_signature_and_a_key_of_its_own():
    keys = {one.key for one in ready.kernels()}
    assert len(keys) == len(ready.kernels()) > 150


def test_ready_ones_are_loaded_with_all_they_call():
    ready.make_ready()
    kernel.load(ready.kernels(), lambda done, total: pytest.fail("one was missing"))
    assert all(callee in kernel._process.loaded for one in ready.kernels() for callee in one.linked)


PLAIN = """
import numpy as np
from companion.kernels.aircraft.motion import advance
from companion.kernels.native.ready import kernels, make_ready
assert kernels() == []
make_ready()
out = np.empty(6)
advance(np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0]), 0.0, 0.0, 0.0, 1.0, out)
assert out[0] == 25.0
assert type(advance).__name__ == "function"
"""


def test_without_the_compiler_kernels_are_plain_functions(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    subprocess.run([sys.executable, "-c", PLAIN], check=True, timeout=120)


NAMES = ("membership", "set_course", "point_threat", "node_threat", "line_threat", "gather", "speed_share")


def of_threats():
    module = importlib.import_module("companion.kernels.threat.fuzzy_threat")
    return [getattr(module, name) for name in (*NAMES, "success_over_exposures", "turned_away")]


@pytest.mark.thorough
def test_many_are_compiled_by_other_processes_and_each_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(build, "kernel_store", lambda: Store(tmp_path / "kernels"))
    (tmp_path / "kernels").mkdir()
    monkeypatch.setattr(build, "num_workers", lambda _: 2)
    (tmp_path / "kernels" / "old.o").touch()
    os.utime(tmp_path / "kernels" / "old.o", (1e9, 1e9))
    told = []
    made = build.built(of_threats(), lambda done, total: told.append((done, total)))
    assert sorted(told) == [(done, 9) for done in range(1, 10)]
    assert {one: code[:4] for one, code in made.items()} == dict.fromkeys(of_threats(), b"\x7fELF")
    assert {path.name for path in (tmp_path / "kernels").glob("*.o")} == {one.file("o") for one in made}


@pytest.mark.parametrize(
    ("processors", "memory", "num_kernels", "expected"),
    [
        (2, 24e9, 200, 2),
        (64, 256e9, 200, 25),
        (4, 1.1e9, 200, 2),
        (1, 24e9, 200, 1),
        (4, 0.4e9, 200, 0),
        (8, 24e9, 7, 0),
    ],
)
def test_as_many_processes_as_processors_memory_and_work_are_worth(
    monkeypatch, processors, memory, num_kernels, expected
):
    monkeypatch.setattr(build.os, "sched_getaffinity", lambda _: set(range(processors)))
    monkeypatch.setattr(build.os, "sysconf", {"SC_PHYS_PAGES": int(memory) // 4096, "SC_PAGE_SIZE": 4096}.get)
    assert build.num_workers(num_kernels) == expected


def test_what_another_process_cannot_compile_is_told_by_name(monkeypatch, tmp_path):
    monkeypatch.setattr(build, "kernel_store", lambda: Store(tmp_path / "kernels"))
    (tmp_path / "kernels").mkdir()
    question = b"companion.kernels.threat.fuzzy_threat no_such_kernel\n"
    command = [sys.executable, "-m", build.__name__]
    answer = subprocess.run(command, input=question, capture_output=True, check=True, timeout=120).stdout
    assert answer.startswith(b"AttributeError: ")
    assert answer.endswith(b"\n")
    assert os.listdir(tmp_path / "kernels") == []


def test_a_signature_says_how_a_kernel_is_called(called):
    signature = called["companion.kernels.geometry.line_of_sight.sight_blocked"].signature
    assert signature.names[-1] == "walls"
    assert signature.kinds[:6] == (kinds.Scalar("f"),) * 6
    assert signature.returns == kinds.Scalar("b")
