"""What is compiled is kept, found again by what it comes from, and never flown when that has changed."""

import importlib.util
import itertools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from companion.kernels.native import compiler
from companion.kernels.native.store import DAY_S, TOTAL_BYTES_MAX, UNUSED_DAYS_MAX, Store, kernel_store

ROOT = Path(__file__).parents[3]
KERNELS = '''
from __future__ import annotations

from companion.kernels.arrays import Float1D
from companion.kernels.native.kernel import inlined, kernel, kernel_numpy_errors
from companion.kernels.native.struct import Struct

FACTOR = 2.0


class Data(Struct):
    values: Float1D
    offset: float


@inlined
def scaled(x: float) -> float:
    """Times the factor."""
    return FACTOR * x


@kernel
def called(x: float) -> float:
    return scaled(x) + 1.0


@kernel
def caller(data: Data, i: int) -> float:
    return called(data.values[i]) + data.offset


@kernel
def apart(x: float) -> float:
    return 5.0 * x
'''


MOMENTS = itertools.count(1_000_000_000)


def module_of(folder, text):
    """The kernels of a text, as a module of the same name each time."""
    folder.mkdir(exist_ok=True)
    file = folder / "made_kernels.py"
    file.write_text(text, encoding="utf-8")
    # Python takes a module that was changed within a second, to the same size, for the old one.
    os.utime(file, (next(MOMENTS),) * 2)
    spec = importlib.util.spec_from_file_location("made_kernels", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules["made_kernels"] = module  # annotations are evaluated there
    spec.loader.exec_module(module)
    return module


NAMES = ("scaled", "called", "caller", "apart")


def keys(folder, text):
    module = module_of(folder, text)
    return {name: getattr(module, name).key for name in NAMES}


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("Times the factor.", "Whatever.", ""),
        ("\n\n\n@kernel\ndef apart", "\n\n# a line more\n\n\n@kernel\ndef apart", ""),
        ("FACTOR = 2.0", "FACTOR = 3.0", "scaled called"),  # scaled is copied into called, called is not
        ("return FACTOR * x", "return FACTOR / x", "scaled called"),
        ("scaled(x) + 1.0", "scaled(x) + 2.0", "called"),
        ("def called(x: float)", "def called(x: int)", "called caller"),
        ("5.0 * x", "6.0 * x", "apart"),
        ("values: Float1D\n    offset: float", "offset: float\n    values: Float1D", "caller"),
        ("@kernel\ndef apart", "@inlined\ndef apart", "apart"),
        ("@kernel\ndef called", "@inlined\ndef called", "called caller"),
        ("@kernel\ndef called", "@kernel_numpy_errors\ndef called", "called caller"),
    ],
)
def test_a_change_is_one_of_that_kernel_and_of_what_it_is_copied_into(tmp_path, old, new, changed):
    before = keys(tmp_path / "before", KERNELS)
    assert keys(tmp_path / "again", KERNELS) == before
    assert KERNELS.count(old) == 1
    after = keys(tmp_path / "after", KERNELS.replace(old, new))
    assert {name for name in NAMES if before[name] != after[name]} == set(changed.split())


def test_the_processor_the_libraries_and_the_generator_are_in_every_key(tmp_path):
    script = "from made_kernels import apart\nprint(apart.key)"
    module_of(tmp_path / "module", KERNELS)
    keys_of = {
        name: run(script, tmp_path, **settings).strip()
        for name, settings in {
            "plain": {}, "again": {}, "generic": {"NUMBA_CPU_NAME": "generic"}, "slow": {"NUMBA_OPT": "0"},
            "features": {"NUMBA_CPU_FEATURES": "+sse2"},
        }.items()
    }  # fmt: skip
    assert keys_of["plain"] == keys_of["again"]
    assert len(set(keys_of.values())) == 4


def run(script, folder, **settings):
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(folder / "cache"),
        "PYTHONPATH": os.pathsep.join([str(folder / "module"), str(ROOT)]), **settings,
    }  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


CALL = """
import sys
import numpy as np
from made_kernels import Data, caller
print(caller(Data(np.array([1.0, 4.0]), 0.5), 1))
"""
WITHOUT_COMPILING = "from companion.kernels.native.kernel import refuse_compiling\nrefuse_compiling()\n"
NO_NUMBA = "assert 'numba' not in sys.modules\n"


def kept(folder, kind="o"):
    return {path.name for path in (folder / "cache" / "kernels").glob(f"*.{kind}")}


@pytest.fixture(scope="module")
def first_build(tmp_path_factory):
    """A folder with the module, and what calling its kernels once has compiled."""
    folder = tmp_path_factory.mktemp("first")
    module_of(folder / "module", KERNELS)
    assert run(CALL, folder) == "9.5\n"
    return folder


@pytest.fixture
def built(first_build, tmp_path):
    """A copy of the first build."""
    return shutil.copytree(first_build, tmp_path / "built")


@pytest.mark.thorough
def test_no_stale_kernel_runs_and_no_other_is_compiled_again(built):
    first = kept(built)
    assert {name.partition("-")[0] for name in first} == {"caller", "called"}
    for old, new, result in [
        ("FACTOR = 2.0", "FACTOR = 3.0", "13.5\n"),
        ("scaled(x) + 1.0", "scaled(x) + 2.0", "10.5\n"),
    ]:
        module_of(built / "module", KERNELS.replace(old, new))
        assert run(CALL, built) == result
        (new_one,) = kept(built) - first
        assert new_one.startswith("called-")
        first = kept(built)
    module_of(built / "module", KERNELS)
    assert run(WITHOUT_COMPILING + CALL + NO_NUMBA, built) == "9.5\n"


def test_another_place_compiles_nothing_and_needs_no_numba(built):
    (built / "module").rename(built / "other")
    (built / "module").mkdir()
    module_of(built / "module", "# moved\n" + KERNELS)
    assert run(WITHOUT_COMPILING + CALL + NO_NUMBA, built) == "9.5\n"


def test_what_would_have_to_be_compiled_is_named_where_that_is_refused(tmp_path):
    module_of(tmp_path / "module", KERNELS)
    script = f"{WITHOUT_COMPILING}try:\n    exec({CALL!r})\nexcept RuntimeError as error:\n    print(error)"
    assert run(script, tmp_path) in {
        f"made_kernels.{name} would have to be compiled now\n" for name in ("caller", "called")
    }


@pytest.mark.thorough
def test_several_processes_may_fill_it_at_once(tmp_path):
    module_of(tmp_path / "module", KERNELS)
    environment = {
        **os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": os.pathsep.join([str(tmp_path / "module"), str(ROOT)]),
    }  # fmt: skip
    running = [
        subprocess.Popen([sys.executable, "-c", CALL], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    assert [process.communicate(timeout=300)[0] for process in running] == ["9.5\n"] * 2
    assert len(kept(tmp_path)) == 2
    assert [path.name for path in (tmp_path / "cache" / "kernels").glob(".*")] == []


@pytest.mark.parametrize("damage", [lambda raw: raw[:-100], lambda raw: b"", lambda raw: raw[:-1] + b"\0"])
@pytest.mark.thorough
def test_a_damaged_file_is_compiled_again(built, damage):
    files = {path: path.read_bytes() for path in (built / "cache" / "kernels").glob("*.o")}
    for path, raw in files.items():
        path.write_bytes(damage(raw))
    assert run(CALL, built) == "9.5\n"
    assert all(len(path.read_bytes()) == len(raw) for path, raw in files.items())


def test_a_folder_that_cannot_be_written_to_is_no_failure(tmp_path):
    store = Store(tmp_path / "none")
    store.write("a.o", b"code")
    assert store.read("a.o") is None


def test_what_came_with_the_program_is_read_where_nothing_else_is_and_never_changed(tmp_path):
    folder, packed = tmp_path / "cache", tmp_path / "packed"
    for place in (folder, packed):
        place.mkdir()
    Store(packed).write("a.o", b"packed")
    store = Store(folder, packed)
    assert (store.read("a.o"), store.read("b.o")) == (b"packed", None)
    store.write("a.o", b"own")
    assert store.read("a.o") == b"own"
    (folder / "a.o").write_bytes(b"damaged")
    assert store.read("a.o") == b"packed"
    assert store.prune(4e9) == 1
    assert [path.name for path in packed.iterdir()] == ["a.o"]


def test_what_nobody_reads_goes_and_the_oldest_beyond_what_it_may_take(tmp_path):
    store, now_s = Store(tmp_path), 1e9
    for name, days in (("new", 1.0), ("read", UNUSED_DAYS_MAX - 1.0), ("old", UNUSED_DAYS_MAX + 1.0)):
        store.write(name, b"code")
        os.utime(tmp_path / name, (now_s - days * DAY_S,) * 2)
    for name, days in (("large", 2.0), ("larger", 3.0)):
        with (tmp_path / name).open("wb") as file:
            file.truncate(int(0.6 * TOTAL_BYTES_MAX))
        os.utime(tmp_path / name, (now_s - days * DAY_S,) * 2)
    assert store.prune(now_s) == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ["large", "new"]


def test_what_cannot_be_touched_is_read_all_the_same(tmp_path, monkeypatch):
    """A folder of an image may be read-only."""
    store = Store(tmp_path)
    store.write("code", b"code")
    os.utime(tmp_path / "code", (1e9, 1e9))
    monkeypatch.setattr(Path, "touch", lambda path: (_ for _ in ()).throw(PermissionError(path)))
    assert store.read("code") == b"code"


def test_the_first_folder_that_can_be_written_to_is_taken_then_one_that_exists(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "set"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    of = kernel_store.__wrapped__
    users = tmp_path / "home" / "safe-rrt-companion" / "kernels"
    assert of().folder == tmp_path / "set" / "kernels"
    monkeypatch.setattr(os, "access", lambda folder, _: folder == users)
    assert of().folder == users
    monkeypatch.setattr(os, "access", lambda folder, _: False)
    assert of().folder == tmp_path / "set" / "kernels"
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert of().folder.name.startswith("safe-rrt-companion-")


def test_what_is_read_is_in_use(tmp_path):
    store = Store(tmp_path)
    store.write("code", b"code")
    os.utime(tmp_path / "code", (1e9, 1e9))
    assert store.read("code") == b"code"
    assert store.prune((tmp_path / "code").stat().st_mtime + DAY_S) == 0


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("return np.zeros(int(x))[0]", "cannot be compiled"),
        ("return x + HERE[0]", "HERE is a list: a kernel refers to kernels and constants"),
        ("return plain(x)", "plain is a function: a kernel refers to kernels and constants"),
        ("return called(x, x)", "cannot be compiled"),
    ],
)
def test_what_a_kernel_cannot_do_is_said_by_name(tmp_path, code, said):
    text = KERNELS.replace("return 5.0 * x", code)
    text += "\nimport numpy as np\n\nHERE = [1.0]\n\ndef plain(x):\n    return x\n"
    made = module_of(tmp_path / "made", text)
    with pytest.raises((TypeError, RuntimeError), match=f"made_kernels.apart.*{said}"):
        _ = made.apart.key, compiler.compiled(made.apart)


def test_a_variable_of_a_function_round_it_is_refused(tmp_path):
    text = (
        KERNELS
        + "\n\ndef outer(n):\n"
        + "    @kernel\n    def inner(x: float) -> float:\n        return n * x\n    return inner\n"
    )
    with pytest.raises(TypeError, match="no variables of an enclosing function"):
        _ = module_of(tmp_path / "made", text).outer(2.0).key
