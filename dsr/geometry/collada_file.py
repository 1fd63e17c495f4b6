"""COLLADA files by pycollada: the nodes with their names and matrices, which trimesh would leave out."""

from __future__ import annotations

import io
import math
import re
from typing import Any, Literal

import collada
import numpy as np

from dsr.errors import MeshError
from dsr.geometry.model import MOST_NODES, Geometry, RawNode

_MOST_ELEMENTS = 1 << 21
"""Begins and ends of XML elements in a file: each takes about 100 bytes in memory."""
_DECLARATION = re.compile(r"^\s*<\?xml[^>]*\?>")
_MOST_DEPTH = 200
_MOST_WARNINGS = 20


def read_collada(text: str) -> tuple[list[RawNode], float, Literal["x", "y", "z"], tuple[str, ...]]:
    """Outermost nodes, metres of one unit, the axis that points upwards, and what could not be used.

    Raises `MeshError`, and whatever pycollada raises for a wrong file.
    """
    # Without these, nothing is expanded or fetched; the parser must not read the text in yet another encoding.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise MeshError("no valid COLLADA: expected plain XML without DOCTYPE")
    if text.count("<") > _MOST_ELEMENTS:
        raise MeshError(f"more than {_MOST_ELEMENTS} elements")
    ignored = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]
    document = collada.Collada(io.BytesIO(_DECLARATION.sub("", text, count=1).encode()), ignore=ignored)
    if document.scene is None:
        raise MeshError("no valid COLLADA: it names no scene")
    reader = _Reader()
    tops = [raw for node in document.scene.nodes for raw in reader.nodes(node)]
    warnings = tuple(" ".join(str(error).split())[:200] for error in document.errors[:_MOST_WARNINGS])
    up = {"X_UP": "x", "Z_UP": "z"}.get(str(document.assetInfo.upaxis), "y")
    unit = 1.0 if document.assetInfo.unitmeter is None else float(document.assetInfo.unitmeter)
    if not 0.0 < unit < math.inf:
        raise MeshError(f"no valid COLLADA: a unit of {unit} m")
    return tops, unit, up, warnings  # type: ignore[return-value]


class _Reader:
    def __init__(self) -> None:
        self._count = 0
        self._pieces: dict[int, list[Geometry]] = {}

    def nodes(self, node: Any, depth: int = 0) -> list[RawNode]:
        """What a node of the scene is in ours: one, or none for lights and cameras."""
        self._count += 1
        if self._count > MOST_NODES or depth > _MOST_DEPTH:
            raise MeshError(f"more than {MOST_NODES} nodes, or {_MOST_DEPTH} levels")
        if isinstance(node, collada.scene.NodeNode):
            return self.nodes(node.node, depth + 1)
        if not isinstance(node, collada.scene.Node):
            return []
        raw = RawNode(str(node.name or node.id or ""), np.asarray(node.matrix, dtype=np.float64))
        for child in node.children:
            if isinstance(child, collada.scene.GeometryNode):
                raw.geometry += self._geometry(child.geometry)
            else:
                raw.children += self.nodes(child, depth + 1)
        return [raw]

    def _geometry(self, geometry: Any) -> list[Geometry]:
        """All triangles of a geometry as one piece; lines are left out."""
        if id(geometry) not in self._pieces:
            self._pieces[id(geometry)] = _pieces(geometry)
        return self._pieces[id(geometry)]


def _pieces(geometry: Any) -> list[Geometry]:
    vertices, triangles, count = [], [], 0
    for primitive in geometry.primitives:
        found = primitive.triangleset() if isinstance(primitive, collada.polylist.Polylist) else primitive
        if isinstance(found, collada.triangleset.TriangleSet) and found.vertex is not None and len(found.vertex_index):
            vertices.append(np.asarray(found.vertex, dtype=np.float64).reshape(-1, 3))
            triangles.append(np.asarray(found.vertex_index, dtype=np.int64).reshape(-1, 3) + count)
            count += len(vertices[-1])
    return [Geometry(np.concatenate(vertices), np.concatenate(triangles))] if vertices else []
