"""Tables of encounters with passing aircraft: risk ratios, needless detours, and where well clear is lost.

A risk ratio is the number of events with the service over that without it, on the same encounters.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from companion.frames import FloatArray
from companion.research.evidence.evidence_tables import NONE, Cell, ResultTable, interval_text
from companion.research.evidence.intervals import risk_ratio, wilson
from companion.research.evidence.samples import Case, Evidence, Measure, Sample

HEADS = {
    "nmac": "NMAC", "lowc": "F3442", "lowc_en_route": "DO-365 en route",
    "lowc_non_cooperative": "DO-365, not reporting",
}  # fmt: skip
EVENTS = {
    "nmac": "near mid-air collision (500 ft, 100 ft)",
    "lowc": "loss of well clear, ASTM F3442 (2000 ft, 250 ft)",
    "lowc_en_route": "loss of well clear, RTCA DO-365 en route",
    "lowc_non_cooperative": "loss of well clear, RTCA DO-365 of what does not report itself",
}
LOSS = "lowc"
LATE_S = 25.0  # DAIDALUS' DO_365B_no_SUM.conf: alerting time of its warning.
DETOUR_S = 3.0  # A flight that arrives later or earlier by more than this made a detour.
DETOURS = (
    f"arrive more than {DETOUR_S:.0f} s later or earlier, of those that alone stay well clear; with Wilson's "
    "interval"
)
BINS: tuple[tuple[str, str, tuple[float, ...]], ...] = (
    ("closing_m_s", "closing speed [m/s]", (40.0, 60.0, 80.0)),
    ("aircraft_m_s", "the aircraft's speed [m/s]", (35.0, 50.0, 65.0)),
    ("aircraft_up_m", "the aircraft's height [m]", (200.0, 250.0, 300.0)),
)

Flags = NDArray[np.bool_]


def overview_table(evidence: Evidence) -> ResultTable | None:
    """One row for each case and method of a campaign of encounters; None of other kinds of campaign."""
    if evidence.kind != "encounters":
        return None
    rows = []
    for case in evidence.cases:
        for method, sample in case.samples.items():
            cells = [_ratio_cells(sample, event, None) for event in EVENTS]
            ratios = [
                Cell(f"{lost.text} / {would.text}: {ratio.text}", ratio.value)
                for _, lost, would, ratio in cells
            ]
            names = Cell(case.title, case.title), Cell(method, method)
            rows.append((*names, cells[0][0], *ratios, _detours_cell(sample)))
    heads = (
        ("encounters of", ""), ("method", ""), ("encounters", "those that were flown"),
        *((HEADS[event], f"{words}, with / without the service: ratio") for event, words in EVENTS.items()),
        ("detours", DETOURS),
    )  # fmt: skip
    return ResultTable("Risk ratios and detours", heads, tuple(rows))


def encounter_tables(kind: str, case: Case) -> Iterator[ResultTable]:
    """The tables of one mission under one set of settings; none of other kinds of campaign."""
    if kind != "encounters":
        return
    yield _events_table(case)
    yield _detours_table(case)
    for measure, words, edges in BINS:
        if all(np.isfinite(values_of(sample, measure)).all() for sample in case.samples.values()):
            yield _binned_table(case, measure, words, edges)
    yield _alerts_table(case)


def _events_table(case: Case) -> ResultTable:
    """Return the number of each event, with the service and without it."""
    rows = [
        (Cell(method, method), Cell(words, words), *_ratio_cells(sample, event, None))
        for method, sample in case.samples.items()
        for event, words in EVENTS.items()
    ]
    return ResultTable(f"{case.title}: risk ratios", (("method", ""), ("event", ""), *_HEADS), tuple(rows))


def _detours_table(case: Case) -> ResultTable:
    """Return the detours of flights that alone would have stayed well clear."""
    rows = []
    for method, sample in case.samples.items():
        idle = ~happened(sample, f"without.{LOSS}")
        num, induced = int(idle.sum()), int(happened(sample, LOSS)[idle].sum())
        rows.append((
            Cell(method, method), Cell(str(num), float(num)), _detours_cell(sample),
            Cell(str(induced), float(induced)),
        ))  # fmt: skip
    heads = (
        ("method", ""),
        ("encounters", "those in which the flight alone stays well clear by ASTM F3442"),
        ("detours", DETOURS),
        ("induced", "lose well clear with the service only"),
    )
    return ResultTable(f"{case.title}: where nothing would have happened", heads, tuple(rows))


def _detours_cell(sample: Sample) -> Cell:
    """Return the number and the share of detours among flights that alone stay well clear."""
    late = np.abs(values_of(sample, "detour_s")[~happened(sample, f"without.{LOSS}")]) > DETOUR_S
    share = wilson(int(late.sum()), len(late))
    return Cell(f"{int(late.sum())} of {len(late)}: {interval_text(share)}", share.value)


def _alerts_table(case: Case) -> ResultTable:
    """Return the times of warning before the flight alone loses well clear, and the needless warnings."""
    rows = []
    for method, sample in case.samples.items():
        would = happened(sample, f"without.{LOSS}")
        before = values_of(sample, "alert_before_s")[would]
        alert_s = before[np.isfinite(before)]
        needless = int((values_of(sample, "alerts")[~would] > 0).sum())
        median = float(np.median(alert_s)) if len(alert_s) else math.inf
        rows.append((
            Cell(method, method), Cell(str(len(before)), float(len(before))),
            Cell(str(len(alert_s)), float(len(alert_s))),
            Cell(f"{median:.0f}" if len(alert_s) else NONE, median),
            Cell(str(int((alert_s < LATE_S).sum())), float((alert_s < LATE_S).sum())),
            Cell(f"{needless} of {int((~would).sum())}", float(needless)),
        ))  # fmt: skip
    heads = (
        ("method", ""),
        ("losses", "encounters in which the flight alone loses well clear by ASTM F3442"),
        ("told", "those in which the pilot is told of traffic"),
        ("before [s]", "median time from there to the loss of the flight alone"),
        ("late", f"those told less than {LATE_S:.0f} s before, the time of DAIDALUS' warning for DO-365"),
        ("needless", "encounters without such a loss in which the pilot is told, too"),
    )
    return ResultTable(f"{case.title}: what the pilot is told", heads, tuple(rows))


def _binned_table(case: Case, measure: str, words: str, edges: Sequence[float]) -> ResultTable:
    """Losses of well clear by ASTM F3442, by the value of a measure."""
    ends = [-np.inf, *edges, np.inf]
    names = [f"below {edges[0]:g}", *(f"{a:g} to {b:g}" for a, b in itertools.pairwise(edges))]
    names.append(f"from {edges[-1]:g} on")
    rows = []
    for method, sample in case.samples.items():
        which = np.digitize(values_of(sample, measure), ends[1:-1])
        rows += [
            (Cell(method, method), Cell(name, ends[n]), *_ratio_cells(sample, LOSS, which == n))
            for n, name in enumerate(names)
        ]
    heads = (("method", ""), (words, ""), *_HEADS)
    return ResultTable(f"{case.title}: losses of well clear by {words}", heads, tuple(rows))


_HEADS = (
    ("encounters", ""),
    ("with", "events with the service"),
    ("without", "events of the flight alone"),
    ("risk ratio", "with over without; paired bootstrap, of no event Clopper and Pearson's limit"),
)


def _ratio_cells(sample: Sample, event: str, chosen: Flags | None) -> tuple[Cell, ...]:
    lost, would = happened(sample, event), happened(sample, f"without.{event}")
    if chosen is not None:
        lost, would = lost[chosen], would[chosen]
    counts = (len(lost), int(lost.sum()), int(would.sum()))
    cells = [Cell(str(count), float(count)) for count in counts]
    if not would.any():
        return *cells, Cell(NONE, np.inf)
    ratio = risk_ratio(lost.astype(float), would.astype(float))
    return *cells, Cell(interval_text(ratio), ratio.value)


def values_of(sample: Sample, measure: str) -> FloatArray:
    """Return a measure of every encounter that was flown, by its seed.

    Parameters
    ----------
    sample : Sample
        The encounters of one method.
    measure : str
        The measure's name in the rows.

    Returns
    -------
    ndarray, shape (N,)
        The values; NaN where an encounter has none.
    """
    known = sample.values(Measure(measure, ""))
    flown = sorted(seed for seed, row in sample.rows.items() if row.error is None)
    return np.array([known.get(seed, np.nan) for seed in flown])


def happened(sample: Sample, event: str) -> Flags:
    """Return whether an event happened in each encounter that was flown, by its seed (N,).

    Parameters
    ----------
    sample : Sample
        The encounters of one method.
    event : str
        The event's name in the rows.
    """
    rows = [row for _, row in sorted(sample.rows.items()) if row.error is None]
    return np.array([row.measures.get(event) is True for row in rows], dtype=bool)
