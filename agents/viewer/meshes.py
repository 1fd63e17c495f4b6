"""Meshes in the 3D view: each drawn once, and moved with its node."""

from __future__ import annotations

from collections.abc import Iterable

import rerun as rr

from agents.viewer import palette
from agents.viewer.model import BELIEF_FIRST, WORLD, Place, place_of
from agents.viewer.palette import Color
from agents.viewer.scene import ENTITY, transform
from dsr import Change, Memory, Mesh, Node, SchemaError, TransformError
from dsr.geometry import mesh_hashes

MESHES = f"{ENTITY}/meshes"


class MeshView:
    """Logs the meshes of nodes as soon as they are here."""

    def __init__(self, recording: rr.RecordingStream, memory: Memory) -> None:
        self._recording = recording
        self._memory = memory
        self._names: set[str] = set()
        self._drawn: dict[str, tuple[tuple[str, ...], Color]] = {}
        self._places: dict[str, Place] = {}

    def draw(self, changes: Iterable[Change]) -> set[str]:
        """Log what is not as it was before; returns the names of the nodes whose meshes are shown."""
        for name in {change.name for change in changes if change.element == "node"}:
            node = self._memory.get_node(name)
            if node is not None and "mesh" in node:
                self._names.add(name)
            else:
                self._names.discard(name)
        for name in sorted(self._drawn.keys() - self._names):
            self._clear(name)
        for name in sorted(self._names):
            self._draw(self._memory.get_node(name))
        return set(self._places)

    def _draw(self, node: Node | None) -> None:
        if node is None:
            return
        try:
            place = place_of(self._memory.transform(WORLD, node.name, types=BELIEF_FIRST))
            hashes = mesh_hashes(node)
        except (SchemaError, TransformError):
            self._clear(node.name)
            return
        look = (hashes, _color(node))
        if look != self._drawn.get(node.name):
            meshes = [mesh for hash in hashes if (mesh := self._memory.get_mesh(hash)) is not None]
            if len(meshes) < len(hashes):
                return
            self._clear(node.name)
            for number, mesh in enumerate(meshes):
                self._recording.log(f"{MESHES}/{node.name}/{number}", drawing(mesh, look[1]))
            self._drawn[node.name] = look
        if self._places.get(node.name) != place:
            self._places[node.name] = place
            self._recording.log(f"{MESHES}/{node.name}", transform(place))

    def _clear(self, name: str) -> None:
        if self._drawn.pop(name, None) is not None:
            self._recording.log(f"{MESHES}/{name}", rr.Clear(recursive=True))
        self._places.pop(name, None)


def drawing(mesh: Mesh, color: Color) -> rr.Mesh3D:
    """A mesh in one colour, shaded by the way its triangles face."""
    return rr.Mesh3D(vertex_positions=mesh.vertices, triangle_indices=mesh.triangles, albedo_factor=color)


def _color(node: Node) -> Color:
    color = node.get("color")
    if isinstance(color, tuple) and len(color) == 3:
        red, green, blue = (round(255 * min(max(part, 0.0), 1.0)) for part in color)
        return red, green, blue
    return palette.of_node(node.type)
