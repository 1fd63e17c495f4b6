"""Passes on things by their names."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase

from dsr import main
from dsr.graph.elements import Node
from dsr.worlds import Filter, FilterConfig


class ByNameConfig(FilterConfig, frozen=True, forbid_unknown_fields=True):
    """Patterns of names; `*`, `?` and `[abc]` as in the shell."""

    names: tuple[str, ...] = ()
    """Patterns of those that are passed on; all if empty."""
    leave_out: tuple[str, ...] = ()
    """Patterns of those that are not, whatever `names` says."""


class ByName(Filter):
    """Passes on the nodes with some names, and the edges between them."""

    name = "by_name"
    Config = ByNameConfig
    config: ByNameConfig

    def accepts(self, node: Node) -> bool:
        """Accept a node by its name."""
        config = self.config
        return not _matches(node.name, config.leave_out) and (not config.names or _matches(node.name, config.names))


def _matches(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


if __name__ == "__main__":
    main(ByName)
