"""GLB files by trimesh, which is given nothing but the triangles of the file and their hierarchy.

It reads one piece for each primitive of a mesh, which has those of one material, and puts the pieces of a node with
several below it, under names of chance; here they are that node's.
"""

from __future__ import annotations

import struct
from collections import Counter
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from dsr.errors import MeshError
from dsr.geometry.model import MOST_NODES, Geometry, RawNode

_HEADER = struct.Struct("<4sIIII")
_MAGIC, _VERSION, _JSON = b"glTF", 2, 0x4E4F534A
_MOST_NUMBERS = 1 << 25
"""Elements of all accessors of triangles: several may show the same bytes."""
_MOST_JSON = 1 << 23
"""Bytes of the JSON of a file: each of its objects takes up to 60 times as much in memory."""
_MOST_PIECES = 20_000
"""Primitives of all nodes, each as often as a node has it: trimesh takes about 0.1 ms for one."""
_LIST, _STRIP, _FAN = 4, 5, 6  # modes of primitives that are triangles
_COMPRESSED = {"KHR_draco_mesh_compression": "Draco", "EXT_meshopt_compression": "meshopt"}
_BASE = "world"  # the frame that trimesh puts above all others

_Number = Annotated[int, msgspec.Meta(ge=0)]


class _Part(msgspec.Struct, rename="camel", omit_defaults=True):
    """Some of the properties of an object of glTF 2.0; the others are left out."""


class _Buffer(_Part):
    uri: str = "data:"


class _BufferView(_Part):
    buffer: _Number
    byte_length: _Number
    byte_offset: _Number = 0
    byte_stride: _Number | None = None


class _Accessor(_Part):
    component_type: _Number
    count: _Number
    type: str
    buffer_view: _Number | None = None
    byte_offset: _Number = 0
    normalized: bool = False
    sparse: dict[str, Any] | None = None


_NOTHING = _Accessor(component_type=5126, count=1, type="SCALAR")


class _Attributes(_Part, rename={"position": "POSITION"}):
    position: _Number


class _Primitive(_Part):
    attributes: _Attributes
    indices: _Number | None = None
    mode: _Number = _LIST


class _Mesh(_Part):
    primitives: list[_Primitive]


class _Node(_Part):
    name: str = ""
    children: list[_Number] = []
    mesh: _Number | None = None
    matrix: list[float] | None = None
    translation: list[float] | None = None
    rotation: list[float] | None = None
    scale: list[float] | None = None


class _Scene(_Part):
    nodes: list[_Number] = []


class _Content(_Part):
    """The JSON of a file."""

    buffers: list[_Buffer] = []
    buffer_views: list[_BufferView] = []
    accessors: list[_Accessor] = []
    meshes: list[_Mesh] = []
    nodes: list[_Node] = []
    scenes: list[_Scene] = []
    scene: _Number = 0
    extensions_required: list[str] = []
    extensions_used: list[str] = []


class _Edge(NamedTuple):
    """What trimesh says of a frame."""

    parent: str
    child: str
    matrix: np.ndarray
    """(4, 4) parent_from_child"""
    geometry: list[Geometry]


def read_glb(data: bytes) -> list[RawNode]:
    """The outermost nodes of a file, in its unit and orientation: metres, y up.

    Raises `MeshError`, and whatever msgspec and trimesh raise for a wrong file.
    """
    content, rest = _split(data)
    _check_cost(content)
    used = _check_readable(content)
    names = [node.name or str(index) for index, node in enumerate(content.nodes)]
    edges = _load(_joined(_plain(content, used), rest))
    raw = {str(index): RawNode(name if name != _BASE else f"{_BASE}_1") for index, name in enumerate(names)}
    base = RawNode("")
    below: set[str] = set()
    for edge in edges:
        parent = raw.get(edge.parent, base)
        node = raw.get(edge.child, parent)  # the frame of a primitive is that of the node that has it
        node.geometry += edge.geometry
        if node is not parent:
            node.matrix = edge.matrix
            if edge.child not in below:
                below.add(edge.child)
                parent.children.append(node)
    return base.children


def _split(data: bytes) -> tuple[_Content, bytes]:
    """The JSON of a file, and all chunks behind it."""
    if len(data) < _HEADER.size:
        raise MeshError(f"no valid GLB: {len(data)} bytes")
    magic, version, length, json_length, kind = _HEADER.unpack_from(data)
    if magic != _MAGIC or version != _VERSION or kind != _JSON:
        raise MeshError(f"no valid GLB: begins with {data[:4]!r}, version {version}; expected glTF 2.0")
    if length > len(data):
        raise MeshError(f"no valid GLB: cut off, {len(data)} of {length} bytes")
    if json_length > _MOST_JSON:
        raise MeshError(f"has {json_length} bytes of JSON; at most {_MOST_JSON} are read")
    end = _HEADER.size + json_length
    return msgspec.json.decode(data[_HEADER.size : end], type=_Content, strict=False), data[end:]


def _joined(content: _Content, rest: bytes) -> bytes:
    text = msgspec.json.encode(content)
    text += b" " * (-len(text) % 4)
    return _HEADER.pack(_MAGIC, _VERSION, _HEADER.size + len(text) + len(rest), len(text), _JSON) + text + rest


def _check_cost(content: _Content) -> None:
    """Raise `MeshError` for what would cost far more than the file is large, or lies in another file."""
    if any(not buffer.uri.startswith("data:") for buffer in content.buffers):
        raise MeshError("refers to other files; write it as one file")
    if len(content.nodes) > MOST_NODES:
        raise MeshError(f"more than {MOST_NODES} nodes")
    children = Counter(child for node in content.nodes for child in node.children)
    if children and max(children.values()) > 1:
        raise MeshError("no valid GLB: a node with two parents")  # glTF 2.0, section 3.5.2
    primitives = [len(content.meshes[node.mesh].primitives) for node in content.nodes if node.mesh is not None]
    if sum(primitives) + sum(len(mesh.primitives) for mesh in content.meshes) > _MOST_PIECES:
        raise MeshError(f"more than {_MOST_PIECES} primitives at its nodes")


def _check_readable(content: _Content) -> set[int]:
    """The accessors of triangles. Raises `MeshError` for triangles in a form of which trimesh would make others."""
    primitives = [one for mesh in content.meshes for one in mesh.primitives]
    positions = {one.attributes.position for one in primitives}
    used = positions | {one.indices for one in primitives if one.indices is not None}
    accessors = [content.accessors[index] for index in used]
    missing = any(accessor.buffer_view is None and accessor.sparse is None for accessor in accessors)
    for extension, name in _COMPRESSED.items():
        if extension in content.extensions_required or (missing and extension in content.extensions_used):
            raise MeshError(f"is compressed by {name}, which is not read; write it without compression")
    if missing:
        raise MeshError("no valid GLB: vertices or indices without data")
    if any(accessor.sparse is not None for accessor in accessors):
        raise MeshError("has vertices or indices as sparse accessors, which are not read; write them in full")
    if any(one.mode == _FAN for one in primitives):
        raise MeshError("has triangles as fans, which are not read; write them one by one")
    if any(content.accessors[index].normalized for index in positions):
        raise MeshError("has quantised vertices (normalized), which are not read; write them as floats")
    numbers = sum(accessor.count for accessor in accessors)
    if numbers > _MOST_NUMBERS:
        raise MeshError(f"{numbers} elements; at most {_MOST_NUMBERS}")
    return used


def _plain(content: _Content, used: set[int]) -> _Content:
    """Without what is no triangle, and without names, so that each node is known by its number.

    Accessors that are not in `used` stay without content: one without data stands for any number of zeros.
    """
    content.accessors = [each if index in used else _NOTHING for index, each in enumerate(content.accessors)]
    for mesh in content.meshes:
        mesh.primitives = [primitive for primitive in mesh.primitives if primitive.mode in (_LIST, _STRIP)]
    for node in content.nodes:
        node.name = ""
        if node.mesh is not None and not content.meshes[node.mesh].primitives:
            node.mesh = None
    return content


def _load(data: bytes) -> list[_Edge]:
    from trimesh.exchange.gltf import load_glb
    from trimesh.util import wrap_as_stream

    loaded = load_glb(wrap_as_stream(data), skip_materials=True, merge_primitives=False)
    pieces = {name: Geometry(piece["vertices"], piece["faces"]) for name, piece in loaded["geometry"].items()}
    return [
        _Edge(
            edge["frame_from"], edge["frame_to"], np.asarray(edge["matrix"], dtype=np.float64),
            [pieces[edge["geometry"]]] if "geometry" in edge else [],
        )
        for edge in loaded["graph"]
    ]  # fmt: skip
