"""The table of formulas is true, and (8) is what it says."""

import ast
import importlib
import math
import re

import numpy as np
import pytest
import shapely
from scipy.special import gammainc

from companion.kernels.aircraft.lqg_mp import collision_free
from companion.planning.solver import solve
from tests.support.paths import box
from tests.support.sources import FUNCTIONS, ROOT, SOURCES, nodes_of, tree_of
from tests.support.worlds import problem

pytestmark = pytest.mark.xdist_group("sources")

TABLE = (ROOT / "docs" / "formulas.md").read_text(encoding="utf-8")
ROWS = [line for line in TABLE.splitlines() if line.startswith("|") and "`" in line]
PLACES = sorted(set(re.findall(r"`(companion[\w.]*):(\w+)`", TABLE)))
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", TABLE)))


def test_every_place_named_exists():
    assert [place for place in PLACES if not hasattr(importlib.import_module(place[0]), place[1])] == []


def definitions_of(tree):
    """Functions of a module, those of its classes included, by name."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            yield node.name, node
        for child in [node] if isinstance(node, FUNCTIONS) else getattr(node, "body", []):
            if isinstance(child, FUNCTIONS):
                yield child.name, child


def names_in(node):
    return {child.id for child in ast.walk(node) if isinstance(child, ast.Name)} | {
        child.attr for child in ast.walk(node) if isinstance(child, ast.Attribute)
    }


def module_of(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


class Meanings:
    """What names mean in the modules of the program."""

    def __init__(self, trees):
        self.defined = {
            (module, name): node for module, tree in trees.items() for name, node in definitions_of(tree)
        }
        self.known = {}
        for module, tree in trees.items():
            for node in ast.walk(tree):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("companion"):
                    for alias in node.names:
                        self.known.setdefault((module, alias.asname or alias.name), (node.module, alias.name))
        self.imported = {}  # modules whose attributes a module uses, as in ``dubins.sample``
        for (module, _), (source, name) in self.known.items():
            if f"{source}.{name}" in trees:
                self.imported.setdefault(module, set()).add(f"{source}.{name}")

    def meant(self, module, names):
        for name in names:
            places = [(module, name), *((other, name) for other in self.imported.get(module, ()))]
            yield from (place for place in places if place in self.defined)
            if (module, name) in self.known:
                yield self.known[module, name]

    def behind(self, place):
        """What a used place uses in turn; what a package hands on is defined elsewhere."""
        if place in self.defined:
            yield from self.meant(place[0], names_in(self.defined[place]))
        elif place in self.known:
            yield self.known[place]


def flown():
    """Functions and classes that the program comes to, as (module, name), from its command line on.

    A name counts as used where a function that is itself used mentions it, and its module imports it from
    where it is defined, or defines it. What runs on import is used. Methods belong to their class.
    """
    trees = {module_of(path): tree_of(path) for path in SOURCES if path.is_relative_to(ROOT / "companion")}
    meanings = Meanings(trees)
    waiting = [place for place in meanings.defined if place[0] == "companion.cli"]
    only_defined = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.ImportFrom
    for module, tree in trees.items():
        for node in tree.body:
            waiting += [] if isinstance(node, only_defined) else meanings.meant(module, names_in(node))
    found = set()
    while waiting:
        place = waiting.pop()
        if place not in found:
            found.add(place)
            waiting += meanings.behind(place)
    return found


def test_the_program_comes_to_every_place_named_and_what_nothing_calls_is_told_from_it():
    found = flown()
    assert [place for place in PLACES if place not in found] == []
    assert ("companion.planning.solver", "solve") in found
    assert ("companion.kernels.search.path_edit", "ramp") in found  # by climb_profile, by join, by splice
    assert ("companion.kernels.search.path_edit", "no_such_kernel") not in found
    assert ("companion.research.campaign.measures", "pursuit_measures") not in found


def test_every_test_named_exists():
    functions = {
        (file, node.name)
        for file in {file for file, _ in TESTS}
        for node in nodes_of(ROOT / file)
        if isinstance(node, ast.FunctionDef)
    }
    assert [test for test in TESTS if test not in functions] == []


def test_every_row_names_a_place_and_a_test_and_every_formula_has_one():
    assert len(ROWS) > 40
    for row in ROWS:
        what, where, proof = (cell.strip() for cell in row.strip("|").split("|"))
        assert what
        assert re.fullmatch(r"`companion[\w.]*:\w+`(, `companion[\w.]*:\w+`)*", where)
        assert re.fullmatch(r"`tests/[\w/]+\.py::\w+`(, `tests/[\w/]+\.py::\w+`)*", proof)
    for number in range(1, 10):
        assert any(row.startswith(f"| ({number}) ") for row in ROWS)


def test_quality_by_hand():
    # Three waypoints of the plane, 2, 3 and 4 deviations from the nearest obstacle. In the plane
    # P(1, c²/2) = 1 − exp(−c²/2): 0.864665, 0.988891, 0.999665; their product is 0.854773.
    free = [collision_free(10.0 * c, 10.0, 2) for c in (2.0, 3.0, 4.0)]
    assert free == pytest.approx([0.864665, 0.988891, 0.999665], abs=5e-7)
    assert math.prod(free) == pytest.approx(0.854773, abs=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_quality_of_a_plan_is_the_product_over_its_waypoints(dimension):
    walls = (box("wall", 0.0, 700.0, 900.0, 740.0), box("post", 1150.0, 600.0, 1200.0, 900.0))
    plan = solve(problem(walls, dimension=dimension, seed=2, clearance_min_m=4.0))
    assert plan.reaches_goal
    quality = 1.0
    for position, covariance in zip(
        plan.path.positions_enu_m, plan.path.position_covariances_m2, strict=True
    ):
        away = min(
            math.hypot(
                shapely.Polygon(wall.polygon_enu_m).distance(shapely.Point(position[:2])),
                max(wall.base_m - position[2], 0.0, position[2] - wall.top_m),
            )
            for wall in walls
        )
        deviation = math.sqrt(np.linalg.eigvalsh(covariance[:dimension, :dimension])[-1])
        quality *= gammainc(dimension / 2.0, 0.5 * (away / deviation) ** 2)
    assert quality < 1.0
    assert plan.measures.quality == pytest.approx(quality, rel=1e-9)
