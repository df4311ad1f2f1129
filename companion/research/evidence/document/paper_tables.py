"""The paper's tables, with our values next to the printed ones, and a verdict on every ordering."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from companion.research.evidence.document.reasons import Reasons
from companion.research.evidence.evidence_tables import NONE, Cell, ResultTable, interval_text, number_text
from companion.research.evidence.intervals import bootstrap, wilson
from companion.research.evidence.orderings import OURS, OURS_PRINTED, TABLES, Ordering, PaperTable
from companion.research.evidence.samples import FAILURE, GROUPS, Case, Evidence, Measure, Sample
from companion.research.evidence.verdicts import PAPER, Judged, Verdict

_MEASURES = {
    measure.name: measure for measure in (FAILURE, *(one for of in GROUPS["plans"] for one in of.measures))
}
Key = tuple[str, Ordering]  # A map, and an ordering with the paper's own methods.


def value_tables(evidence: Evidence) -> Iterator[tuple[int, ResultTable]]:
    """The paper's tables by their numbers, one for each map, with our means next to its values."""
    for table in TABLES:
        for dimension, printed in table.printed.items():
            cases = [
                case
                for case in evidence.cases
                if case.dimension == dimension and case.mission.startswith(PAPER)
            ]
            if cases:
                yield table.number, _values(table, printed, cases)


def _values(table: PaperTable, printed: dict[str, tuple[float, ...]], cases: Sequence[Case]) -> ResultTable:
    rows = []
    for method, values in printed.items():
        paper = (Cell(number_text(value), value) for value in values)
        rows.append((Cell(method, method), Cell("the paper", "the paper"), Cell("", math.nan), *paper))
        for case in cases:
            sample = case.samples.get(method)
            if sample is not None and sample.rows:
                ours = (_estimate(sample, _MEASURES[name]) for name in table.measures)
                number = Cell(str(len(sample.rows)), float(len(sample.rows)))
                rows.append((Cell(method, method), Cell(case.setting, case.setting), number, *ours))
    heads = ("method", ""), ("settings", ""), ("n", "runs"), *((name, "") for name in table.measures)
    return ResultTable(
        f"Table {table.number}: {table.subject.lower()}, {cases[0].mission}", heads, tuple(rows)
    )


def _estimate(sample: Sample, measure: Measure) -> Cell:
    """Mean with its interval; of failures the share with Wilson's."""
    values = np.array(list(sample.values(measure).values()))
    if len(values) == 0:
        return Cell(NONE, math.nan)
    known = wilson(int(values.sum()), len(values)) if measure == FAILURE else bootstrap(values)
    return Cell(interval_text(known), known.value)


def ordering_tables(every: Sequence[Judged], reasons: Reasons) -> Iterator[tuple[int, ResultTable]]:
    """For each of the paper's tables: each ordering, and its verdict under each setting."""
    settings = tuple(dict.fromkeys(entry.case.setting for entry in every))
    methods = {_ours(entry.ordering) for entry in every}
    nearer = tuple(name for name in OURS_PRINTED if name in methods)
    by_key: dict[Key, dict[tuple[str, str], Judged]] = {}
    for entry in every:
        by_key.setdefault(_key(entry), {})[_ours(entry.ordering), entry.case.setting] = entry
    heads = _ordering_heads(settings, nearer)
    for table in TABLES:
        keys = [key for key in by_key if key[1].table == table.number]
        found = (_found(by_key[key], key[1], settings, nearer) for key in keys)
        rows = tuple(map(_ordering_row, keys, found, itertools.repeat(reasons)))
        if rows:
            yield table.number, ResultTable(f"Orderings of Table {table.number}", heads, rows)


def _ordering_heads(settings: Sequence[str], nearer: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Names of the columns, and their meaning where it is not obvious."""
    return (
        *(("map", ""), ("measure", ""), ("printed as less", ""), ("than", ""), ("paper", "")),
        *((setting, "") for setting in settings),
        *((f"{name}, {settings[0]}", "in safe-rrt's place") for name in nearer),
        ("why not", ""),
    )


def _found(
    known: Mapping[tuple[str, str], Judged],
    ordering: Ordering,
    settings: Sequence[str],
    nearer: Sequence[str],
) -> list[Judged | None]:
    """Return the verdicts on an ordering: under each setting, and with other methods of ours in its place."""
    ours = OURS if OURS in ordering else ""
    wanted = [(ours, setting) for setting in settings] + [(name, settings[0]) for name in nearer]
    return [known.get(one) for one in wanted]


def _ordering_row(key: Key, found: Sequence[Judged | None], reasons: Reasons) -> tuple[Cell, ...]:
    """One ordering, its verdicts, and the numbers of the reasons where they contradict the paper."""
    mission, ordering = key
    values = f"{number_text(ordering.printed_less)} < {number_text(ordering.printed_more)}"
    against = (entry for entry in found if entry and entry.verdict is Verdict.NOT_REPRODUCED)
    why = dict.fromkeys(reasons.of(entry) for entry in against)
    described = ", ".join("not found" if number is None else str(number) for number in why)
    names = (mission, ordering.measure, ordering.less, ordering.more, values)
    return tuple(Cell(text, text) for text in (*names, *map(verdict_text, found), described))


def verdict_text(entry: Judged | None) -> str:
    """Return a verdict, its difference, and if it is open the number of runs that would decide it."""
    if entry is None or entry.difference is None:
        return NONE
    described = f"{entry.verdict.value} {interval_text(entry.difference)}"
    return f"{described}; {entry.remark}" if entry.remark else described


def counts_table(every: Sequence[Judged]) -> ResultTable:
    """Return the number of orderings that hold, by settings and by the method that represents the paper's."""
    counted = Counter(
        (entry.case.setting, _ours(entry.ordering) or "comparators alone", entry.verdict) for entry in every
    )
    keys = dict.fromkeys((setting, ours) for setting, ours, _ in counted)
    heads = ("settings", ""), ("in safe-rrt's place", ""), *((one.value, "") for one in Verdict)
    rows = tuple(
        (
            Cell(setting, setting),
            Cell(ours, ours),
            *(Cell(str(counted[setting, ours, one]), float(counted[setting, ours, one])) for one in Verdict),
        )
        for setting, ours in keys
    )
    return ResultTable("All orderings", heads, rows)


def _key(entry: Judged) -> Key:
    """Map and ordering, whichever method stands for the paper's."""
    less, more = (
        OURS if name in OURS_PRINTED else name for name in (entry.ordering.less, entry.ordering.more)
    )
    return entry.case.mission, entry.ordering._replace(less=less, more=more)


def _ours(ordering: Ordering) -> str:
    """Return the method of ours that stands for the paper's; empty between comparators."""
    return next((name for name in (OURS, *OURS_PRINTED) if name in (ordering.less, ordering.more)), "")
