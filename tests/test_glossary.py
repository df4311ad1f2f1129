"""Names in the code use the glossary's terms, and none of the words that it gives up for them."""

import ast
import re

import pytest

from tests.support.sources import ROOT, SOURCES, found_in, nodes_of

pytestmark = pytest.mark.xdist_group("sources")

PAGE = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def rows(heading):
    """Cells of the table under a heading, without the two lines of its head."""
    section = PAGE.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    return [line.strip("| ").split(" | ") for line in section.splitlines() if line.startswith("| ")][1:]


GIVEN_UP = {word.strip() for row in rows("Words that names do not use") for word in row[0].split(",")}


def names_in(source):
    """Names that a module defines: itself, classes, functions, arguments, variables and attributes."""
    yield source.stem
    for node in nodes_of(source):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def words_of(name):
    """The words of a name, in small letters."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


def test_names_use_no_word_that_the_glossary_gives_up():
    found = found_in(SOURCES, lambda source: {name for name in names_in(source) if words_of(name) & GIVEN_UP})
    assert found == {}, "docs/glossary.md has the terms to use instead"


def test_the_glossary_has_each_term_once_with_its_meaning_and_source():
    terms = [row[0] for row in rows("Terms")]
    assert len(terms) == len(set(terms)) >= 50
    assert terms == sorted(terms, key=str.lower)
    assert all(len(row) == 3 and all(row) for row in rows("Terms"))


def test_words_are_told_apart():
    assert words_of("is_threatened") == {"is", "threatened"}
    assert words_of("PilotStatus") == {"pilot", "status"}
    assert words_of("CELLS_2D") == {"cells", "d"}
    assert {"hunter", "caught", "refuge"} <= GIVEN_UP
