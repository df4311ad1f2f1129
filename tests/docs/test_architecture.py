"""The page on the architecture shows the code as it is."""

import ast
import importlib
import inspect
import re
import textwrap

import pytest

from tests.docs.draw_architecture import IMAGES, PAGE, PICTURES, ROOT, stays

STAYS = stays()


@pytest.mark.parametrize("name", PICTURES)
def test_the_pictures_are_of_this_code(name):
    assert (IMAGES / name).read_text(encoding="utf-8") == PICTURES[name](), "make docs draws them anew"


def function_at(module, name):
    found = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    return found


def test_the_way_has_sixteen_stays_at_most_and_every_one_exists():
    assert [number for number, *_ in STAYS] == list(range(1, len(STAYS) + 1))
    assert 10 < len(STAYS) <= 16
    for _, module, name, _ in STAYS:
        assert callable(function_at(module, name))


# Whom each stay hands the track on to, in its own words: by call, or by what it takes in or puts out.
HANDED_ON = {
    1: "_receiver", 2: "codec.feed", 3: "_decoded", 5: "world_model.observe", 6: "tracker.observe",
    7: ".observe(", 8: "_filter.observe", 10: "with_tracks", 12: "world_model.snapshot", 13: "_planner.run",
    15: "mission_part",
}  # fmt: skip


@pytest.mark.parametrize("stay", HANDED_ON)
def test_each_stay_hands_on_to_the_next_and_none_through_a_lambda(stay):
    _, module, name, _ = STAYS[stay - 1]
    function = function_at(module, name)
    assert HANDED_ON[stay] in inspect.getsource(function)
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    handing = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Lambda) and HANDED_ON[stay].strip("(.") in ast.unparse(node)
    ]
    assert handing == []


def test_every_file_and_name_on_the_page_exists():
    page = PAGE.read_text(encoding="utf-8")
    for path in re.findall(r"`((?:[a-z_]+/)+(?:\w+\.py)?)`", page):
        assert any((ROOT / base / path).exists() for base in (".", "companion")), path
