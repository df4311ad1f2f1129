"""The page and the report: one vocabulary, and the same colours for the same things."""

import json
import re

from companion.flight.state.decision import DecisionKind
from companion.ui.page.pages import static_files
from companion.ui.reports import report, style
from companion.ui.reports.vocabulary import KINDS, as_script, decision_words

# Names in the page's style sheet, and what the report's drawings call the same.
SHARED = {
    "ink": "INK", "muted": "MUTED", "flown": "FLOWN", "dynamic": "DYNAMIC", "radar": "RADAR", "goal": "GOAL",
    "start": "START", "obstacle": "OBSTACLE", "tree": "TREE", "horizon": "HORIZON", "reach": "REACH",
    "sub-goal": "SUB_GOAL",
}  # fmt: skip


def colours(sheet):
    """Custom properties of a style sheet's first ``:root``."""
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", sheet[: sheet.index("}")]))


def test_every_kind_of_decision_has_words():
    assert set(KINDS) == {kind.value for kind in DecisionKind}
    assert len({words.head for words in KINDS.values()}) == len(KINDS)
    assert decision_words("of another version") == ("of another version", "")


def test_the_page_is_told_the_same_words():
    text = as_script().decode()
    assert json.loads(text.removeprefix("export const KINDS = ").removesuffix(";\n")) == {
        kind: list(words) for kind, words in KINDS.items()
    }
    assert static_files()["kinds.js"] == as_script()


def test_the_same_things_have_the_same_colours():
    page = colours(static_files()["page.css"].decode())
    assert {name: page[name] for name in SHARED} == {
        name: getattr(style, entry) for name, entry in SHARED.items()
    }
    of_report = colours(report.STYLE_SHEET)
    assert {name: page[name] for name in of_report} == of_report
    assert {"watch", "danger", "muted"} <= of_report.keys()
