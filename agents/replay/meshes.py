"""Which meshes a replayed graph names that nobody has."""

from __future__ import annotations

import contextlib

from dsr.errors import SchemaError
from dsr.geometry import mesh_hashes
from dsr.memory import Memory


class MeshCheck:
    """Follows the nodes of a graph, and knows which of their meshes are not here.

    Args:
        memory: of the replay.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._watch = memory.watch(attribute="mesh")
        self._named: dict[str, str] = {}

    def missing(self) -> dict[str, str]:
        """The name of a node by each hash that was ever named and is not here; they are asked for."""
        for change in self._watch.poll():
            node = self._memory.get_node(change.name) if change.element == "node" else None
            with contextlib.suppress(SchemaError):  # what it says are no hashes
                self._named.update({} if node is None else dict.fromkeys(mesh_hashes(node), node.name))
        self._named = {hash: name for hash, name in self._named.items() if self._memory.get_mesh(hash) is None}
        return dict(self._named)
