"""The page names every kind, every word for it, and every property, each in the row of its kind."""

import re

import pytest

from companion.config.conversion.found_places import AREAS, PROPERTIES, WORDS, Kind, kind_named
from tests.support.sources import ROOT

PAGE = (ROOT / "docs" / "own-mission.md").read_text(encoding="utf-8")
ROWS = [line.split("|") for line in PAGE.splitlines() if line.startswith("| `")]
TABLE = {
    words: (form, properties) for _, words, form, properties, _ in (row for row in ROWS if len(row) == 5)
}


def quoted(text):
    return set(re.findall(r"`(\w+)`", text))


def row_of(kind):
    (row,) = (words for words in TABLE if kind.value in quoted(words))
    return row


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.TAKEOFF])
def test_the_page_says_what_each_kind_is_called_and_has(kind):
    words = row_of(kind)
    form, properties = TABLE[words]
    assert quoted(words) == {word for word, meant in WORDS.items() if meant is kind}
    assert set(PROPERTIES[kind]) <= quoted(properties) | quoted(form)
    assert ("polygon" in form) == (kind in AREAS)


@pytest.mark.parametrize(
    ("word", "kind"),
    [
        ("Buildings", Kind.OBSTACLE),
        ("no-fly", Kind.NO_FLY),
        (" Moving Threats ", Kind.MOVING_THREAT),
        ("lake", None),
    ],
)
def test_kinds_are_named_in_plain_words(word, kind):
    assert kind_named(word) is kind
