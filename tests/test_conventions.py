"""What the source keeps to and no linter checks."""

import ast
import collections
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(path for tree in ("companion", "sim") for path in (ROOT / tree).rglob("*.py"))
MODULE_LINES_MAX = 500
FUNCTION_LINES_MAX = 80

# Where every exception is caught, and why that is right there.
BROAD_EXCEPTS: dict[str, str] = {
    "companion/research/campaign/engines/process_engine.py": "the top of a run: its fault becomes its row",
    "companion/cli.py": "the top of the program: whatever was not foreseen becomes a logged exit code 4",
    "companion/flight/tasks/app.py": "the top of each task: logs the fault with its trace, raises it again",
    "companion/threads.py": "the top of a thread: hands the fault to whoever awaits the thread",
}

# The only modules that know a library, so that the rest can be read without it.
KEEPERS = {
    "pymavlink": "companion/link/messages/codec.py",
    "mavsdk": "companion/link/missions/mavsdk_reader.py",
}

FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
# Ways through a function. Ruff counts branches and loops; here the operands of and and or, conditional
# expressions, loops of comprehensions and their conditions count, too.
WAYS_MAX = {"companion/kernels/": 15}
WAYS_MAX_ELSEWHERE = 12
BRANCHES = (
    ast.If | ast.For | ast.AsyncFor | ast.While | ast.IfExp | ast.ExceptHandler | ast.Assert | ast.match_case
)
# What is still above; nothing may be added, and none may grow.
FAN_OUT_MAX = 15


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@pytest.fixture(params=SOURCES, ids=name_of)
def source(request):
    return request.param


def names_in(node):
    return {child.id for child in ast.walk(node) if isinstance(child, ast.Name)}


def public_definitions(node, prefix=""):
    """Classes and functions that others can reach, except special methods and nested functions."""
    for child in node.body:
        if isinstance(child, FUNCTIONS | ast.ClassDef) and not child.name.startswith("_"):
            yield prefix + child.name, child
            if isinstance(child, ast.ClassDef):
                yield from public_definitions(child, f"{child.name}.")


def test_every_module_and_public_definition_has_a_docstring(source):
    tree = tree_of(source)
    assert ast.get_docstring(tree), "the module has none"
    missing = [name for name, node in public_definitions(tree) if not ast.get_docstring(node)]
    assert missing == []


def test_nothing_is_printed(source):
    calls = [node for node in ast.walk(tree_of(source)) if isinstance(node, ast.Call)]
    assert [node.lineno for node in calls if ast.unparse(node.func) == "print"] == []


def test_nothing_sleeps_by_the_computers_clock(source):
    calls = [node for node in ast.walk(tree_of(source)) if isinstance(node, ast.Call)]
    assert [node.lineno for node in calls if ast.unparse(node.func) == "time.sleep"] == []


def test_broad_excepts_are_listed_with_a_reason(source):
    broad = {
        handler.lineno
        for handler in ast.walk(tree_of(source))
        if isinstance(handler, ast.ExceptHandler)
        and (handler.type is None or {"Exception", "BaseException"} & names_in(handler.type))
    }
    assert len(broad) <= (name_of(source) in BROAD_EXCEPTS), f"lines {sorted(broad)}"


def test_the_list_of_broad_excepts_is_up_to_date():
    assert BROAD_EXCEPTS.keys() <= {name_of(path) for path in SOURCES}
    assert all(BROAD_EXCEPTS.values())


@pytest.mark.parametrize("listed", BROAD_EXCEPTS)
def test_listed_modules_still_catch_everything_somewhere(listed):
    handlers = [node for node in ast.walk(tree_of(ROOT / listed)) if isinstance(node, ast.ExceptHandler)]
    assert any("Exception" in names_in(node.type) for node in handlers if node.type is not None)


def test_modules_are_short(source):
    assert len(source.read_text(encoding="utf-8").splitlines()) <= MODULE_LINES_MAX


def test_functions_are_short(source):
    lengths = {
        node.name: _body_lines(node) for node in ast.walk(tree_of(source)) if isinstance(node, FUNCTIONS)
    }
    assert {name: lines for name, lines in lengths.items() if lines > FUNCTION_LINES_MAX} == {}


def _body_lines(function):
    docstring = function.body[0] if ast.get_docstring(function) else None
    hidden = docstring.end_lineno - docstring.lineno + 1 if docstring else 0
    return function.end_lineno - function.lineno + 1 - hidden


def test_functions_have_few_ways_through_them(source):
    limit = next(
        (ways for folder, ways in WAYS_MAX.items() if name_of(source).startswith(folder)), WAYS_MAX_ELSEWHERE
    )
    ways = {
        f"{name_of(source)}: {node.name}": _ways_through(node)
        for node in ast.walk(tree_of(source))
        if isinstance(node, FUNCTIONS)
    }
    assert {name: n for name, n in ways.items() if n > limit} == {}


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


def test_modules_import_few_others(source):
    modules = {
        node.module
        for node in ast.walk(tree_of(source))
        if isinstance(node, ast.ImportFrom) and node.module.startswith(("companion.", "sim."))
    }
    assert len(modules) <= FAN_OUT_MAX, sorted(modules)


def test_libraries_are_known_to_their_keepers_only(source):
    if name_of(source).startswith("sim/"):
        return  # the simulator is the other side of the link
    imported = set()
    for node in ast.walk(tree_of(source)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            imported.add(node.module.split(".")[0])
    strangers = {library for library in imported & KEEPERS.keys() if KEEPERS[library] != name_of(source)}
    assert strangers == set()


def test_no_work_is_left_as_a_remark(source):
    marks = ("TO" + "DO", "FIX" + "ME", "X" * 3)
    lines = source.read_text(encoding="utf-8").splitlines()
    assert [number for number, line in enumerate(lines, 1) if any(mark in line for mark in marks)] == []


def test_no_path_of_somebodys_computer(source):
    text = source.read_text(encoding="utf-8")
    assert [place for place in ("/home/", "/root/", "/Users/", "C:\\") if place in text] == []


def folders():
    return sorted({path.parent for path in SOURCES})


FILES_A_FOLDER_MAX = 12
NAMED_ALIKE = {"__init__.py", "__main__.py"}


@pytest.mark.parametrize("folder", folders(), ids=name_of)
def test_a_folder_has_a_dozen_files_at_most(folder):
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= FILES_A_FOLDER_MAX


@pytest.mark.parametrize("folder", folders(), ids=name_of)
def test_every_folder_says_what_lives_there_and_what_it_may_touch(folder):
    told = ast.get_docstring(tree_of(folder / "__init__.py")) or ""
    assert len(re.findall(r"[.;](?:\s|$)", told)) >= 2, told


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


def assigned_elsewhere(tree):
    """Lines that assign an attribute of something that is neither their own object nor made there."""
    for function in ast.walk(tree):
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


def test_no_object_is_assigned_from_outside(source):
    """So a value has one writer, and who changes it is found in one place."""
    if name_of(source).startswith("sim/"):
        return
    known = ASSIGNED_ELSEWHERE.get(name_of(source), set())
    found = [what for owner, what in assigned_elsewhere(tree_of(source)) if owner not in known]
    assert found == []


# Elsewhere code asks a dialect for what follows from it, not which it is.
DIALECT_FILES = {
    "companion/service/doctor/parameter_checks.py",
    "companion/link/messages/flight_modes.py",
    "companion/flight/exchange/protocols.py",
    "companion/types/events.py",
}


def test_dialects_are_told_apart_in_four_files():
    asked = {
        name_of(path)
        for path in SOURCES
        for node in ast.walk(tree_of(path))
        if name_of(path).startswith("companion/")
        and isinstance(node, ast.Attribute)
        and ast.unparse(node) in ("Dialect.ARDUPILOT", "Dialect.PX4")
    }
    assert asked == DIALECT_FILES
