"""Tables of whole flights: which methods arrive without a collision, and which are never threatened."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from companion.research.evidence.document.reasons import Reasons
from companion.research.evidence.document.sources import provenance_of
from companion.research.evidence.evidence_tables import (
    NONE,
    RATES,
    Cell,
    ResultTable,
    interval_text,
    markdown,
)
from companion.research.evidence.intervals import bootstrap, paired_shares, wilson
from companion.research.evidence.samples import GROUPS, Case, Evidence, Sample

SHOWN = (
    "seconds_in_reach_and_sight", "miss_distance_m", "min_obstacle_clearance_m", "flight_s", "plan_ms.median"
)  # fmt: skip
_MEASURES = {measure.name: measure for group in GROUPS["flights"] for measure in group.measures}


def flown_parts(evidence: Evidence, reasons: Reasons) -> Iterator[str]:
    """The page's parts about a campaign of flights."""
    yield f"## Whole flights: {evidence.name}"
    yield provenance_of(evidence)
    if "flights" in reasons.notes and evidence.name == "flights":
        yield reasons.notes["flights"].strip()
    for case in evidence.cases:
        if any(sample.rows for sample in case.samples.values()):
            yield markdown(flown_table(case)).rstrip()
            yield " ".join(best_text(case, *rate) for rate in RATES["flights"])


def flown_table(case: Case) -> ResultTable:
    """One line for each method: rates, their paired differences from the first method, and means."""
    first = next(iter(case.samples))
    rows = []
    for method, sample in case.samples.items():
        if not sample.rows:
            continue
        cells = [Cell(method, method), Cell(str(len(sample.rows)), float(len(sample.rows)))]
        for name, _ in RATES["flights"]:
            share = wilson(int(sample.share(name).sum()), len(sample.rows))
            cells += [Cell(interval_text(share), share.value), _less(sample, case.samples[first], name)]
        for name in SHOWN:
            values = np.array(list(sample.values(_MEASURES[name]).values()))
            mean = bootstrap(values) if len(values) else None
            cells.append(Cell(NONE, math.nan) if mean is None else Cell(interval_text(mean), mean.value))
        rows.append(tuple(cells))
    rates = [
        head
        for name, words in RATES["flights"]
        for head in ((name, words), (f"less {first}", "on the same seeds" if name == "success" else ""))
    ]
    means = ((name, _MEASURES[name].words) for name in SHOWN)
    return ResultTable(case.title, (("method", ""), ("n", "flights"), *rates, *means), tuple(rows))


def best_text(case: Case, name: str, words: str) -> str:
    """Return whether any method does better than the first on the same seeds, in a sentence."""
    (first, ours), *others = ((method, sample) for method, sample in case.samples.items() if sample.rows)
    differences = {method: _difference(sample, ours, name) for method, sample in others}
    better = [method for method, (value, _, _) in differences.items() if value > 0.0]
    surely = [method for method in better if differences[method][1] > 0.0]
    if not better:
        return f"By {name} ({words}) no method does better than {first}."
    known = f"surely so {', '.join(surely)}" if surely else "by none is that sure at this n"
    return f"By {name} ({words}) more than {first}: {', '.join(better)}; {known}."


def _less(sample: Sample, first: Sample, name: str) -> Cell:
    if sample is first:
        return Cell(NONE, math.nan)
    value, low, high = _difference(sample, first, name)
    return Cell(f"{value:+.2f} [{low:+.2f}, {high:+.2f}]", value)


def _difference(sample: Sample, first: Sample, name: str) -> tuple[float, float, float]:
    """Paired difference of a rate on the seeds that both have, with its interval."""
    seeds = sorted(sample.rows.keys() & first.rows.keys())
    if not seeds:
        return math.nan, -1.0, 1.0
    one, other = (
        np.array([float(of.rows[seed].measures.get(name) is True) for seed in seeds])
        for of in (sample, first)
    )
    return tuple(paired_shares(one, other))  # type: ignore[return-value]
