"""The pilot's texts: their length, their kinds, and that a flight sends no others."""

import ast
import re

import pytest

from companion.flight.state.decision import DecisionKind
from companion.types.pilot_texts import SUBJECTS, TEXTS, kind_of, pilot_message
from tests.docs.write_pilot_messages import PAGE, page
from tests.support.sources import SOURCES, name_of, nodes_of

pytestmark = pytest.mark.xdist_group("sources")

NAMES = {key: re.findall(r"{(\w+)}", row.template) for key, row in TEXTS.items()}
STATUSTEXT = 50


def test_a_text_is_found_again_by_its_words():
    for key, row in TEXTS.items():
        message = pilot_message(key, **dict.fromkeys(NAMES[key], "a word"))
        assert (kind_of(message.text), message.severity) == (row.kind, row.severity)
        assert DecisionKind(row.kind)


def test_a_text_without_values_fits_one_message():
    assert [key for key, row in TEXTS.items() if not NAMES[key] and len(row.template) > STATUSTEXT] == []


def test_the_usual_text_of_a_path_fits_one_message():
    text = pilot_message("path", turn="Right turn in 300 m", arrival="goal in 12:05").text
    assert text == "New path, safe. Right turn in 300 m, goal in 12:05"
    assert len(text) <= STATUSTEXT


def test_subjects_are_of_texts_that_there_are():
    assert SUBJECTS.keys() <= TEXTS.keys()
    assert kind_of("Planner keep: cost 69.4, flown 68.9") is None


def test_the_page_has_every_text_with_its_cause_and_what_to_do():
    assert PAGE.read_text(encoding="utf-8") == page()
    assert all(row.cause.endswith(".") and row.action.endswith(".") for row in TEXTS.values())


def test_nobody_but_the_announcer_sends_a_text():
    nodes = [(name_of(path), node) for path in SOURCES for node in nodes_of(path)]
    nodes = [(name, node) for name, node in nodes if name.startswith("companion/")]
    calls = {
        name
        for name, node in nodes
        if isinstance(node, ast.Attribute) and node.attr == "status_text" and isinstance(node.ctx, ast.Load)
    }
    assert calls == {"companion/flight/messages/send_budgets.py", "companion/link/messages/component.py"}
    tells = {
        name
        for name, node in nodes
        if isinstance(node, ast.Attribute)
        and node.attr == "tell"
        and ast.unparse(node.value).endswith("link")
    }
    assert tells == {"companion/flight/messages/announcer.py"}
