"""The source as text and as syntax trees, for tests that read it; a file is parsed once a process."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for tree in ("companion", "sim") for path in (ROOT / tree).rglob("*.py"))
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef


def name_of(path):
    return path.relative_to(ROOT).as_posix()


@functools.cache
def text_of(path):
    return path.read_text(encoding="utf-8")


@functools.cache
def tree_of(path):
    return ast.parse(text_of(path), filename=str(path))


@functools.cache
def nodes_of(path):
    """All nodes of a file's tree."""
    return tuple(ast.walk(tree_of(path)))


def found_in(sources, rule):
    """What breaks a rule, by file; empty where the sources keep it."""
    return {name_of(path): broken for path in sources if (broken := rule(path))}
