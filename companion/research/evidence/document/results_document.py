"""``docs/tables.md``: the paper's tables and our flights, from the rows that the repository keeps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from companion.errors import ConfigError
from companion.research.evidence.document.flown_tables import flown_parts
from companion.research.evidence.document.kept_rows import ENDING, stored_evidence
from companion.research.evidence.document.paper_tables import counts_table, ordering_tables, value_tables
from companion.research.evidence.document.reasons import Reasons, load_reasons
from companion.research.evidence.document.sources import provenance_of
from companion.research.evidence.evidence_tables import ResultTable, markdown, measures_table, rates_table
from companion.research.evidence.orderings import TABLES
from companion.research.evidence.results import HOW, OF_WHICH, ORDERINGS
from companion.research.evidence.samples import GROUPS, Evidence
from companion.research.evidence.verdicts import judged

REASONS = "reasons.yaml"
_HEAD = """\
# Tables

[Results](results.md) says in short what these tables show.

`make tables` makes this page from the rows in `campaigns/results`, which `companion campaign` and
`companion results --keep` made, and from `campaigns/results/reasons.yaml`, which people wrote.
[Campaigns](campaigns.md) tells how to make rows of your own, and pages with curves and violins of them.
"""


def results_document(folder: Path) -> str:
    """Return the page.

    Parameters
    ----------
    folder : Path
        Folder of the kept rows and the reasons.

    Raises
    ------
    ConfigError
        If a file there is missing or wrong.
    """
    files = sorted(folder.glob(f"*{ENDING}"))
    if not files:
        raise ConfigError(
            str(folder), None, "FOLDER", f"no *{ENDING}", "rows that companion results --keep wrote"
        )
    reasons = load_reasons(folder / REASONS)
    every = [stored_evidence(file) for file in files]
    parts = [_HEAD.rstrip()]
    for kind, make in (("plans", _plans_part), ("flights", flown_parts), ("anytime", _other_part)):
        for evidence in every:
            if evidence.kind == kind:
                parts += [*make(evidence, reasons)]
    return "\n\n".join(parts) + "\n"


def _plans_part(evidence: Evidence, reasons: Reasons) -> Iterator[str]:
    """Parts with the paper's tables, verdicts, and reasons."""
    verdicts = list(judged(evidence))
    yield "## The paper's Tables 1 to 5"
    yield f"{provenance_of(evidence)} {HOW}"
    if "plans" in reasons.notes:
        yield reasons.notes["plans"].strip()
    yield ORDERINGS
    yield _shown(counts_table(verdicts))
    values, orderings = list(value_tables(evidence)), dict(ordering_tables(verdicts, reasons))
    for table in TABLES:
        yield from (_shown(shown) for number, shown in values if number == table.number)
        if table.number in orderings:
            yield _shown(orderings[table.number])
    yield "### Why not"
    yield "\n".join(f"{n}. {' '.join(reason.why.split())}" for n, reason in enumerate(reasons.orderings, 1))


def _other_part(evidence: Evidence, reasons: Reasons) -> Iterator[str]:
    """Tables that compare ours with planners of other libraries."""
    yield "## Beside OMPL"
    yield f"{provenance_of(evidence)} {OF_WHICH['anytime']}"
    if "anytime" in reasons.notes:
        yield reasons.notes["anytime"].strip()
    for case in evidence.cases:
        yield _shown(rates_table("anytime", case))
        yield from (_shown(measures_table(case, group)) for group in GROUPS["anytime"])


def _shown(table: ResultTable) -> str:
    return markdown(table).rstrip()
