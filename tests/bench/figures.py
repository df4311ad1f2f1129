"""Figures of the benchmarks: measured in one or two checkouts, compared, kept.

A checkout is measured by running its own ``tests/bench`` in a process of its own; what its tests put into
the report with ``record_property`` are the figures.
"""

import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from tests.bench.yardstick import yardstick_s

BASELINE = Path(__file__).with_name("baseline.json")
TIMES = {"ns", "µs", "ms", "s"}  # grow with a slower computer
RATES = {"times real time"}  # fall with it
TIMEOUT_S = 3600.0


def plain(name):
    """A figure's name without its unit: older checkouts do not tell it."""
    return re.sub(r" \[[^\]]*\]$", "", name)


def unit_of(name):
    found = re.search(r" \[([^\]]*)\]$", name)
    return found.group(1) if found else ""


def figures_in(report):
    """Name and value of every figure of a JUnit report."""
    found = {}
    for entry in ElementTree.parse(report).iter("property"):
        try:
            found[entry.get("name")] = float(entry.get("value"))
        except ValueError:
            continue
    return found


def measured(checkout):
    """The figures of one run of a checkout's benchmarks."""
    checkout = Path(checkout).resolve()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-m", "bench", "tests/bench"]
        command += [f"--junitxml={report}", "-o", "junit_family=xunit1"]  # the one that takes properties
        # A figure over its loose limit fails its test, and is reported all the same.
        subprocess.run(
            command, cwd=checkout, env=os.environ | {"PYTHONPATH": str(checkout)}, timeout=TIMEOUT_S,
            stdout=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        return figures_in(report)


def medians(rounds):
    """The median of every figure over rounds of it."""
    names = dict.fromkeys(name for figures in rounds for name in figures)
    return {name: statistics.median(f[name] for f in rounds if name in f) for name in names}


def side_by_side(here, beside, rounds):
    """Medians of two checkouts, measured in turn, so that a busy minute falls on both."""
    ours, theirs = [], []
    for number in range(rounds):
        pair = [(here, ours), (beside, theirs)]
        for checkout, into in pair if number % 2 == 0 else reversed(pair):
            into.append(measured(checkout))
    return medians(ours), medians(theirs)


def scaled(name, value, speed):
    """What a stored figure would be on a computer whose yardstick takes ``speed`` times as long."""
    unit = unit_of(name)
    if unit in TIMES:
        return value * speed
    return value / speed if unit in RATES else value


def table(ours, others, heads):
    """Lines of a table: every figure of both, and their ratio."""
    known = {plain(name): value for name, value in others.items()}
    width = max((len(name) for name in ours), default=0)
    yield f"{'figure':{width}}  {heads[0]:>10}  {heads[1]:>10}  {'ratio':>6}"
    for name, value in ours.items():
        other = known.get(plain(name))
        if other is None:
            yield f"{name:{width}}  {value:10.4g}  {'-':>10}  {'-':>6}"
        else:
            ratio = f"{value / other:6.3f}" if other else f"{'-':>6}"
            yield f"{name:{width}}  {value:10.4g}  {other:10.4g}  {ratio}"


def saved(figures):
    """Keep figures as the baseline, with this computer's yardstick."""
    text = json.dumps({"yardstick_s": yardstick_s(), "values": figures}, indent=2, ensure_ascii=False)
    BASELINE.write_text(text + "\n", encoding="utf-8")


def baseline():
    """The stored figures as they would be on this computer, and how much slower it is; None without any."""
    if not BASELINE.exists():
        return None
    stored = json.loads(BASELINE.read_text(encoding="utf-8"))
    speed = yardstick_s() / stored["yardstick_s"]
    return {name: scaled(name, value, speed) for name, value in stored["values"].items()}, speed
