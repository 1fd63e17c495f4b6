"""Writes the meshes that nodes name to a recording, each once a file."""

from __future__ import annotations

import contextlib

from agents.recorder.channels import MESH
from agents.recorder.mcap_file import RecordedMessage, RecordingWriter
from dsr.errors import SchemaError
from dsr.geometry import mesh_hashes
from dsr.memory import Memory


class MeshRecorder:
    """Asks for the meshes of all nodes, and writes them.

    Args:
        memory: where the nodes are.
        writer: of the recording.
    """

    def __init__(self, memory: Memory, writer: RecordingWriter) -> None:
        self._memory = memory
        self._writer = writer
        self._watch = memory.watch(attribute="mesh")
        self._wanted: set[str] = set()
        self._written: set[str] = set()

    def update(self, now: float) -> None:
        """Write what has come by `now` (s); what nobody has yet is asked for again, less and less often."""
        for change in self._watch.poll():
            node = self._memory.get_node(change.name) if change.element == "node" else None
            with contextlib.suppress(SchemaError):  # what it says are no hashes
                self._wanted.update({} if node is None else set(mesh_hashes(node)) - self._written)
        for hash in sorted(self._wanted):
            mesh = self._memory.get_mesh(hash)
            if mesh is not None:
                self._writer.write(RecordedMessage(now, MESH, bytes(mesh.data)))
                self._wanted.discard(hash)
                self._written.add(hash)

    def close(self) -> None:
        """Watch no more."""
        self._watch.close()
