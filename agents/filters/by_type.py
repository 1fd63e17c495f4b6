"""Passes on things of some types."""

from __future__ import annotations

from dsr import main
from dsr.graph.elements import Node
from dsr.worlds import Filter, FilterConfig


class ByTypeConfig(FilterConfig, frozen=True, forbid_unknown_fields=True):
    """Node types that are passed on, or not."""

    types: tuple[str, ...] = ()
    """Node types that are passed on; all if empty."""
    leave_out: tuple[str, ...] = ()
    """Node types that are not passed on, whatever `types` says."""


class ByType(Filter):
    """Passes on the nodes of some types, and the edges between them."""

    name = "by_type"
    Config = ByTypeConfig
    config: ByTypeConfig

    def setup(self) -> None:
        """Check the names. Raises `SchemaError`."""
        super().setup()
        for name in (*self.config.types, *self.config.leave_out):
            self.memory.schema.check_node("any", name)

    def accepts(self, node: Node) -> bool:
        """Accept a node by its type."""
        return node.type not in self.config.leave_out and (not self.config.types or node.type in self.config.types)


if __name__ == "__main__":
    main(ByType)
