"""Compiled kernels do not outlive a change of any source, and run without the compiler, too."""

import subprocess
import sys
from pathlib import Path

import pytest

from companion import kernels
from companion.kernels import _cache_folder

SOURCES = sorted(
    path.relative_to(Path(kernels.__file__).parent).as_posix()
    for path in Path(kernels.__file__).parent.rglob("*.py")
)


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A copy of all kernel sources, whose cache folder :func:`_cache_folder` names."""
    for name in SOURCES:
        source = tmp_path / "kernels" / name
        source.parent.mkdir(parents=True, exist_ok=True)
        source.write_bytes((Path(kernels.__file__).parent / name).read_bytes())
    monkeypatch.setattr(kernels, "__file__", str(tmp_path / "kernels" / "__init__.py"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "kernels"


def test_there_are_kernels_in_every_folder():
    assert {name.split("/")[0] for name in SOURCES if "/" in name} >= {
        "geometry",
        "aircraft",
        "threat",
        "search",
    }


@pytest.mark.parametrize("name", SOURCES)
def test_a_change_in_any_source_names_another_folder(copied, name):
    before = _cache_folder()
    assert _cache_folder() == before
    source = copied / name
    source.write_bytes(source.read_bytes() + b"\n")
    after = _cache_folder()
    assert after != before
    assert after.parent == before.parent


PLAIN = """
import numpy as np
from companion.kernels.borrowed import borrowed
from companion.kernels.aircraft.motion import advance
values = np.arange(3.0)
assert borrowed(values) is values
out = np.empty(6)
advance(np.array([0.0, 0.0, 100.0, 0.0, 0.0, 25.0]), 0.0, 0.0, 0.0, 1.0, out)
assert out[0] == 25.0
assert not hasattr(advance, "signatures")
"""


def test_without_the_compiler_kernels_are_plain_functions(monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    subprocess.run([sys.executable, "-c", PLAIN], check=True, timeout=120)
