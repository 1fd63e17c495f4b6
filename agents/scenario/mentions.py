"""What must be consistent about the names that expectations mention, so that none holds for a typo."""

from __future__ import annotations

from collections.abc import Collection

from agents.scenario.expectations import Check, Edges
from agents.scenario.inconsistency import require
from dsr.errors import suggest
from dsr.runtime.toml_lines import Path
from dsr.schema import Schema

_SCHEMA = Schema()


def check_mentions(check: Check, path: Path) -> None:
    """The working memory may hold what an expectation is about."""
    if isinstance(check, Edges):
        _require_known("edge type", check.type, _SCHEMA.edge_types, (*path, "type"))


def _require_known(what: str, name: str, known: Collection[str], path: Path) -> None:
    require(name in known, path, f"unknown {what} {name!r}; {suggest(name, known)}")
