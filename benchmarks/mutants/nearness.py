"""Which test files concern a module: in three stages, from those that are about it to those that play scenarios."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

STAGES = ("near", "package", "scenarios")


def stages(root: Path, path: str) -> tuple[list[str], list[str], list[str]]:
    """The test files of each stage for a source, both relative to `root`.

    Near are files that are named after the module or import it, `package` the others of its package, nearest folder
    first. No file is in two stages.
    """
    source = Path(path)
    folder = Path("tests", source.parts[0])
    files = sorted(file.relative_to(root) for file in (root / folder).rglob("test_*.py"))
    near = [file for file in files if _is_named_after(file, source)]
    near += [file for file in files if file not in near and _module(source) in _imported(root / file)]
    package = sorted((file for file in files if file not in near), key=lambda file: _steps(file, source))
    scenarios = sorted(file.relative_to(root) for file in (root / "tests/replay").rglob("test_*.py"))
    return _names(near), _names(package), _names(scenarios)


def _names(files: list[Path]) -> list[str]:
    return [file.as_posix() for file in files]


def _module(source: Path) -> str:
    parts = source.parent.parts if source.name == "__init__.py" else source.with_suffix("").parts
    return ".".join(parts)


def _is_named_after(file: Path, source: Path) -> bool:
    """Whether it has the module's name, in a folder that mirrors one around the module."""
    return file.stem == f"test_{source.stem}" and Path(*file.parts[1:]).parent in source.parents


def _steps(file: Path, source: Path) -> int:
    """How many folders only one of a module and a test file is in: tests need not mirror every folder."""
    return len({*source.parent.parts} ^ {*file.parent.parts[1:]})


@cache
def _imported(file: Path) -> frozenset[str]:
    """The modules that a file imports, and the names in them: `from a import b` may mean either."""
    found = set()
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)
