"""Every number that is set by hand in what reasons, with its meaning and unit, read off the sources.

    python -m benchmarks.hand_set_numbers
    python -m benchmarks.hand_set_numbers surprise planner --unexplained
    python -m benchmarks.hand_set_numbers --markdown > docs/reference/numbers.md

Such are named constants, defaults of configuration fields and of parameters, and numbers in expressions. Unit vectors
and zeros do not count: a field that begins with 0 says that there is nothing yet. Nor does a field that begins with a
probability of 1, which is certainty. In expressions and as defaults of parameters, 0, 1, 2, their halves and opposites,
and 1000 (mm in a m) do not count. Indices, sizes of arrays, seeds and digits do not count either, nor does the size of
a cache: what it forgets is worked out again. The meaning of a number is told beside it: in a string below, a comment
behind it, or one above the block.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

PACKAGES = (
    *("simulation_handler", "surprise", "planner", "agents/action_inference"),
    *("dsr/vocabulary/nats.py", "dsr/perception"),
)
"""Those that reason, and the files with the numbers that these share."""
_ROOT = Path(__file__).parents[1]
_TITLE = """# Numbers set by hand

All numbers that somebody chose in the packages that reason, by file. `python -m benchmarks.hand_set_numbers --markdown`
writes this page. A constant of one name means one thing."""
_PLAIN = {0.0, 0.5, 1.0, 2.0, 1000.0}
"""The last one converts m to mm."""
_SIZED = {
    *("eye", "zeros", "ones", "empty", "full", "reshape", "tile", "repeat"),
    *("range", "split", "round", "moveaxis", "chr"),
    *("default_rng", "standard_normal", "lru_cache"),
}
"""Functions that take sizes, places, seeds and digits rather than quantities."""
_CERTAIN = re.compile(r"1, (?:that|probability)\b")
"""How the meaning of a probability begins, whose unit is 1."""
_UNIT = re.compile(r"(m|mm|s|rad|kg|N|Hz|nats|px|m/s|rad/s|m/s\^2|m\^2|ms|MiB|bytes|%)\b")


@dataclass(frozen=True)
class Number:
    """A number that is set by hand."""

    file: str
    line: int
    name: str
    """Of the constant, field or parameter; empty for a number in an expression."""
    value: str
    """As it is written."""
    meaning: str
    """What is told beside it; empty if nothing is."""

    @property
    def unit(self) -> str:
        """The unit that its meaning begins with; empty if it begins with none."""
        found = _UNIT.match(self.meaning)
        return found[0] if found else ""


def numbers_in(file: Path) -> Iterator[Number]:
    """All of one source file, in the order of its lines."""
    text = file.read_text(encoding="utf-8")
    tree, comments, lines = ast.parse(text), _comments(text), text.splitlines()
    name = file.relative_to(_ROOT).as_posix()
    told: set[ast.AST] = set()
    for part in (part for part in ast.walk(tree) if isinstance(part, ast.Module | ast.ClassDef)):
        body = part.body
        for place, statement in enumerate(body):
            target, value = _assigned(statement)
            if target and value is not None and _counts(value):
                told.update(ast.walk(value))
                after = body[place + 1] if place + 1 < len(body) else None
                behind = comments.get(statement.end_lineno or statement.lineno, "")
                meaning = _text(after) or behind or _heading(lines, statement.lineno)
                if isinstance(part, ast.ClassDef) and _is_certainty(value, meaning):
                    continue
                yield Number(name, statement.lineno, target, ast.unparse(value), meaning)
    for node in ast.walk(tree):
        for parameter, default in _defaults(node):
            if default not in told and _counts(default) and not _is_plain(getattr(default, "value", None)):
                told.update(ast.walk(default))
                yield Number(name, default.lineno, parameter, ast.unparse(default), _told_of(node, parameter))
    told |= {part for node in ast.walk(tree) if _is_of_arrays(node) for part in ast.walk(node)}
    for node in ast.walk(tree):
        if node not in told and _is_set(node) and isinstance(node, ast.Constant) and not _is_plain(node.value):
            yield Number(name, node.lineno, "", repr(node.value), comments.get(node.lineno, ""))


def hand_set_numbers(packages: tuple[str, ...] = PACKAGES) -> list[Number]:
    """Those of these packages or files, by file and line. Raises `FileNotFoundError` for one that is not there."""
    found = []
    for package in packages:
        path = _ROOT / package
        if not path.exists():
            raise FileNotFoundError(f"{package}: no such package")
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            found += sorted(numbers_in(file), key=lambda number: number.line)
    return found


def as_markdown(numbers: Iterable[Number]) -> str:
    """A page with a table for each file, as in `docs/reference/numbers.md`."""
    by_file: dict[str, list[Number]] = {}
    for number in numbers:
        by_file.setdefault(number.file, []).append(number)
    lines = [_TITLE]
    for file, those in by_file.items():
        lines += [f"\n## {file}\n", "| name | value | unit | meaning |", "|---|---|---|---|"]
        for one in those:
            cells = (f"`{one.name}`" if one.name else "", f"`{one.value}`", one.unit, one.meaning)
            lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines) + "\n"


def _assigned(node: ast.stmt) -> tuple[str, ast.expr | None]:
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return node.target.id, node.value
    if isinstance(node, ast.Assign):
        return ", ".join(map(ast.unparse, node.targets)), node.value
    return "", None


def _defaults(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        places = [*node.args.posonlyargs, *node.args.args]
        if node.args.defaults:
            yield from zip([one.arg for one in places[-len(node.args.defaults) :]], node.args.defaults, strict=True)
        for one, default in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True):
            if default is not None:
                yield one.arg, default


def _is_set(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool)


def _counts(value: ast.expr) -> bool:
    """Whether an expression holds a number that somebody chose."""
    if any(isinstance(part, ast.Name) and part.id in ("Annotated", "__file__") for part in ast.walk(value)):
        return False
    sizes = {part for node in ast.walk(value) if _is_of_arrays(node) for part in ast.walk(node)}
    chosen = [part for part in ast.walk(value) if _is_set(part) and part not in sizes]
    values = [ast.literal_eval(part) for part in chosen]
    is_vector = not isinstance(value, ast.Constant | ast.UnaryOp)
    return any(values) and not (is_vector and all(map(_is_plain, values)))


def _is_certainty(value: ast.expr, meaning: str) -> bool:
    """Whether a field begins with a probability of 1."""
    return isinstance(value, ast.Constant) and value.value == 1.0 and bool(_CERTAIN.match(meaning))


def _heading(lines: list[str], number: int) -> str:
    """The comment above the block of lines that line `number` is in, counted from 1."""
    for line in reversed(lines[: number - 1]):
        if line.startswith("# "):
            return line.lstrip("# ")
        if not line.strip() or line[0] in ' "':
            return ""
    return ""


def _is_of_arrays(node: ast.AST) -> bool:
    """Whether whole numbers in it are indices, or sizes of arrays."""
    if isinstance(node, ast.Call):
        return ast.unparse(node.func).rpartition(".")[2] in _SIZED
    if isinstance(node, ast.Compare):
        return any(re.match(r"len\(|.*\.(shape|ndim)$", ast.unparse(side)) for side in (node.left, *node.comparators))
    return isinstance(node, ast.Subscript)


def _is_plain(value: object) -> bool:
    return isinstance(value, int | float) and abs(value) in _PLAIN


def _text(node: ast.stmt | None) -> str:
    """The string that a statement is, on one line."""
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return " ".join(node.value.value.split())
    return ""


def _told_of(node: ast.AST, parameter: str) -> str:
    """What the docstring of a function says of a parameter."""
    text = ast.get_docstring(node) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) else None
    found = re.search(rf"^ +{parameter}: (.+(?:\n {{8,}}.+)*)", text or "", re.MULTILINE)
    return " ".join(found[1].split()) if found else ""


def _comments(text: str) -> dict[int, str]:
    """The comments of a source, by line; what is meant for tools is left out."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    found = {token.start[0]: token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT}
    return {line: comment for line, comment in found.items() if not comment.startswith(("fmt:", "noqa", "type:"))}


def main() -> None:
    """Print what the command line asks for."""
    parser = argparse.ArgumentParser(
        "python -m benchmarks.hand_set_numbers",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("package", nargs="*", default=PACKAGES, help=f"folders; default: {' '.join(PACKAGES)}")
    parser.add_argument("--unexplained", action="store_true", help="only those of which nothing is told")
    parser.add_argument("--markdown", action="store_true", help="as a table of Markdown")
    options = parser.parse_args()
    try:
        found = hand_set_numbers(tuple(options.package))
    except FileNotFoundError as error:
        parser.error(str(error))
    shown = [number for number in found if not (options.unexplained and number.meaning)]
    if options.markdown:
        print(as_markdown(shown), end="")
        return
    rows = [(f"{n.file}:{n.line}", n.name, n.value, n.unit, n.meaning) for n in shown]
    headings = ("where", "name", "value", "unit", "meaning")
    table = Table(*headings, title=f"{len(shown)} of {len(found)} numbers that are set by hand")
    for row in rows:
        table.add_row(*row)
    console = Console()
    console.print(table)
    packages = Counter(number.file.split("/")[0] for number in found)
    named = sum(bool(number.name) for number in found)
    told = sum(bool(number.meaning) for number in found)
    by_package = ", ".join(f"{package} {count}" for package, count in packages.items())
    console.print(f"{by_package}; {named} have a name, of {told} it is told what they mean")


if __name__ == "__main__":
    main()
