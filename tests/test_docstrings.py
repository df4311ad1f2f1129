"""Whoever takes or returns an array says of each what shape it has.

Above the kernels docstrings have numpydoc sections, ``name : ndarray, shape (N, 3)``. Kernels say it in
their prose: the array's name, then within a line its shape in brackets, ````q_s`` (3,)``. Classes that
bundle arrays say it of their fields, in either way.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("companion/kernels", "companion/planning", "companion/world", "companion/vehicle")
SOURCES = sorted(
    path.relative_to(ROOT).as_posix() for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")
)
ARRAYS = re.compile(r"(Float|Int|Bool)Array|NDArray|ArrayLike|ndarray")
SHAPE = r"\([^()]*,[^()]*\)"
WITHIN = 80  # characters between a name and its shape
RIDDLES = ("Of ", "Its ", "Whose")  # a parameter's text stands alone
LATER = {"companion/planning/plan_runner.py"}


def is_array(annotation):
    return annotation is not None and bool(ARRAYS.search(ast.unparse(annotation)))


def kind_of(path):
    return "kernel" if path.startswith("companion/kernels") else "numpydoc"


def says(docstring, name, kind):
    """Whether the shape of an array of that name is given."""
    if kind == "numpydoc":
        rows = re.findall(r"^ *([\w, ]+) : (.*)$", docstring, re.MULTILINE)
        return any(name in names.split(", ") and "shape (" in text for names, text in rows)
    return bool(re.search(rf"``{name}``(?s:.){{0,{WITHIN}}}?{SHAPE}", docstring))


def returns_shape(docstring, kind):
    if kind == "numpydoc":
        section = re.search(r"Returns\n *-+\n(?s:(.*))", docstring)
        return section is not None and "shape (" in section.group(1)
    return bool(re.search(SHAPE, docstring))


def silent_functions(path):
    """Functions and arrays of a module without a shape."""
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or node.name.startswith("__"):
            continue
        docstring, kind = ast.get_docstring(node) or "", kind_of(path)
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        for argument in arguments:
            if is_array(argument.annotation) and not says(docstring, argument.arg, kind):
                yield f"{node.name}: {argument.arg}"
        if is_array(node.returns) and not returns_shape(docstring, kind):
            yield f"{node.name}: what it returns"


def silent_fields(path):
    """Fields of bundles (named tuples, data classes) without a shape."""
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ClassDef):
            continue
        docstring = ast.get_docstring(node) or ""
        for field in node.body:
            if isinstance(field, ast.AnnAssign) and is_array(field.annotation):
                name = field.target.id
                if not any(says(docstring, name, kind) for kind in ("kernel", "numpydoc")):
                    yield f"{node.name}.{name}"


@pytest.mark.parametrize("path", SOURCES)
def test_the_shape_of_every_array_is_given(path):
    assert [*silent_functions(path), *silent_fields(path)] == []


@pytest.mark.parametrize("path", sorted(set(SOURCES) - LATER))
def test_texts_of_parameters_stand_alone(path):
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            texts = re.findall(r"^[\w, ]+ : .*\n +(.*)$", ast.get_docstring(node) or "", re.MULTILINE)
            assert [text for text in texts if text.startswith(RIDDLES)] == []


def test_the_rule_tells_silence_from_shapes():
    assert says("The ``q_s`` (3,) sample [m].", "q_s", "kernel")
    assert not says("The ``q_s`` sample (paper 4.4).", "q_s", "kernel")
    assert says("Parameters\n----------\na, b : ndarray, shape (N, 3)\n    Places [m].", "b", "numpydoc")
    assert not says("Parameters\n----------\nb : ndarray\n    Places [m].", "b", "numpydoc")
    assert returns_shape("Returns\n-------\nndarray, shape (3,)\n    [m]", "numpydoc")
