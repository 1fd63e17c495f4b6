"""Draws docstrings and sentences at random, to judge how they read, and lists sentences that are too long.

    python -m benchmarks.sample_words docstrings --seed 1
    python -m benchmarks.sample_words sentences --seed 1 --count 20
    python -m benchmarks.sample_words long

`docstrings` shows public docstrings of the packages with their place and signature, but without the code. Ask of each:
can a newcomer use the thing without reading its body? Meaning, shape, unit and frame must be told.
`sentences` shows sentences of README.md, ARCHITECTURE.md and docs. The same seed draws the same from the same files.
`long` shows every sentence of more than 25 words of these files and CHANGELOG.md, and exits with 1 if there is one.
A sentence counts to its full stop. A semicolon or colon does not end it; a list, code and a table's cell do.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from benchmarks.sentences import Sentence, sentences

PACKAGES = ("dsr", "agents", "simulation_handler", "surprise", "planner")
"""Those whose docstrings are drawn."""
LONGEST = 25
"""Words that a sentence may have: longer ones are read twice."""
_FEWEST = 5
"""Words that a sentence must have to be drawn: shorter cells of tables are labels and figures."""
_ROOT = Path(__file__).parents[1]

T = TypeVar("T")


@dataclass(frozen=True)
class Docstring:
    """A docstring and the thing that it describes."""

    file: str
    """Relative to the root of the project."""
    line: int
    """The line in which the thing begins, without decorators, counted from 1."""
    signature: str
    """As in the source, without the body; a field with its type, without its value."""
    text: str


def documents() -> list[Path]:
    """Find README.md, ARCHITECTURE.md and the pages below docs, as absolute paths, in this order."""
    return [_ROOT / "README.md", _ROOT / "ARCHITECTURE.md", *sorted(_ROOT.glob("docs/**/*.md"))]


def public_docstrings(packages: tuple[str, ...] = PACKAGES) -> list[Docstring]:
    """Collect the docstrings of all public modules, classes, functions, methods and attributes, by file and line."""
    files = [file for package in packages for file in sorted((_ROOT / package).rglob("*.py"))]
    return [found for file in files for found in docstrings_in(file)]


def docstrings_in(file: Path) -> Iterator[Docstring]:
    """Yield the public docstrings of one source file, which must be below the root, in the order of its lines."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    name = file.relative_to(_ROOT).as_posix()
    text = ast.get_docstring(tree)
    if text:
        yield Docstring(name, 1, f"module {name}", text)
    yield from _members(name, tree, "")


def long_sentences(document: Path) -> list[Sentence]:
    """Find the sentences of a Markdown file that have more than `LONGEST` words."""
    return [one for one in sentences(document.read_text(encoding="utf-8")) if one.words > LONGEST]


def _members(file: str, owner: ast.Module | ast.ClassDef, path: str) -> Iterator[Docstring]:
    following = [*owner.body[1:], None]
    for node, after in zip(owner.body, following, strict=True):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            text = ast.get_docstring(node)
            if text:
                yield Docstring(file, node.lineno, _signature(node, path), text)
            if isinstance(node, ast.ClassDef):
                yield from _members(file, node, f"{path}{node.name}.")
        target = _target(node)
        if target and not target.startswith("_") and isinstance(after, ast.Expr):
            value = after.value
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                kind = f": {ast.unparse(node.annotation)}" if isinstance(node, ast.AnnAssign) else ""
                yield Docstring(file, node.lineno, f"{path}{target}{kind}", inspect.cleandoc(value.value))


def _target(node: ast.stmt) -> str:
    if isinstance(node, ast.AnnAssign):
        return ast.unparse(node.target)
    return ", ".join(map(ast.unparse, node.targets)) if isinstance(node, ast.Assign) else ""


def _signature(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef, path: str) -> str:
    decorators = "".join(f"@{ast.unparse(one)} " for one in node.decorator_list)
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(map(ast.unparse, [*node.bases, *(one.value for one in node.keywords)]))
        return f"{decorators}class {path}{node.name}({bases})"
    result = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"{decorators}def {path}{node.name}({ast.unparse(node.args)}){result}"


def _drawn(found: list[T], count: int, seed: int) -> list[T]:
    """`count` of them, or all if there are fewer, in random order."""
    order = np.random.default_rng(seed).permutation(len(found))
    return [found[index] for index in order[:count]]


def _show_docstrings(seed: int, count: int) -> int:
    found = public_docstrings()
    drawn = _drawn(found, count, seed)
    for number, one in enumerate(drawn, 1):
        text = one.text.replace("\n", "\n    ")
        print(f"{number}. {one.file}:{one.line}\n    {one.signature}\n    {text}\n")
    print(f"{len(drawn)} of {len(found)} public docstrings")
    return 0


def _show_sentences(seed: int, count: int) -> int:
    found = [(file, one) for file in documents() for one in sentences(file.read_text(encoding="utf-8"))]
    found = [(file, one) for file, one in found if one.words >= _FEWEST]
    drawn = _drawn(found, count, seed)
    for number, (file, one) in enumerate(drawn, 1):
        print(f"{number}. {file.relative_to(_ROOT)}:{one.line} ({one.words} words)\n    {one.text}\n")
    print(f"{len(drawn)} of {len(found)} sentences")
    return 0


def _show_long() -> int:
    files = [*documents(), _ROOT / "CHANGELOG.md"]
    found = [(file.relative_to(_ROOT), long_sentences(file)) for file in files]
    for name, those in found:
        for one in those:
            print(f"{name}:{one.line}: {one.words} words: {one.text}")
    counts = ", ".join(f"{name} {len(those)}" for name, those in found if those)
    total = sum(len(those) for _, those in found)
    print(f"{total} sentences of more than {LONGEST} words{': ' if total else ''}{counts}")
    return 1 if total else 0


def main(arguments: list[str] | None = None) -> int:
    """Print what the command line (or `arguments`) asks for, and return the exit code."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.sample_words",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for name, count, told in (
        ("docstrings", 60, "draw public docstrings, each with its place and signature"),
        ("sentences", 40, "draw sentences of README.md, ARCHITECTURE.md and docs"),
    ):
        drawing = commands.add_parser(name, help=told, description=f"{told.capitalize()}.")
        drawing.add_argument("--seed", type=int, required=True, help="a whole number; the same one draws the same")
        drawing.add_argument("--count", type=int, default=count, help="how many are drawn (default: %(default)s)")
    told = f"list sentences of more than {LONGEST} words; exit with 1 if there are any"
    commands.add_parser("long", help=told, description=f"{told.capitalize()}.")
    options = parser.parse_args(arguments)
    if options.command == "long":
        return _show_long()
    if options.count < 1:
        parser.error("--count must be at least 1")
    return (_show_docstrings if options.command == "docstrings" else _show_sentences)(options.seed, options.count)


if __name__ == "__main__":
    sys.exit(main())
