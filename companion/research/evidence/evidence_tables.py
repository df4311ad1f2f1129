"""A campaign's tables: success, measures and paired differences, each with its interval."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from companion.research.evidence.intervals import Interval, bootstrap, paired_shares, wilson
from companion.research.evidence.samples import FAILURE, GROUPS, Case, Evidence, Group, Sample, paired

RATES = {"plans": (("success", "reaches the goal"),), "flights": (
    ("success", "reaches the goal, touches nothing"), ("is_safe", "and is never threatened"),
), "encounters": (("success", "reaches the goal, touches nothing"),),
    "anytime": (("success", "reaches the goal in 10 s"),)}  # fmt: skip
NONE = "–"


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table: its text, its sorting value, and a remark."""

    text: str
    value: float | str
    more: str = ""


@dataclass(frozen=True, slots=True)
class ResultTable:
    """One table: columns with their meaning, and rows of as many cells."""

    title: str
    columns: tuple[tuple[str, str], ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def is_numeric(self, column: int) -> bool:
        """Return whether a column has numbers, which are aligned to the right."""
        return any(isinstance(row[column].value, float) for row in self.rows)


def number_text(value: float) -> str:
    """Return a number for tables: three digits, or a whole number."""
    if not math.isfinite(value):
        return NONE
    if 0.0 < abs(value) < 1e-3:
        return f"{value:.2e}"
    return f"{value:,.0f}" if abs(value) >= 999.5 else f"{value:.3g}"


def interval_text(interval: Interval) -> str:
    """Return an estimate, and its interval in brackets."""
    value, low, high = map(number_text, interval)
    return f"{value} [{low}, {high}]"


def tables_of(evidence: Evidence, case: Case) -> Iterator[ResultTable]:
    """The tables of one mission under one set of settings."""
    yield rates_table(evidence.kind, case)
    for group in GROUPS[evidence.kind]:
        if any(sample.values(measure) for measure in group.measures for sample in case.samples.values()):
            yield measures_table(case, group)
            if len(case.samples) > 1:
                yield differences_table(case, group)


def rates_table(kind: str, case: Case) -> ResultTable:
    """Runs, faults and successes."""
    rows = []
    for method, sample in case.samples.items():
        cells = [_name(method), _count(len(sample.rows)), _count(sample.num_errors)]
        for name, _ in RATES[kind]:
            reached, runs = int(sample.share(name).sum()), len(sample.rows)
            share = wilson(reached, runs)
            text = f"{reached} of {runs}: {interval_text(share)}" if runs else NONE
            cells.append(Cell(text, share.value))
        rows.append(tuple(cells))
    rates = tuple((name, f"{words}; with Wilson's interval") for name, words in RATES[kind])
    heads = ("method", ""), ("runs", ""), ("faults", "runs that ended in an error; no success"), *rates
    return ResultTable(f"{case.title}: success", heads, tuple(rows))


def measures_table(case: Case, group: Group) -> ResultTable:
    """Means of measures, one line for each method."""
    rows = []
    for method, sample in case.samples.items():
        cells = [_name(method)]
        for measure in group.measures:
            values = np.array(list(sample.values(measure).values()))
            cells.append(_estimate(values))
        rows.append(tuple(cells))
    heads = tuple((measure.name, measure.words) for measure in group.measures)
    return ResultTable(
        f"{case.title}: {group.title.lower()}", (("method", ""), *heads), tuple(rows), _note(group)
    )


def differences_table(case: Case, group: Group) -> ResultTable:
    """Paired differences from the first method, on the seeds that both have."""
    (first, against), *others = case.samples.items()
    rows = []
    for method, sample in others:
        cells = [_name(method)]
        for measure in group.measures:
            one, other = paired(sample.values(measure), against.values(measure))
            cells.append(_estimate(one - other, signed=True))
        rows.append(tuple(cells))
    heads = tuple((measure.name, measure.words) for measure in group.measures)
    title = f"{case.title}: {group.title.lower()}, less {first} on the same seeds"
    return ResultTable(title, (("method", ""), *heads), tuple(rows))


def markdown(table: ResultTable) -> str:
    """Return a table as Markdown."""
    lines = [
        " | ".join(head for head, _ in table.columns),
        " | ".join("---:" if table.is_numeric(n) else "---" for n in range(len(table.columns))),
        *(" | ".join(cell.text for cell in row) for row in table.rows),
    ]
    body = "\n".join(f"| {line} |" for line in lines)
    words = "; ".join(f"{name}: {words}" for name, words in table.columns if words)
    below = " ".join([f"{words}."] * bool(words) + [table.note] * bool(table.note))
    return f"### {table.title}\n\n{body}\n" + (f"\n{below}\n" if below else "")


def csv_text(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV; numbers in full."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return buffer.getvalue()


MEASURES_HEAD = (
    "mission", "setting", "method", "measure", "runs", "mean", "mean_low", "mean_high",
    "median", "median_low", "median_high",
)  # fmt: skip
DIFFERENCES_HEAD = ("mission", "setting", "method", "less", "measure", "pairs", "mean", "low", "high")


def measure_rows(evidence: Evidence) -> Iterator[list[object]]:
    """Every measure of every method, with the intervals of mean and median; Wilson's for shares."""
    for case, method, sample in _samples(evidence):
        place = [case.mission, case.setting, method]
        for name, _ in RATES[evidence.kind]:
            yield [*place, name, len(sample.rows), *wilson(int(sample.share(name).sum()), len(sample.rows))]
        for group in GROUPS[evidence.kind]:
            for measure in group.measures:
                values = np.array(list(sample.values(measure).values()))
                if len(values):
                    estimates = *bootstrap(values), *bootstrap(values, np.median)
                    yield [*place, measure.name, len(values), *estimates]


def difference_rows(evidence: Evidence) -> Iterator[list[object]]:
    """Every paired difference from the first method."""
    for case, method, sample in _samples(evidence):
        first = next(iter(case.samples))
        if method == first:
            continue
        for measure in (FAILURE, *(entry for group in GROUPS[evidence.kind] for entry in group.measures)):
            one, other = paired(sample.values(measure), case.samples[first].values(measure))
            if len(one):
                estimate = paired_shares(one, other) if measure == FAILURE else bootstrap(one - other)
                yield [case.mission, case.setting, method, first, measure.name, len(one), *estimate]


def _samples(evidence: Evidence) -> Iterator[tuple[Case, str, Sample]]:
    for case in evidence.cases:
        for method, sample in case.samples.items():
            yield case, method, sample


def _note(group: Group) -> str:
    return "Of runs that reach the goal." if all(measure.of_success for measure in group.measures) else ""


def _name(text: str) -> Cell:
    return Cell(text, text)


def _count(number: int) -> Cell:
    return Cell(str(number), float(number))


def _estimate(values: np.ndarray[tuple[int], np.dtype[np.float64]], *, signed: bool = False) -> Cell:
    """Mean with its interval, and the median; ``values`` has shape (N,)."""
    if len(values) == 0:
        return Cell(NONE, math.nan)
    mean, middle = bootstrap(values), bootstrap(values, np.median)
    sign = "+" if signed and mean.value > 0.0 else ""
    return Cell(sign + interval_text(mean), mean.value, f"median {interval_text(middle)}, n = {len(values)}")
