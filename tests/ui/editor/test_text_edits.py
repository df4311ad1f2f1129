"""Changes of a mission file's text: what is written, and that nothing else moves."""

import difflib
from pathlib import Path

import pytest

from companion.config.source import parse
from companion.errors import ConfigError
from companion.ui.editor.text_edits import (
    exchanged,
    replaced,
    value_at,
    with_item,
    with_key,
    without,
    written,
)

BLOCKS = """\
# At the top.
name: blocks   # of the mission
start:
  east_m: 150      # aligned
  north_m: 750

goals:   # in order
  - east_m: 1750   # the first
    north_m: 750
    # between
  -   east_m: 1
      north_m: 2
radars:
  # none of them is known
  - {name: a, east_m: 1,   north_m: 2}   # odd   spaces
corners: [ [0, 1], [2,3] , [4, 5] ]
note: 'single' # quoted
empty:
# At the end.
"""


def changed_lines(before, after):
    """Lines that went, and lines that came."""
    lines = list(difflib.unified_diff(before.splitlines(), after.splitlines(), n=0, lineterm=""))[2:]
    return [line for line in lines if not line.startswith("@@")]


def test_a_value_is_replaced_in_its_place():
    new = replaced(
        BLOCKS, {("start", "east_m"): 160.5, ("goals", 0, "north_m"): 751, ("corners", 1, 0): -2.25}
    )
    assert changed_lines(BLOCKS, new) == [
        "-  east_m: 150      # aligned", "+  east_m: 160.5      # aligned",
        "-    north_m: 750", "+    north_m: 751",
        "-corners: [ [0, 1], [2,3] , [4, 5] ]", "+corners: [ [0, 1], [-2.25,3] , [4, 5] ]",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("path", "value", "lines"),
    [
        (("start", "up_m"), 100, ["+  up_m: 100"]),
        (("goals", 1, "up_m"), 5, ["+      up_m: 5"]),
        (("planning", "seed"), 3, ["+planning: {seed: 3}"]),
        (("empty",), True, ["-empty:", "+empty: true"]),
        (("empty", "deep"), 1, ["-empty:", "+empty: {deep: 1}"]),
        (("note",), "it's: odd", ["-note: 'single' # quoted", '+note: "it\'s: odd" # quoted']),
        (
            ("radars", 0, "up_m"), 1e-07,
            [
                "-  - {name: a, east_m: 1,   north_m: 2}   # odd   spaces",
                "+  - {name: a, east_m: 1,   north_m: 2, up_m: 1e-07}   # odd   spaces",
            ],
        ),
    ],
)  # fmt: skip
def test_a_key_is_set_whether_it_is_there_or_not(path, value, lines):
    new = with_key(BLOCKS, path, value)
    assert changed_lines(BLOCKS, new) == lines
    assert value_at(parse(new, "x").data, path) == value


def test_entries_come_and_go_in_lists_of_both_layouts():
    goal = {"east_m": 3.0, "north_m": 4}
    assert changed_lines(BLOCKS, with_item(BLOCKS, ("goals", 2), goal)) == ["+  - {east_m: 3, north_m: 4}"]
    assert "goals:   # in order\n  - {east_m: 3, north_m: 4}\n  - east_m: 1750" in with_item(
        BLOCKS, ("goals", 0), goal
    )
    assert "[ [9, 9], [0, 1]" in with_item(BLOCKS, ("corners", 0), [9, 9])
    assert "[4, 5], [9, 9] ]" in with_item(BLOCKS, ("corners", 3), [9, 9])
    assert changed_lines(BLOCKS, without(BLOCKS, ("goals", 1))) == ["-  -   east_m: 1", "-      north_m: 2"]
    assert "corners: [ [0, 1] , [4, 5] ]" in without(BLOCKS, ("corners", 1))
    assert "corners: [[2,3] , [4, 5] ]" in without(BLOCKS, ("corners", 0))
    assert changed_lines(BLOCKS, without(BLOCKS, ("start", "east_m"))) == ["-  east_m: 150      # aligned"]


def test_the_last_entry_leaves_an_empty_list_which_is_filled_again():
    bare = without(BLOCKS, ("radars", 0))
    assert parse(bare, "x").data["radars"] == ()
    assert "radars: []\n  # none of them is known\n" in bare
    assert parse(with_item(bare, ("radars", 0), {"name": "b"}), "x").data["radars"] == ({"name": "b"},)
    assert with_item("a: 1", ("b", 0), {"c": 2}) == "a: 1\nb:\n  - {c: 2}"


def test_entries_change_places_with_their_comments():
    text = "goals:\n  - {a: 1}   # first\n  # between\n  - {a: 2}   # second\n  - b:\n      c: 3\n"
    text += "list: [1, 2, 3]\n"
    assert exchanged(text, ("goals", 0), 1).startswith(
        "goals:\n  - {a: 2}   # second\n  # between\n  - {a: 1}   # first\n  - b:"
    )
    assert parse(exchanged(text, ("goals", 2), -2), "x").data["goals"] == (
        {"b": {"c": 3}},
        {"a": 2},
        {"a": 1},
    )
    assert "list: [3, 2, 1]" in exchanged(text, ("list", 0), 2)
    with pytest.raises(ConfigError, match="an entry of a list, with another one"):
        exchanged(text, ("goals", 0), -1)


def test_line_ends_of_windows_stay():
    text = "a: 1\r\nb:\r\n  - {c: 2}\r\n"
    new = with_item(with_item(with_key(text, ("d",), 3), ("b", 1), {"c": 4}), ("e", 0), {"c": 5})
    assert "\n" not in new.replace("\r\n", "")
    assert parse(new, "x").data["b"] == ({"c": 2}, {"c": 4})


def test_the_missions_of_this_project_can_be_changed_everywhere():
    """Each number of each file becomes another and itself again."""
    for file in sorted(Path("mission_configs").glob("*.yaml")):
        text = file.read_text(encoding="utf-8")
        document = parse(text, str(file))
        numbers = [path for path in document.places if type(value_at(document.data, path)) in (int, float)]
        for path in numbers[:: max(1, len(numbers) // 12)]:
            old = value_at(document.data, path)
            start, end = document.places[path][1:]
            new = replaced(text, {path: old + 1})
            assert new[:start] == text[:start]
            assert new[start + len(new) - len(text) + end - start :] == text[end:]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda: replaced(BLOCKS, {("start", "nothing"): 1}), "start.nothing: got nothing"),
        (lambda: with_key(BLOCKS, ("name", "deep"), 1), "a key of a section that is there"),
        (lambda: with_key(BLOCKS, ("name",), float("nan")), "name: got nan; expected a finite number"),
        (lambda: with_key(BLOCKS, ("name",), {1, 2}), "expected a finite number"),
        (lambda: with_item(BLOCKS, ("goals", 5), 1), "goals.5: got nothing; expected a place in the list"),
        (lambda: with_item(BLOCKS, ("start", 0), 1), "start.0: got nothing; expected an entry of a list"),
        (lambda: without(BLOCKS, ("goals", 7)), "expected a key of the file"),
        (lambda: without(BLOCKS, ("goals", 0, "east_m")), "change this place in the file by hand"),
        (lambda: with_key(BLOCKS, ("a: b", "c"), 1), "change this place in the file by hand"),
    ],
)
def test_what_cannot_be_changed_is_said(change, message):
    with pytest.raises(ConfigError, match=message.replace(".", r"\.")):
        change()


def test_values_are_written_as_they_are_read():
    for value in (
        "on",
        "null",
        "1",
        "a b",
        "ä",
        "x: y",
        "",
        " a",
        0.1,
        1e22,
        -3,
        True,
        None,
        [1, [2.5]],
        {"a": {"b": "c"}},
    ):
        back = parse(f"x: {written(('x',), value)}", "x").data["x"]
        assert back == (value if not isinstance(value, list) else (1, (2.5,)))
