"""Whoever takes or returns an array says of each what shape it has.

Above the kernels, public functions have numpydoc sections, ``name : ndarray, shape (N, 3)``. Kernels say
it in their prose: the array's name, then within a line its shape in brackets, ````q_s`` (3,)``. So may,
above the kernels, private and nested functions, methods and properties; and a public function of one line
may say in it what it returns. Classes that bundle arrays say it of their fields, in either way.
"""

import ast
import re

import pytest

from tests.support.sources import SOURCES, found_in, name_of, nodes_of, tree_of

pytestmark = pytest.mark.xdist_group("sources")

ARRAYS = re.compile(r"(Float|Int|Bool)Array|NDArray|ArrayLike|ndarray")
SHAPE = r"\([^()]*,[^()]*\)"
SIZE = r"(?:\d+|[A-Z]|…)(?: [+-] \d+)?"
PLAIN_SHAPE = rf"\({SIZE},(?: {SIZE})?(?:, {SIZE})*\)"  # above the kernels: no aside in brackets
WITHIN = 80  # characters between a name and its shape
RIDDLES = ("Of ", "Its ", "Whose")  # a parameter's text stands alone


def is_array(annotation):
    return annotation is not None and bool(ARRAYS.search(ast.unparse(annotation)))


def functions_of(tree):
    """Functions of a module, each with whether it is public: not private, nested, or of a class."""
    public = {id(node) for node in tree.body if not getattr(node, "name", "_").startswith("_")}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith("__"):
            yield node, id(node) in public


def kinds_of(path, public):
    """The ways in which a function of that module may say it."""
    if path.startswith("companion/kernels"):
        return ("kernel",)
    return ("numpydoc",) if public else ("numpydoc", "short")


def says(docstring, name, kind):
    """Whether the shape of an array of that name is given."""
    if kind == "numpydoc":
        rows = re.findall(r"^ *([\w, ]+) : (.*)$", docstring, re.MULTILINE)
        return any(name in names.split(", ") and "shape (" in text for names, text in rows)
    shape = SHAPE if kind == "kernel" else PLAIN_SHAPE
    return bool(re.search(rf"``{name}``(?s:.){{0,{WITHIN}}}?{shape}", docstring))


def returns_shape(docstring, kind):
    """Whether the shape of what is returned is given; a docstring of one line may always be short."""
    if kind == "numpydoc" and "\n" in docstring:
        section = re.search(r"Returns\n *-+\n(?s:(.*))", docstring)
        return section is not None and "shape (" in section.group(1)
    return bool(re.search(SHAPE if kind == "kernel" else PLAIN_SHAPE, _without_arguments(docstring)))


def _without_arguments(docstring):
    """The docstring without the shapes of what is named, which say nothing of what is returned."""
    return re.sub(rf"``\w+``,?(?: shape)? {PLAIN_SHAPE}", "", docstring)


def silent_functions(path):
    """Functions and arrays of a module without a shape."""
    for node, public in functions_of(tree_of(path)):
        docstring, kinds = ast.get_docstring(node) or "", kinds_of(name_of(path), public)
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        for argument in arguments:
            if is_array(argument.annotation) and not any(says(docstring, argument.arg, k) for k in kinds):
                yield f"{node.name}: {argument.arg}"
        if is_array(node.returns) and not any(returns_shape(docstring, k) for k in kinds):
            yield f"{node.name}: what it returns"


def silent_fields(path):
    """Fields of bundles (named tuples, data classes) without a shape."""
    for node in nodes_of(path):
        if not isinstance(node, ast.ClassDef):
            continue
        docstring = ast.get_docstring(node) or ""
        for field in node.body:
            if isinstance(field, ast.AnnAssign) and is_array(field.annotation):
                name = field.target.id
                if not any(says(docstring, name, kind) for kind in ("kernel", "numpydoc")):
                    yield f"{node.name}.{name}"


def riddles(path):
    """Texts of parameters that do not stand alone."""
    for node in nodes_of(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            texts = re.findall(r"^[\w, ]+ : .*\n +(.*)$", ast.get_docstring(node) or "", re.MULTILINE)
            yield from (text for text in texts if text.startswith(RIDDLES))


def test_the_shape_of_every_array_is_given():
    assert found_in(SOURCES, lambda path: [*silent_functions(path), *silent_fields(path)]) == {}


def test_texts_of_parameters_stand_alone():
    assert found_in(SOURCES, lambda path: list(riddles(path))) == {}


def test_the_rule_tells_silence_from_shapes():
    assert says("The ``q_s`` (3,) sample [m].", "q_s", "kernel")
    assert not says("The ``q_s`` sample (paper 4.4).", "q_s", "kernel")
    assert says("Parameters\n----------\na, b : ndarray, shape (N, 3)\n    Places [m].", "b", "numpydoc")
    assert not says("Parameters\n----------\nb : ndarray\n    Places [m].", "b", "numpydoc")
    assert returns_shape("Returns\n-------\nndarray, shape (3,)\n    [m]", "numpydoc")
    assert returns_shape("East and north of the place, (2,) [m].", "numpydoc")
    assert not returns_shape("East and north of the place [m].", "numpydoc")
    assert not returns_shape("Places (N, 3) [m].\n\nMore is said here.", "numpydoc")
    assert returns_shape("Places (N, 3) [m].\n\nMore is said here.", "short")


def test_an_aside_in_brackets_and_the_shape_of_another_are_no_shape_of_what_is_returned():
    assert says("``a`` (N, 3) places [m].", "a", "short")
    assert not says("``a`` (east, north, up) of a place [m].", "a", "short")
    assert not returns_shape("Places (east, north, up) [m].", "short")
    assert not returns_shape("How far ``a`` (N, 3) is from there [m].", "short")
    assert not returns_shape("How far ``a``, shape (N, 3), is from there [m].", "short")


def test_public_functions_above_the_kernels_have_sections():
    code = "def f():\n  def g(): ...\ndef _h(): ...\nclass C:\n  def m(self): ..."
    public = {node.name: public for node, public in functions_of(ast.parse(code))}
    assert public == {"f": True, "g": False, "_h": False, "m": False}
    assert kinds_of("companion/ui/reports/plots.py", public=True) == ("numpydoc",)
    assert kinds_of("companion/kernels/arrays.py", public=True) == ("kernel",)
