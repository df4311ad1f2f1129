"""The pilot's texts: their length, their kinds, and that a flight sends no others."""

import ast
import re
from pathlib import Path

import pytest

from companion.flight.state.decision import DecisionKind
from companion.types.pilot_texts import SUBJECTS, TEXTS, kind_of, pilot_message
from tests.docs.write_pilot_messages import PAGE, page

NAMES = {key: re.findall(r"{(\w+)}", row.template) for key, row in TEXTS.items()}
STATUSTEXT = 50
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("key", TEXTS)
def test_a_text_is_found_again_by_its_words(key):
    message = pilot_message(key, **dict.fromkeys(NAMES[key], "a word"))
    assert kind_of(message.text) == TEXTS[key].kind
    assert message.severity == TEXTS[key].severity
    assert DecisionKind(TEXTS[key].kind)


@pytest.mark.parametrize("key", [key for key, names in NAMES.items() if not names])
def test_a_text_without_values_fits_one_message(key):
    assert len(TEXTS[key].template) <= STATUSTEXT


def test_the_usual_text_of_a_path_fits_one_message():
    text = pilot_message("path", turn="Right turn in 300 m", time="12:05").text
    assert text == "New path, safe. Right turn in 300 m, goal in 12:05"
    assert len(text) <= STATUSTEXT


def test_subjects_are_of_texts_that_there_are():
    assert SUBJECTS.keys() <= TEXTS.keys()
    assert kind_of("Planner keep: cost 69.4, flown 68.9") is None


def test_the_page_has_every_text_with_its_cause_and_what_to_do():
    assert PAGE.read_text(encoding="utf-8") == page()
    assert all(row.cause.endswith(".") and row.action.endswith(".") for row in TEXTS.values())


def test_nobody_but_the_announcer_sends_a_text():
    calls = {
        source.relative_to(ROOT).as_posix()
        for source in (ROOT / "companion").rglob("*.py")
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr == "status_text" and isinstance(node.ctx, ast.Load)
    }
    assert calls == {"companion/flight/messages/speech.py", "companion/link/messages/component.py"}
    tells = {
        source.relative_to(ROOT).as_posix()
        for source in (ROOT / "companion").rglob("*.py")
        for node in ast.walk(ast.parse(source.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("link.tell")
    }
    assert tells == {"companion/flight/messages/announcer.py"}
