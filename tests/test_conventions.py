"""What the source keeps to and no linter checks."""

import ast
import collections
import re

import pytest

from tests.support.sources import FUNCTIONS, SOURCES, found_in, name_of, nodes_of, text_of, tree_of

pytestmark = pytest.mark.xdist_group("sources")

MODULE_LINES_MAX = 500
FUNCTION_LINES_MAX = 80

# Where every exception is caught, and why that is right there.
BROAD_EXCEPTS: dict[str, str] = {
    "companion/research/campaign/engines/process_engine.py": "the top of a run: its fault becomes its row",
    "companion/cli.py": "the top of the program: whatever was not foreseen becomes a logged exit code 4",
    "companion/planning/plugins/foreign_code.py": "the top of another package's code: its fault becomes ours",
    "companion/flight/tasks/app.py": "the top of each task: logs the fault with its trace, raises it again",
    "companion/planning/threads.py": "the top of a thread: hands the fault to whoever awaits the thread",
}

# The only modules that know a library, so that the rest can be read without it.
KEEPERS = {
    "pymavlink": "companion/link/messages/codec.py",
    "mavsdk": "companion/link/missions/mavsdk_reader.py",
}

# Ways through a function. Ruff counts branches and loops; here the operands of and and or, conditional
# expressions, loops of comprehensions and their conditions count, too.
WAYS_MAX = {"companion/kernels/": 15}
WAYS_MAX_ELSEWHERE = 12
BRANCHES = (
    ast.If | ast.For | ast.AsyncFor | ast.While | ast.IfExp | ast.ExceptHandler | ast.Assert | ast.match_case
)
# A module may import so many of our own.
FAN_OUT_MAX = 15
COMPANION = [path for path in SOURCES if name_of(path).startswith("companion/")]
FOLDERS = sorted({path.parent for path in SOURCES})


def names_in(node):
    return {child.id for child in ast.walk(node) if isinstance(child, ast.Name)}


def public_definitions(node, prefix=""):
    """Classes and functions that others can reach, except special methods and nested functions."""
    for child in node.body:
        if isinstance(child, FUNCTIONS | ast.ClassDef) and not child.name.startswith("_"):
            yield prefix + child.name, child
            if isinstance(child, ast.ClassDef):
                yield from public_definitions(child, f"{child.name}.")


def test_every_module_and_public_definition_has_a_docstring():
    def without(path):
        found = [("the module", tree_of(path)), *public_definitions(tree_of(path))]
        return [name for name, node in found if not ast.get_docstring(node)]

    assert found_in(SOURCES, without) == {}


@pytest.mark.parametrize("function", ["print", "time.sleep"])
def test_nothing_is_printed_and_nothing_sleeps_by_the_computers_clock(function):
    def calls(path):
        found = [node for node in nodes_of(path) if isinstance(node, ast.Call)]
        return [node.lineno for node in found if ast.unparse(node.func) == function]

    assert found_in(SOURCES, calls) == {}


def broad_excepts(path):
    """Lines that catch every exception."""
    return [
        node.lineno
        for node in nodes_of(path)
        if isinstance(node, ast.ExceptHandler)
        and (node.type is None or {"Exception", "BaseException"} & names_in(node.type))
    ]


def test_each_broad_except_is_listed_with_a_reason():
    assert {name: len(lines) for name, lines in found_in(SOURCES, broad_excepts).items()} == dict.fromkeys(
        BROAD_EXCEPTS, 1
    )
    assert all(BROAD_EXCEPTS.values())


def test_modules_and_functions_are_short():
    def long(path):
        lengths = {node.name: _body_lines(node) for node in nodes_of(path) if isinstance(node, FUNCTIONS)}
        found = {name: lines for name, lines in lengths.items() if lines > FUNCTION_LINES_MAX}
        num_lines = len(text_of(path).splitlines())
        return found | ({"the module": num_lines} if num_lines > MODULE_LINES_MAX else {})

    assert found_in(SOURCES, long) == {}


def _body_lines(function):
    docstring = function.body[0] if ast.get_docstring(function) else None
    hidden = docstring.end_lineno - docstring.lineno + 1 if docstring else 0
    return function.end_lineno - function.lineno + 1 - hidden


def test_functions_have_few_ways_through_them():
    def tangled(path):
        name = name_of(path)
        limit = next(
            (ways for folder, ways in WAYS_MAX.items() if name.startswith(folder)), WAYS_MAX_ELSEWHERE
        )
        ways = {node.name: _ways_through(node) for node in nodes_of(path) if isinstance(node, FUNCTIONS)}
        return {name: n for name, n in ways.items() if n > limit}

    assert found_in(SOURCES, tangled) == {}


def _ways_through(function):
    """Cyclomatic complexity, without that of functions inside."""
    ways, waiting = 1, list(ast.iter_child_nodes(function))
    while waiting:
        node = waiting.pop()
        if isinstance(node, BRANCHES):
            ways += 1
        elif isinstance(node, ast.BoolOp):
            ways += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            ways += 1 + len(node.ifs)
        if not isinstance(node, FUNCTIONS | ast.ClassDef):
            waiting.extend(ast.iter_child_nodes(node))
    return ways


def test_modules_import_few_others():
    def many(path):
        modules = {
            (node.level, node.module)
            for node in nodes_of(path)
            if isinstance(node, ast.ImportFrom)
            and (node.level or node.module.startswith(("companion.", "sim.")))
        }
        return sorted(modules) if len(modules) > FAN_OUT_MAX else []

    assert found_in(SOURCES, many) == {}


def test_libraries_are_known_to_their_keepers_only():
    """The simulator, as the other side of the link, may know them."""

    def strangers(path):
        imported = set()
        for node in nodes_of(path):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                imported.add(node.module.split(".")[0])
        return {library for library in imported & KEEPERS.keys() if KEEPERS[library] != name_of(path)}

    assert found_in(COMPANION, strangers) == {}


@pytest.mark.parametrize(
    "marks",
    [("TO" + "DO", "FIX" + "ME", "X" * 3), ("/home/", "/root/", "/Users/", "C:\\")],
    ids=["work left as a remark", "a path of somebody's computer"],
)
def test_no_line_holds_it(marks):
    def holds(path):
        lines = text_of(path).splitlines()
        return [number for number, line in enumerate(lines, 1) if any(mark in line for mark in marks)]

    assert found_in(SOURCES, holds) == {}


FILES_A_FOLDER_MAX = 12
NAMED_ALIKE = {"__init__.py", "__main__.py"}


def test_a_folder_has_a_dozen_files_at_most():
    counts = {
        name_of(folder): len([path for path in folder.glob("*.py") if path.name != "__init__.py"])
        for folder in FOLDERS
    }
    assert {name: number for name, number in counts.items() if number > FILES_A_FOLDER_MAX} == {}


def test_every_folder_says_what_lives_there_and_what_it_may_touch():
    for folder in FOLDERS:
        told = ast.get_docstring(tree_of(folder / "__init__.py")) or ""
        assert len(re.findall(r"[.;](?:\s|$)", told)) >= 2, f"{name_of(folder)}: {told}"


def test_every_file_name_occurs_once():
    names = collections.Counter(path.name for path in SOURCES if path.name not in NAMED_ALIKE)
    assert [name for name, times in names.items() if times > 1] == []


# What a library owns is set up where it is kept, and a result is filled by who makes it.
ASSIGNED_ELSEWHERE = {
    "companion/kernels/native/compiler.py": {"self.state", "self.state.func_id", "each", "flags"},
    "companion/link/messages/codec.py": {"self._writer"},
    "companion/service/replay/engine.py": {"self.result", "result"},
}


def made_here(function):
    """Names that a function binds to what it has made itself, by a call."""
    for node in ast.walk(function):
        values = getattr(node, "value", None)
        values = values.elts if isinstance(values, ast.Tuple) else [values]
        if isinstance(node, ast.Assign) and all(isinstance(value, ast.Call) for value in values):
            for target in node.targets:
                yield from names_in(target)


def assigned_elsewhere(path):
    """Lines that assign an attribute of something that is neither their own object nor made there."""
    for function in nodes_of(path):
        if not isinstance(function, FUNCTIONS | ast.Module):
            continue
        own = {"self", "cls"} | set(made_here(function))
        for node in ast.walk(function) if isinstance(function, FUNCTIONS) else ast.iter_child_nodes(function):
            targets = node.targets if isinstance(node, ast.Assign) else []
            if isinstance(node, ast.AugAssign | ast.AnnAssign):
                targets = [node.target]
            for target in targets:
                for part in target.elts if isinstance(target, ast.Tuple) else [target]:
                    if isinstance(part, ast.Attribute) and ast.unparse(part.value) not in own:
                        yield ast.unparse(part.value), f"line {part.lineno}: {ast.unparse(part)}"


def test_no_object_is_assigned_from_outside():
    """So a value has one writer, and who changes it is found in one place."""

    def foreign(path):
        known = ASSIGNED_ELSEWHERE.get(name_of(path), set())
        return [what for owner, what in assigned_elsewhere(path) if owner not in known]

    assert found_in(COMPANION, foreign) == {}


# Elsewhere code asks a dialect for what follows from it, not which it is.
DIALECT_FILES = {
    "companion/service/doctor/parameter_checks.py",
    "companion/link/messages/flight_modes.py",
    "companion/flight/exchange/protocols.py",
    "companion/types/events.py",
}


def test_dialects_are_told_apart_in_four_files():
    def asks(path):
        attributes = [node for node in nodes_of(path) if isinstance(node, ast.Attribute)]
        return [node for node in attributes if ast.unparse(node) in ("Dialect.ARDUPILOT", "Dialect.PX4")]

    assert found_in(COMPANION, asks).keys() == DIALECT_FILES
