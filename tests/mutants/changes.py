"""Small changes of a program, one at a time: what a mutant is."""

import ast
import collections
import copy
from dataclasses import dataclass

OTHER = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
ORDERS = ast.Lt | ast.LtE | ast.Gt | ast.GtE
FUNCTIONS = ast.FunctionDef | ast.AsyncFunctionDef
DELETED = ast.Expr | ast.AugAssign | ast.Raise | ast.Continue | ast.Break | ast.Delete
TYPES = {"None", "int", "float", "str", "bytes", "bool", "dict", "list", "tuple"}
NOT_CHANGED = {"annotation", "returns", "decorator_list", "format_spec"}
LOGS = ("_log", "logging")


@dataclass
class Mutant:
    """A change of one file: a node of its tree is replaced.

    Attributes
    ----------
    name : str
        File, function, and the change.
    lines : tuple of int
        First and last line of what is changed; for an argument's default, of the function's body.
    names : tuple of str
        What a statement defines that runs when the module is imported; empty inside functions.
    """

    path: str
    name: str
    lines: tuple[int, int]
    names: tuple[str, ...]
    change: tuple

    def text(self):
        """The changed file."""
        tree, parent, field, index, before, after = self.change
        _put(parent, field, index, after)
        text = ast.unparse(ast.fix_missing_locations(tree))
        _put(parent, field, index, before)
        return text + "\n"


def _put(parent, field, index, node):
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def mutants_of(path, text):
    """All mutants of a file."""
    tree, times = ast.parse(text), collections.Counter()
    for place, where, names, after in _changes(tree, is_kernel="@kernel" in text or "@inlined" in text):
        parent, field, index, before = place
        name = f"{path}: {where.name}: {_one_line(before)} -> {_one_line(after)}"
        times[name] += 1
        is_default = field in {"defaults", "kw_defaults"} and where.body is not None
        yield Mutant(
            path,
            name if times[name] == 1 else f"{name} (number {times[name]})",
            where.body if is_default else (before.lineno, before.end_lineno),
            names,
            (tree, parent, field, index, before, after),
        )


def _one_line(node):
    return " ".join(ast.unparse(node).split())[:150]


@dataclass(frozen=True)
class _Function:
    """The innermost function or class around a node."""

    name: str
    body: tuple[int, int] | None = None  # First and last line, unless it runs when the module is imported.
    returns: str = ""

    def inner(self, node):
        name = node.name if self.name == "module" else f"{self.name}.{node.name}"
        if isinstance(node, ast.ClassDef):
            return _Function(name, self.body)
        return _Function(
            name, (node.body[0].lineno, node.end_lineno), node.returns and ast.unparse(node.returns)
        )


def _changes(node, *, is_kernel, where=_Function("module"), names=()):
    """All changes below a node: where it hangs, its function, what it defines, and what is put there."""
    for field, value in ast.iter_fields(node):
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if field in NOT_CHANGED or not isinstance(child, ast.AST) or _is_left_alone(child):
                continue
            inner, known = where, names
            if isinstance(child, FUNCTIONS | ast.ClassDef):
                inner = where.inner(child)
                known = (child.name,) if inner.body is None else ()
            elif where.body is None and isinstance(child, ast.Assign | ast.AnnAssign):
                known = tuple(
                    n.id for n in ast.walk(child) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
                )
            for after in (*_others(child, node), *_other_result(child, inner.returns, is_kernel)):
                yield (node, field, index, child), inner, known, ast.copy_location(after, child)
            yield from _changes(child, is_kernel=is_kernel, where=inner, names=known)


def _others(node, parent):
    """What a node may become."""
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            yield _with(node, ops=[*node.ops[:i], OTHER[type(op)](), *node.ops[i + 1 :]])
    elif isinstance(node, ast.BoolOp) or (_is_arithmetic(node) and not _is_put_together(node)):
        yield _with(node, op=OTHER[type(node.op)]())
    elif isinstance(node, ast.Constant):
        yield from _other_constants(node.value, parent)
    if isinstance(node, ast.If | ast.While | ast.IfExp):
        yield from (_with(node, test=test) for test in _negated(node.test))
    if isinstance(parent, ast.comprehension) and any(node is one for one in parent.ifs):
        yield from _negated(node)
    sets_an_attribute = isinstance(node, ast.Assign) and isinstance(
        node.targets[0], ast.Attribute | ast.Subscript
    )
    if (
        isinstance(node, DELETED)
        or sets_an_attribute
        or (isinstance(node, ast.Return) and node.value is None)
    ):
        yield ast.Pass()


def _is_arithmetic(node):
    return isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in OTHER


def _with(node, **fields):
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def _other_result(node, returns, is_kernel):
    """By the annotation; a kernel is not compiled with a result of another type."""
    if not isinstance(node, ast.Return) or node.value is None:
        return
    if returns == "bool":
        yield from (ast.Return(value) for value in _negated(node.value))
    elif returns in {"int", "float"}:
        yield ast.Return(ast.BinOp(node.value, ast.Add(), ast.Constant(1)))
    elif not is_kernel and ast.unparse(node.value) != "None":
        yield ast.Return(ast.Constant(None))


def _negated(node):
    """The opposite of a condition, unless another operator gives the same mutant."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and not isinstance(node.ops[0], ORDERS):
        return
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield node.operand
    else:
        yield ast.UnaryOp(ast.Not(), node)


def _other_constants(value, parent):
    if isinstance(value, bool):
        if isinstance(parent, ast.arguments | ast.AnnAssign | ast.Assign | ast.keyword):
            yield ast.Constant(not value)
    elif isinstance(value, int):
        yield ast.Constant(value + 1)
    elif isinstance(value, float):
        yield ast.Constant(value * 1.5 if value else 1.0)
    elif isinstance(value, str) and value and isinstance(parent, ast.arguments):
        yield ast.Constant("")


def _is_put_together(node):
    """Whether an operator joins texts, or types into a union."""
    sides = [node.value] if isinstance(node, ast.AugAssign) else [node.left, node.right]
    if any(isinstance(side, ast.JoinedStr) or _is_text(side) for side in sides):
        return True
    return isinstance(node.op, ast.BitOr) and all(_is_type(side) for side in sides)


def _is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)


def _is_type(node):
    if isinstance(node, ast.BinOp):
        return _is_type(node.left) and _is_type(node.right)
    name = ast.unparse(node).rpartition(".")[2].partition("[")[0]
    return name in TYPES or (name[:1].isupper() and not name.isupper())


def _is_left_alone(node):
    """Docstrings, logs, assertions, imports, ``__repr__``, and what is for type checkers only."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant) or _is_left_alone(node.value)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return isinstance(node.func.value, ast.Name) and node.func.value.id in LOGS
    if isinstance(node, ast.If):
        return any(word in ast.unparse(node.test) for word in ("TYPE_CHECKING", "__name__"))
    if isinstance(node, FUNCTIONS):
        return node.name in {"__repr__", "__str__"}
    return isinstance(node, ast.Assert | ast.Import | ast.ImportFrom)
