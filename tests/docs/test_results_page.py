"""The page of results is what its rows and reasons say, and nothing in it is left unexplained."""

from pathlib import Path

from companion.research.evidence.document.kept_rows import stored_evidence
from companion.research.evidence.document.reasons import load_reasons
from companion.research.evidence.document.results_document import REASONS, results_document
from companion.research.evidence.verdicts import Verdict, judged

ROOT = Path(__file__).parents[2]
ROWS = ROOT / "campaigns" / "results"
ROOM = 1_500_000  # bytes that all kept rows may take


def test_the_page_is_made_of_the_rows():
    page = (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")
    assert page == results_document(ROWS), "make tables makes it anew"


def test_the_rows_are_small():
    assert sum(file.stat().st_size for file in ROWS.iterdir()) < ROOM


def test_every_ordering_that_is_not_reproduced_has_a_reason_and_every_reason_an_ordering():
    reasons = load_reasons(ROWS / REASONS)
    every = [entry for file in ROWS.glob("*.csv") for entry in judged(stored_evidence(file))]
    against = [entry for entry in every if entry.verdict is Verdict.NOT_REPRODUCED]
    assert len(against) > 20
    missing = [_named(entry) for entry in against if reasons.of(entry) is None]
    assert missing == []
    used = {reasons.of(entry) for entry in against}
    assert used == set(range(1, len(reasons.orderings) + 1))


def _named(entry):
    ordering = entry.ordering
    return entry.case.title, ordering.table, ordering.measure, ordering.less, ordering.more
