"""The files of ``companion results``: Markdown, CSV and a page, the same for the same rows."""

from __future__ import annotations

from pathlib import Path

from companion.research.evidence.distributions import distributions, violins
from companion.research.evidence.encounter_drawing import passages
from companion.research.evidence.encounter_tables import encounter_tables, overview_table
from companion.research.evidence.evidence_tables import (
    DIFFERENCES_HEAD,
    MEASURES_HEAD,
    ResultTable,
    csv_text,
    difference_rows,
    markdown,
    measure_rows,
    tables_of,
)
from companion.research.evidence.results_page import Part, results_page
from companion.research.evidence.samples import Case, Evidence
from companion.research.evidence.verdicts import RUNS_MIN, Judged, counts_table, judged, verdicts_table
from companion.safe_files import SHARED, replace_file
from companion.ui.reports import style

HOW = (
    "Means with 95 % percentile intervals of 2,000 seeded resamples (medians are in the CSV, and on the page "
    "where the mouse rests); of fewer than ten values they are too narrow. Success with Wilson's interval. "
    "Differences are paired by seed."
)
OF_WHICH = {
    "plans": "Search measures are of all runs, those of a path of runs that reach the goal.",
    "flights": "The time until the goal is of flights that reach it, all else of all flights.",
    "encounters": "An encounter is a flight alone, and the same flight that hears of an aircraft.",
    "anytime": "Costs are of the runs that have a path by then.",
}
ORDERINGS = (
    "Every pair of different values in a column of the paper's tables. An ordering is reproduced, or not, "
    "where the 95 % interval of the paired difference excludes zero; no correction is made for how many they "
    "are: of 100 pairs of methods that are in truth alike, about five get a verdict. Below "
    f"{RUNS_MIN} pairs there is none."
)
ALL = "All encounters"
CURVES = (
    "Above, the share of all runs with at most that value; a curve ends at the share of runs that have one. "
    "Below, how frequent values are, with the number of runs that have one: a dot is the median, a bar "
    "holds the middle half."
)
VERDICTS_HEAD = (
    "mission", "setting", "table", "measure", "less", "more", "printed_less", "printed_more", "pairs",
    "difference", "low", "high", "verdict", "remark",
)  # fmt: skip


def write_results(folder: Path, evidence: Evidence) -> tuple[Path, ...]:
    """Write all results into a folder.

    Parameters
    ----------
    folder : Path
        The folder.
    evidence : Evidence
        The rows.

    Returns
    -------
    tuple of Path
        The written files.
    """
    every = list(judged(evidence))
    by_case = {
        case.title: [*encounter_tables(evidence.kind, case), *tables_of(evidence, case)]
        for case in evidence.cases
    }
    texts = {
        "results.md": _markdown(evidence, by_case, every),
        "results.html": _page(evidence, by_case, every),
        "measures.csv": csv_text(MEASURES_HEAD, measure_rows(evidence)),
        "differences.csv": csv_text(DIFFERENCES_HEAD, difference_rows(evidence)),
    }
    if every:
        texts["verdicts.csv"] = csv_text(VERDICTS_HEAD, map(_verdict_row, every))
    for name, text in texts.items():
        replace_file(folder / name, text.encode(), SHARED)
    return tuple(folder / name for name in texts)


def _introduction(evidence: Evidence) -> list[str]:
    """Return the lines that describe the rows."""
    runs = f"{evidence.num_rows:,} of {evidence.num_wanted:,} {evidence.kind}."
    if evidence.num_rows < evidence.num_wanted:
        runs += " The campaign is not finished: companion campaign --resume goes on."
    commits = ", ".join(evidence.commits)
    method = f"{HOW} {OF_WHICH[evidence.kind]}"
    several = " More than one commit made these rows." if len(evidence.commits) > 1 else ""
    return [runs, f"Commit {commits}.{several} {'; '.join(evidence.machines)}.", method]


def _verdict_tables(every: list[Judged]) -> list[ResultTable]:
    if not every:
        return []
    titles = dict.fromkeys(entry.case.title for entry in every)
    of_case = {title: [entry for entry in every if entry.case.title == title] for title in titles}
    return [
        counts_table(every),
        *(verdicts_table(some, f"{title}: the paper's orderings") for title, some in of_case.items()),
    ]


def _markdown(evidence: Evidence, by_case: dict[str, list[ResultTable]], every: list[Judged]) -> str:
    parts = [f"# {evidence.name}", *_introduction(evidence)]
    if (overview := overview_table(evidence)) is not None:
        parts += [f"## {ALL}", markdown(overview).rstrip()]
    for title, tables in by_case.items():
        parts += [f"## {title}", *(markdown(table).rstrip() for table in tables)]
    if every:
        parts += ["## The paper's orderings", ORDERINGS]
        parts += [markdown(table).rstrip() for table in _verdict_tables(every)]
    return "\n\n".join(parts) + "\n"


def _page(evidence: Evidence, by_case: dict[str, list[ResultTable]], every: list[Judged]) -> str:
    parts = [_case_part(evidence.kind, case, n, by_case[case.title]) for n, case in enumerate(evidence.cases)]
    if (overview := overview_table(evidence)) is not None:
        parts.insert(0, Part(ALL, "", [overview]))
    if every:
        parts.append(Part("The paper's orderings", ORDERINGS, _verdict_tables(every)))
    return results_page(f"Campaign: {evidence.name}", _introduction(evidence), parts)


def _case_part(kind: str, case: Case, number: int, tables: list[ResultTable]) -> Part:
    with style.drawing():
        figures = (
            ("Passages", passages(kind, case)), ("Distributions", distributions(kind, case)),
            ("Violins", violins(kind, case)),
        )  # fmt: skip
        drawings = [
            style.inline_svg(figure, f"{name.lower()}-{number}", f"{name} of measures on {case.title}")
            for name, figure in figures
            if figure is not None
        ]
    return Part(case.title, "", tables, "\n".join(drawings), CURVES)


def _verdict_row(entry: Judged) -> list[object]:
    case, order = entry.case, entry.ordering
    return [
        case.mission, case.setting, order.table, order.measure, order.less, order.more, order.printed_less,
        order.printed_more, entry.num_pairs, *(entry.difference or ("", "", "")), entry.verdict.value,
        entry.remark,
    ]  # fmt: skip
