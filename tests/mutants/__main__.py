"""Makes random mutants of the program and runs the tests that reach them; prints each one that survives.

``python -m tests.mutants --seed 1 --others 300 --kernels 60``. Exit code 1: fewer than 90 % were killed.

The suite runs once with coverage, so that the tests are known that reach each line. That is stored in
``.mutants`` and used as long as the program stays the same. ``--again`` tries only the mutants that survived
the last time. Everything runs in a copy of the project.
"""

import argparse
import importlib
import json
import os
import random
import resource
import shutil
import sys
import tempfile
import time
from pathlib import Path

from tests.mutants.changes import mutants_of
from tests.mutants.choice import KERNELS, ROOT, Choice, stored_for
from tests.mutants.running import Durations, Shortest, in_child

EQUIVALENT = Path(__file__).with_name("equivalent.txt")
SURVIVORS = ROOT / ".mutants" / "survivors.txt"
KILLED_MIN = 0.9
MEMORY_MAX_BYTES = 8_000_000_000  # A mutant may ask for any amount.
PASSED, NOTHING_RUN = 0, 5  # Exit codes of pytest.
LIBRARIES = (
    "hypothesis",
    "numpy",
    "pydantic",
    "pytest",
    "scipy.spatial",
)  # Imported once; most tests need them.
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv*", "__pycache__", ".mutants", ".fuzz", ".*_cache", ".hypothesis"
)
COVERAGE = '[tool.coverage.run]\nsource_pkgs = ["companion"]\nrelative_files = true\n'


def prepare(folder):
    """Copy the project, and let what mutants start inherit folders of their own for all that they store."""
    shutil.copytree(ROOT, folder / "copy", ignore=LEFT_OUT)
    (folder / "copy" / ".venv").symlink_to(sys.prefix)
    kernels = Path(os.environ.get("NUMBA_CACHE_DIR") or Path("~/.cache/safe-rrt-companion").expanduser())
    if (kernels / "kernels").is_dir():
        shutil.copytree(kernels / "kernels", folder / "store" / "kernels")
    for name in ("home", "tmp"):
        (folder / name).mkdir()
    os.environ |= {
        "NUMBA_CACHE_DIR": str(folder / "store"), "HOME": str(folder / "home"), "TMPDIR": str(folder / "tmp"),
        "PYTHONPATH": str(folder / "copy"), "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    os.environ.pop("XDG_CACHE_HOME", None)
    tempfile.tempdir = None  # It is read anew.
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MAX_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))
    for name in LIBRARIES:
        importlib.import_module(name)


def choice_of(texts, folder):
    """Which tests reach which line. Afterwards all that no mutant changes is compiled."""
    stored = stored_for(texts)
    if (stored / "durations.json").exists():
        in_child(folder, ["--collect-only"])
    else:
        sys.stdout.write("The suite runs once, to see which tests reach each line.\n")
        sys.stdout.flush()
        stored.mkdir(parents=True, exist_ok=True)
        (folder / "coverage.toml").write_text(COVERAGE, encoding="utf-8")
        os.environ["COVERAGE_FILE"] = str(stored / "coverage")
        settings = f"--cov-config={folder / 'coverage.toml'}"
        in_child(folder, ["--cov", settings, "--cov-context=test", "--cov-report="], Durations(stored))
        del os.environ["COVERAGE_FILE"]
    return Choice(stored, texts)


def survives(mutant, choice, folder):
    """Whether no test notices a mutant, or reaches it."""
    tests, files = choice.tests_of(mutant)
    paths = sorted({test.partition("::")[0] for test in tests} | files)
    if not paths:
        return True
    changed = folder / "copy" / mutant.path
    changed.write_text(mutant.text(), encoding="utf-8")
    try:
        code = in_child(folder, ["-x", *paths], Shortest(tests, files, choice.seconds))
    finally:
        shutil.copy2(ROOT / mutant.path, changed)  # with its time, so that its compiled form is used again
    return code in (PASSED, NOTHING_RUN)


def tried(part, sample, choice, folder):
    """Try mutants, and print those that survive and how many do not; return the survivors' names."""
    survivors = []
    with (ROOT / ".mutants" / "log.txt").open("a", encoding="utf-8") as log:
        for mutant in sample:
            began_s = time.monotonic()
            if survives(mutant, choice, folder):
                survivors.append(mutant.name)
                where, _, change = mutant.name.partition(": ")
                sys.stdout.write(f"{where}:{mutant.lines[0]}: {change}\n")
            told = "survived" if mutant.name in survivors[-1:] else "killed"
            log.write(f"{told} after {time.monotonic() - began_s:.0f} s: {mutant.name}\n")
            log.flush()
            sys.stdout.flush()
    sys.stdout.write(f"{part}: {len(sample) - len(survivors)} of {len(sample)} killed\n")
    return survivors


def main():
    """Sample, try, tell."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--others", type=int, default=300, help="mutants outside companion/kernels")
    parser.add_argument("--kernels", type=int, default=60, help="mutants in companion/kernels")
    parser.add_argument("--again", action="store_true", help="only those that survived the last time")
    asked, began_s = parser.parse_args(), time.monotonic()
    listed = EQUIVALENT.read_text(encoding="utf-8").splitlines()
    not_counted = {line.partition(" | ")[0] for line in listed if not line.startswith("#")}
    wanted = set(json.loads(SURVIVORS.read_text(encoding="utf-8"))) if asked.again else None
    sources = sorted((ROOT / "companion").rglob("*.py"))
    texts = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in sources}
    survivors, is_good = [], True
    with tempfile.TemporaryDirectory(prefix="mutants-") as temporary:
        folder = Path(temporary)
        prepare(folder)
        choice = choice_of(texts, folder)
        for part, is_kernels, num in (
            ("outside the kernels", False, asked.others),
            ("kernels", True, asked.kernels),
        ):
            files = [path for path in texts if path.startswith(KERNELS) == is_kernels]
            mutants = [mutant for path in files for mutant in mutants_of(path, texts[path])]
            if wanted is None:
                sample = random.Random(asked.seed).sample(mutants, num)
            else:
                sample = [mutant for mutant in mutants if mutant.name in wanted]
            sample = [mutant for mutant in sample if mutant.name not in not_counted]
            found = tried(part, sample, choice, folder)
            survivors += found
            is_good &= len(found) <= (1.0 - KILLED_MIN) * len(sample)
            SURVIVORS.write_text(json.dumps(survivors, indent=0), encoding="utf-8")
    sys.stdout.write(f"seed {asked.seed}, {(time.monotonic() - began_s) / 60.0:.0f} min\n")
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
