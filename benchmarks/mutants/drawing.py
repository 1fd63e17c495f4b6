"""Draws mutants: single small changes of statements in functions, at exact places of the sources.

Left alone are docstrings, annotations, all strings, calls that log or print, whatever is raised or asserted, functions
that only describe an object, and what is for type checkers.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

Function = ast.FunctionDef | ast.AsyncFunctionDef
Node = TypeVar("Node", bound=ast.AST)
_FLIPPED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_MOVED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt,
}  # fmt: skip
_SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.MatMult: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitOr,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift,
}  # fmt: skip
_EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax",
             "argmax": "argmin", "fmin": "fmax", "fmax": "fmin"}  # fmt: skip
_ORDERLESS = {*_EXTREMES, "isinstance", "issubclass", "hasattr", "getattr", "setattr", "isclose", "allclose"}
"""Calls whose arguments are not swapped: nothing would change, or nothing would run at all."""
_LEVELS = {"debug", "info", "warning", "error", "exception", "critical", "log"}
_PRINTING = {"print", "echo"}
_DESCRIBING = {"__repr__", "__str__"}


@dataclass(frozen=True)
class Mutant:
    """One change of one statement."""

    path: str
    """Of the source, relative to the root."""
    line: int
    column: int
    """Where it is, as editors count: both from 1, the column in characters."""
    kind: str
    function: int
    """The first line of the innermost function around it, decorators included, as its code object tells it."""
    begin: int
    end: int
    """What is replaced, in bytes of the file."""
    replacement: str
    diff: str
    """The change on one line."""

    @property
    def name(self) -> str:
        """What identifies it within a source tree."""
        return f"{self.path}:{self.line}:{self.column}:{self.kind}"

    def applied(self, source: bytes) -> bytes:
        """The source with the change."""
        return source[: self.begin] + self.replacement.encode() + source[self.end :]


def draw(root: Path, packages: tuple[str, ...], seed: int, count: int) -> list[Mutant]:
    """At most one mutant of each statement, of statements that are drawn uniformly.

    With a greater count, what a smaller one draws comes first. There are fewer if the packages have fewer statements.
    Raises `FileNotFoundError` for a package that is not there.
    """
    chance = np.random.default_rng(seed)
    places = [of_statement for path in _sources(root, packages) for of_statement in by_statement(root, path)]
    order = chance.permutation(len(places))[:count]
    return [places[place][chance.integers(len(places[place]))] for place in order]


def every(root: Path, packages: tuple[str, ...]) -> dict[str, Mutant]:
    """All possible mutants by their name. Raises `FileNotFoundError` for a package that is not there."""
    sources = _sources(root, packages)
    return {one.name: one for path in sources for of_statement in by_statement(root, path) for one in of_statement}


def by_statement(root: Path, path: str) -> Iterator[list[Mutant]]:
    """The mutants of each statement in a source's functions; statements without any are left out."""
    source = (root / path).read_bytes()
    text = _Text(source, path)
    for function, statement in _statements(ast.parse(source)):
        first = min([function.lineno, *(decorator.lineno for decorator in function.decorator_list)])
        found: dict[str, Mutant] = {}
        for change in _changes(statement):
            mutant = text.mutant(change, first)
            found.setdefault(mutant.name, mutant)
        if found:
            yield list(found.values())


def _sources(root: Path, packages: tuple[str, ...]) -> list[str]:
    for package in packages:
        if not (root / package).is_dir():
            raise FileNotFoundError(f"{package}: no such package")
    files = {file for package in packages for file in (root / package).rglob("*.py")}
    return sorted(file.relative_to(root).as_posix() for file in files)


@dataclass(frozen=True)
class _Change:
    """A node of the tree, and what stands in its place."""

    kind: str
    old: ast.expr | ast.stmt
    new: ast.expr | ast.stmt
    place: ast.expr | ast.stmt
    """What is told as its place: an operator's is what stands behind it."""


class _Text:
    """A source in bytes, by lines and columns."""

    def __init__(self, source: bytes, path: str) -> None:
        self._source = source
        self._path = path
        self._begins = [0]
        for line in source.splitlines(keepends=True):
            self._begins.append(self._begins[-1] + len(line))

    def mutant(self, change: _Change, function: int) -> Mutant:
        """The change as text."""
        old, place = change.old, change.place
        assert old.end_lineno is not None and old.end_col_offset is not None
        begin = self._begins[old.lineno - 1] + old.col_offset
        end = self._begins[old.end_lineno - 1] + old.end_col_offset
        written = ast.unparse(change.new)
        written = f"({written})" if isinstance(change.new, ast.expr) and not _is_closed(change.new) else written
        before = self._source[self._begins[place.lineno - 1] :][: place.col_offset].decode()
        return Mutant(
            path=self._path, line=place.lineno, column=len(before) + 1, kind=change.kind, function=function,
            begin=begin, end=end, replacement=written, diff=self._diff(begin, end, written),
        )  # fmt: skip

    def _diff(self, begin: int, end: int, written: str) -> str:
        head = self._source.rfind(b"\n", 0, begin) + 1
        tail = self._source.find(b"\n", end)
        whole = self._source[head : tail if tail >= 0 else None].decode()
        changed = self._source[head:begin].decode() + written + self._source[end : max(tail, end)].decode()
        return f"- {' '.join(whole.split())}  + {' '.join(changed.split())}"


def _is_closed(node: ast.expr) -> bool:
    """Whether it may stand anywhere without parentheses."""
    return isinstance(node, ast.Name | ast.Attribute | ast.Call | ast.Constant)


def _statements(tree: ast.AST, function: Function | None = None) -> Iterator[tuple[Function, ast.stmt]]:
    """Each statement within functions, with the innermost function around it."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Function):
            if node.name not in _DESCRIBING:
                yield from _statements(node, node)
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if function is not None and isinstance(node, ast.stmt) and not isinstance(node, ast.ClassDef):
            yield function, node
        yield from _statements(node, function)


def _changes(statement: ast.stmt) -> Iterator[_Change]:
    """All changes of a statement without the statements in it."""
    if isinstance(statement, ast.Raise | ast.Assert | ast.Import | ast.ImportFrom | ast.Global | ast.Nonlocal):
        return
    if _is_deletable(statement):
        yield _Change("delete", statement, ast.Pass(), statement)
    if isinstance(statement, ast.Return) and not _is_none(statement.value):
        yield _Change("return-none", statement, ast.Return(ast.Constant(None)), statement)
    if isinstance(statement, ast.If | ast.While):
        for old, new, place in _negated(statement.test):
            yield _Change("negate", old, new, place)
    if isinstance(statement, ast.AugAssign) and not _is_text(statement.value):
        yield _Change("operator", statement, _with(statement, op=_SWAPPED[type(statement.op)]()), statement.value)
    for field, value in ast.iter_fields(statement):
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.AST) and not isinstance(part, ast.stmt) and field != "annotation":
                yield from _within(part)


def _within(node: ast.AST) -> Iterator[_Change]:
    """All changes of an expression and what it is made of."""
    if isinstance(node, ast.stmt | ast.JoinedStr) or _is_telling(node):
        return
    for kind, change in _KINDS:
        for old, new, place in change(node):
            yield _Change(kind, old, new, place)
    of_types = isinstance(node, ast.Call) and _called(node) in ("isinstance", "issubclass", "cast")
    for child in ast.iter_child_nodes(node):
        if not (of_types and _is_type(child)):
            yield from _within(child)


Replacements = Iterator[tuple[ast.expr, ast.expr, ast.expr]]


def _comparisons(other: dict[type[ast.cmpop], type[ast.cmpop]]) -> Callable[[ast.AST], Replacements]:
    def changed(node: ast.AST) -> Replacements:
        if isinstance(node, ast.Compare):
            for number, operator in enumerate(node.ops):
                if type(operator) in other:
                    ops = [*node.ops[:number], other[type(operator)](), *node.ops[number + 1 :]]
                    yield node, _with(node, ops=ops), node.comparators[number]

    return changed


def _arithmetic(node: ast.AST) -> Replacements:
    if isinstance(node, ast.BinOp) and not any(_is_text(side) for side in (node.left, node.right)):
        yield node, _with(node, op=_SWAPPED[type(node.op)]()), node.right


def _logic(node: ast.AST) -> Replacements:
    if isinstance(node, ast.BoolOp):
        yield node, _with(node, op=ast.And() if isinstance(node.op, ast.Or) else ast.Or()), node.values[1]


def _conditions(node: ast.AST) -> Replacements:
    """Those within expressions; those of `if` and `while` belong to their statement."""
    tests = [node.test] if isinstance(node, ast.IfExp) else node.ifs if isinstance(node, ast.comprehension) else []
    for test in tests:
        yield from _negated(test)


def _negated(test: ast.expr) -> Replacements:
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        yield test, test.operand, test
    elif not isinstance(test, ast.Compare | ast.Constant):
        yield test, ast.UnaryOp(ast.Not(), test), test


def _numbers(new: Callable[[float], float]) -> Callable[[ast.AST], Replacements]:
    def changed(node: ast.AST) -> Replacements:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
            value = type(node.value)(new(node.value))
            if value != node.value:
                yield node, ast.Constant(value), node

    return changed


def _extremes(node: ast.AST) -> Replacements:
    if isinstance(node, ast.Call):
        if isinstance(node.func, ast.Name) and node.func.id in _EXTREMES:
            yield node.func, ast.Name(_EXTREMES[node.func.id]), node.func
        elif isinstance(node.func, ast.Attribute) and node.func.attr in _EXTREMES:
            yield node.func, _with(node.func, attr=_EXTREMES[node.func.attr]), node.func


def _arguments(node: ast.AST) -> Replacements:
    if isinstance(node, ast.Call) and len(node.args) > 1 and _called(node) not in _ORDERLESS:
        first, second, *others = node.args
        is_starred = isinstance(first, ast.Starred) or isinstance(second, ast.Starred)
        if not is_starred and ast.dump(first) != ast.dump(second):
            yield node, _with(node, args=[second, first, *others]), first


_KINDS: tuple[tuple[str, Callable[[ast.AST], Replacements]], ...] = (
    ("flip", _comparisons(_FLIPPED)),
    ("boundary", _comparisons(_MOVED)),
    ("operator", _arithmetic),
    ("and-or", _logic),
    ("negate", _conditions),
    ("double", _numbers(lambda number: number * 2)),
    ("plus-one", _numbers(lambda number: number + 1)),
    ("zero", _numbers(lambda _: 0)),
    ("min-max", _extremes),
    ("swap-arguments", _arguments),
)


def _with(node: Node, **fields: object) -> Node:
    """The node with other fields."""
    other = copy.copy(node)
    for field, value in fields.items():
        setattr(other, field, value)
    return other


def _called(call: ast.Call) -> str:
    """The last part of the name of what is called."""
    return ast.unparse(call.func).rpartition(".")[2]


def _is_telling(node: ast.AST) -> bool:
    """Whether it is a call that only tells something to people."""
    if not isinstance(node, ast.Call):
        return False
    owner = ast.unparse(node.func.value) if isinstance(node.func, ast.Attribute) else ""
    return _called(node) in _PRINTING or (_called(node) in _LEVELS and owner.rpartition(".")[2].lstrip("_") == "log")


def _is_deletable(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.Expr):
        return isinstance(statement.value, ast.Call) and not _is_telling(statement.value)
    if isinstance(statement, ast.AnnAssign):
        return statement.value is not None
    return isinstance(statement, ast.Assign | ast.AugAssign)


def _is_none(value: ast.expr | None) -> bool:
    return value is None or (isinstance(value, ast.Constant) and value.value is None)


def _is_type(node: ast.AST) -> bool:
    """Whether it is a union of types, as calls that ask for types have it."""
    return isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes))
