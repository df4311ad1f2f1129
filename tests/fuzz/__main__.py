"""Fuzzes everything and measures what was found: ``python -m tests.fuzz --seconds 3600``; prints a table.

Exit code 1: something escaped, or an input cost more time or memory than any may. 3: Atheris is not there,
so that nothing was fuzzed; the stored inputs were still measured.
"""

import argparse
import concurrent.futures
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from tests.fuzz.keeping import keep
from tests.fuzz.targets import CORPUS, all_targets

ROOT = Path(__file__).parents[2]
FOUND = ROOT / ".fuzz"
COST_MAX_US = 2.0
MEMORY_MAX_MB = 100.0
SHORTEST_S = 2.0
FINAL = re.compile(r"^stat::(\w+): +(\d+)|cov: (\d+) ft: (\d+)", flags=re.M)
COLUMNS = ("target", "runs", "runs/s", "edges", "lines", "inputs", "µs/byte", "MB", "escapes")
NOT_THERE = 3


def fuzzed(name, folder, seconds):
    """Fuzz a target for so long, again where an input ended the process; how often it ran, and its edges."""
    until_s, runs, edges, took_s = time.monotonic() + seconds, 0, 0, 0.0
    while (left_s := until_s - time.monotonic()) > SHORTEST_S or not took_s:
        began_s = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "tests.fuzz.one_target", name, folder, str(max(1, round(left_s)))],
            cwd=ROOT, capture_output=True, text=True, errors="replace", check=False,
        )  # fmt: skip
        took_s += time.monotonic() - began_s
        (folder / "log").write_text(done.stderr, encoding="utf-8")
        told = FINAL.findall(done.stderr)
        if not told:
            raise RuntimeError(f"{name}: the fuzzer did not start\n{done.stderr[-2000:]}")
        runs += next((int(number) for key, number, *_ in told if key == "number_of_executed_units"), 0)
        edges = max([edges, *(int(number) for *_, number, _ in told if number)])
    return runs, runs / took_s, edges


def measured(name, folder):
    """What the inputs of a target cost, told by a process that nothing watches."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.replayed", name, folder],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"{name}: not measured\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def escapes_of(folder):
    """What escaped, one line a kind."""
    told = [
        json.loads(path.read_text(encoding="utf-8"))["kind"] for path in sorted(folder.glob("escapes/*.json"))
    ]
    return told + [path.name for path in sorted(folder.glob("ended-*"))]


def one(name, folder, seconds, *, is_fuzzing, cost_max_us=COST_MAX_US):
    """Fuzz and measure one target: its row of the table, and what is wrong with it."""
    folder.mkdir(parents=True, exist_ok=True)
    for stale in ("escapes", "slow", "hungry"):
        shutil.rmtree(folder / stale, ignore_errors=True)
    for stale in folder.glob("ended-*"):
        stale.unlink()
    runs, rate, edges = fuzzed(name, folder, seconds) if is_fuzzing else (0, 0.0, 0)
    told, escapes = measured(name, folder), escapes_of(folder)
    row = (
        name, runs, f"{rate:.0f}", edges, f"{told['lines']}/{told['lines_total']}", told["inputs"],
        f"{told['worst_us']:.2f}", f"{told['peak_mb']:.1f}", len(escapes),
    )  # fmt: skip
    wrong = [f"{name}: escaped: {kind} ({folder / 'escapes'})" for kind in escapes]
    if told["worst_us"] > cost_max_us:
        wrong.append(
            f"{name}: {told['worst_us']:.2f} µs a byte, at most {cost_max_us:g} ({folder / 'slowest'})"
        )
    if told["peak_mb"] > MEMORY_MAX_MB:
        wrong.append(f"{name}: {told['peak_mb']:.0f} MB, at most {MEMORY_MAX_MB:g} ({folder / 'hungriest'})")
    return row, wrong


def table(rows):
    """Rows below their heads, each column as wide as it must be."""
    cells = [[str(cell) for cell in row] for row in (COLUMNS, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join(
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)),
            ]
        )
        for row in cells
    )


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", help="those of them; left out: all")
    parser.add_argument("--seconds", type=float, default=3600.0, help="for all together")
    parser.add_argument("--jobs", type=int, default=1, help="targets at once")
    parser.add_argument(
        "--found", type=Path, default=FOUND, help="folder for what is found; goes on from there"
    )
    parser.add_argument(
        "--keep", action="store_true", help="store new inputs that reach further in tests/fuzz/corpus"
    )
    parser.add_argument(
        "--cost-max",
        type=float,
        default=COST_MAX_US,
        help="of a byte [µs]; more on a slow or shared computer",
    )
    return parser.parse_args()


def main():
    asked = arguments()
    names = asked.targets or list(all_targets())
    is_fuzzing = importlib.util.find_spec("atheris") is not None
    seconds = asked.seconds * asked.jobs / len(names)
    with concurrent.futures.ThreadPoolExecutor(asked.jobs) as pool:
        done = list(
            pool.map(
                lambda name: one(
                    name, asked.found / name, seconds, is_fuzzing=is_fuzzing, cost_max_us=asked.cost_max
                ),
                names,
            )
        )
    sys.stdout.write(table([row for row, _ in done]) + "\n")
    wrong = [line for _, lines in done for line in lines]
    sys.stdout.write("".join(f"{line}\n" for line in wrong))
    if asked.keep:
        for name in names:
            kept = keep(all_targets()[name], asked.found / name / "corpus", CORPUS / name)
            sys.stdout.write(f"{name}: {kept} inputs kept\n")
    if not is_fuzzing:
        sys.stdout.write("NOT FUZZED: Atheris is not installed here; the stored inputs were measured alone\n")
        return NOT_THERE
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
