"""Verdicts: whether the paper's orderings hold for our runs, or how many runs would decide."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from companion.research.evidence.evidence_tables import NONE, Cell, ResultTable, interval_text
from companion.research.evidence.intervals import Interval, bootstrap, paired_shares, runs_to_decide
from companion.research.evidence.orderings import OURS, OURS_PRINTED, TABLES, Ordering, orderings
from companion.research.evidence.samples import FAILURE, GROUPS, Case, Evidence, Measure, paired

RUNS_MIN = 10  # With fewer runs, percentile intervals are far too narrow.
RUNS_MAX = 1_000_000
PAPER = "paper-"  # Names of the paper's missions begin with this.
_MEASURES = {
    measure.name: measure for measure in (FAILURE, *(one for of in GROUPS["plans"] for one in of.measures))
}


class Verdict(Enum):
    """A verdict on one of the paper's orderings."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class Judged:
    """An ordering of the paper, and the verdict on it.

    Parameters
    ----------
    case : Case
        The mission and setting.
    ordering : Ordering
        The printed ordering, with the methods that stand for the paper's.
    verdict : Verdict
        The verdict of our runs.
    difference : Interval or None
        Paired mean of the smaller one less the other; below zero agrees with the print.
    num_pairs : int
        Number of pairs of runs.
    remark : str
        Number of runs that would decide, or why none would.
    """

    case: Case
    ordering: Ordering
    verdict: Verdict
    difference: Interval | None
    num_pairs: int
    remark: str


def judged(evidence: Evidence) -> Iterator[Judged]:
    """Every ordering on the paper's maps, with each of our methods that stands for the paper's."""
    if evidence.kind != "plans":
        return
    for case in evidence.cases:
        if not case.mission.startswith(PAPER):
            continue
        for ordering in orderings():
            if ordering.dimension == case.dimension:
                for standing in _standing_for(ordering, case):
                    yield judge(case, standing)


def judge(case: Case, ordering: Ordering) -> Judged:
    """Judge an ordering by the runs of one mission under one setting."""
    absent = [name for name in (ordering.less, ordering.more) if not _has_rows(case, name)]
    if absent:
        return Judged(case, ordering, Verdict.NOT_MEASURED, None, 0, f"no runs of {' and '.join(absent)}")
    measure = _MEASURES[ordering.measure]
    less, more = (case.samples[name].values(measure) for name in (ordering.less, ordering.more))
    one, other = paired(less, more)
    if len(one) == 0:
        remark = f"no seed with {ordering.measure} of both"
        return Judged(case, ordering, Verdict.NOT_MEASURED, None, 0, remark)
    difference = paired_shares(one, other) if measure == FAILURE else bootstrap(one - other)
    if len(one) >= RUNS_MIN and difference.excludes_zero:
        verdict = Verdict.REPRODUCED if difference.high < 0.0 else Verdict.NOT_REPRODUCED
        return Judged(case, ordering, verdict, difference, len(one), "")
    seeds = case.samples[ordering.less].rows.keys() & case.samples[ordering.more].rows.keys()
    remark = _remark(one - other, measure, len(seeds) / len(one))
    return Judged(case, ordering, Verdict.UNDECIDED, difference, len(one), remark)


def verdicts_table(of_case: list[Judged], title: str) -> ResultTable:
    """Return a table with one line for each ordering."""
    heads = (
        ("table", "of the paper"),
        ("measure", ""),
        ("printed as less", "the method with the smaller value in the paper"),
        ("than", ""),
        ("paper", "its two values"),
        ("difference", "ours, paired: below zero as printed"),
        ("pairs", "seeds on which both have a value"),
        ("verdict", ""),
        ("remark", "runs: this many show a difference of this size in 80 of 100 campaigns"),
    )
    rows = []
    for entry in of_case:
        less, more, size = entry.ordering.less, entry.ordering.more, entry.difference
        values = f"{entry.ordering.printed_less:g} < {entry.ordering.printed_more:g}"
        rows.append(
            (
                Cell(str(entry.ordering.table), float(entry.ordering.table)),
                *(Cell(text, text) for text in (entry.ordering.measure, less, more, values)),
                Cell(NONE if size is None else interval_text(size), math.nan if size is None else size.value),
                Cell(str(entry.num_pairs), float(entry.num_pairs)),
                *(Cell(text, text) for text in (entry.verdict.value, entry.remark)),
            )
        )
    return ResultTable(title, heads, tuple(rows))


def counts_table(every: list[Judged]) -> ResultTable:
    """Return how many orderings of the paper's tables hold, by the method that represents the paper's."""
    keys = [(entry.case.title, entry.ordering.table, _ours(entry.ordering)) for entry in every]
    counted = Counter((*key, entry.verdict) for key, entry in zip(keys, every, strict=True))
    subjects = {table.number: table.subject for table in TABLES}
    columns = ("mission, settings", ""), ("table", "of the paper"), ("which compares", ""), ("ours", "")
    heads = *columns, *((one.value, "") for one in Verdict)
    rows = tuple(
        (
            Cell(title, title),
            Cell(str(table), float(table)),
            Cell(subjects[table], subjects[table]),
            Cell(ours, ours),
            *(
                Cell(str(counted[title, table, ours, one]), float(counted[title, table, ours, one]))
                for one in Verdict
            ),
        )
        for title, table, ours in dict.fromkeys(keys)
    )
    return ResultTable("The paper's orderings, counted", heads, rows)


def _standing_for(ordering: Ordering, case: Case) -> Iterator[Ordering]:
    """The ordering itself, and with methods of ours that are nearer to the paper's in its place."""
    yield ordering
    for name in OURS_PRINTED:
        if name in case.samples and ordering.less == OURS:
            yield ordering._replace(less=name)
        elif name in case.samples and ordering.more == OURS:
            yield ordering._replace(more=name)


def _ours(ordering: Ordering) -> str:
    """Return the method of ours that represents the paper's in an ordering."""
    return next((name for name in (OURS, *OURS_PRINTED) if name in ordering), "comparators alone")


def _has_rows(case: Case, method: str) -> bool:
    return method in case.samples and bool(case.samples[method].rows)


def _remark(
    differences: np.ndarray[tuple[int], np.dtype[np.float64]], measure: Measure, runs_a_pair: float
) -> str:
    """Number of runs that would decide; ``differences``, shape (N,), are the paired differences so far."""
    if not differences.any():
        return "no difference in any pair"
    needed = None if len(differences) < 2 else runs_to_decide(differences)
    if needed is None:
        fewest = math.ceil(runs_a_pair * RUNS_MIN)
        return "the mean difference is zero" if len(differences) > 1 else f"{fewest} runs at least"
    needed = math.ceil(runs_a_pair * max(needed, RUNS_MIN, len(differences) + 1))
    if needed > RUNS_MAX:
        return f"more than {RUNS_MAX:,} runs would decide"
    # Of shares that many pairs may still be too few for an interval that counts half a pair more a cell.
    least = "about " if measure == FAILURE else ""
    return f"{least}{needed:,} runs would decide"
