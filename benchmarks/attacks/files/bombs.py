"""The hostile files themselves, made on request; each is small beside what it would unpack to."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import zstandard

GIB = 1 << 30
_TRIANGLE_OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
_TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)


class Bomb(NamedTuple):
    """One hostile file."""

    name: str
    """With the ending that tells its reader."""
    sentence: str
    make: Callable[[], bytes]


def _mcap_record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def _mcap(*records: bytes) -> bytes:
    text = struct.pack("<I", 3) + b"dsr"
    return b"\x89MCAP0\r\n" + _mcap_record(0x01, text + text) + b"".join(records)


def _chunk(data: bytes, size: int, compression: bytes = b"zstd") -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(compression)) + compression
    return _mcap_record(0x06, head + struct.pack("<Q", len(data)) + data)


def _mcap_chunk() -> bytes:
    compressor = zstandard.ZstdCompressor(level=3).compressobj(size=4 * GIB)
    zeros = bytes(1 << 24)
    packed = [compressor.compress(zeros) for _ in range(4 * GIB // len(zeros))]
    return _mcap(_chunk(b"".join([*packed, compressor.flush()]), 4 * GIB))


def _mcap_liar() -> bytes:
    return _mcap(_chunk(zstandard.compress(bytes(1 << 28)), 1000))


def _mcap_records() -> bytes:
    empty = _mcap_record(0x05, struct.pack("<HIQQ", 0, 0, 0, 0)) * (1 << 20)
    return _mcap(*[_chunk(zstandard.compress(empty * 4), 4 * len(empty)) for _ in range(4)])


def _glb(content: dict[str, Any], data: bytes = _TRIANGLE) -> bytes:
    text = json.dumps({"asset": {"version": "2.0"}, **content}).encode()
    text += b" " * (-len(text) % 4)
    data += bytes(-len(data) % 4)
    size = 12 + 8 + len(text) + 8 + len(data)
    head = struct.pack("<4sII", b"glTF", 2, size) + struct.pack("<II", len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(data), 0x004E4942) + data


def _glb_with(primitives: int, nodes: list[dict[str, Any]], accessors: list[dict[str, Any]] | None = None) -> bytes:
    position = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    return _glb({
        "buffers": [{"byteLength": len(_TRIANGLE)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(_TRIANGLE)}],
        "accessors": [position, *(accessors or [])],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * primitives}],
        "nodes": nodes,
        "scenes": [{"nodes": list(range(len(nodes)))}],
    })  # fmt: skip


def _glb_instances() -> bytes:
    return _glb_with(2000, [{"mesh": 0}] * 400)


def _glb_zeros() -> bytes:
    huge = {"componentType": 5126, "count": 1 << 26, "type": "MAT4"}
    return _glb_with(1, [{"mesh": 0}], [huge])


def _glb_nodes() -> bytes:
    return _glb_with(1, [{"mesh": 0}, *[{}] * 2_000_000])


def _glb_diamonds() -> bytes:
    """Each node is twice a child of the one before: 2^40 in all."""
    return _glb_with(1, [*[{"children": [index + 1, index + 1]} for index in range(40)], {"mesh": 0}])


def _graph(nodes: str, edges: str = "") -> bytes:
    return f'{{"format": "dsr-graph", "version": 1, "nodes": [{nodes}], "edges": [{edges}]}}'.encode()


def _json_problems() -> bytes:
    nodes = ", ".join(f'{{"name": "node_{index}", "type": "cube"}}' for index in range(40_000))
    edges = ", ".join(f'{{"src": "mode_{index}", "dst": "x", "type": "on"}}' for index in range(60_000))
    return _graph(nodes, edges)


def _json_types() -> bytes:
    return _graph(", ".join(f'{{"name": "n{index}", "type": "t{index}"}}' for index in range(150_000)))


def _json_lists() -> bytes:
    return b'{"format": "dsr-graph", "nodes": [' + b"[]," * 20_000_000 + b"[]]}"


def _cortex_problems() -> bytes:
    symbol = '"{0}": {{"id": "{0}", "name": "n{0}", "type": "t{0}", "attribute": {{}}, "links": [{1}]}}'
    link = '{{"src": "{0}", "dst": "x{0}", "label": "RT", "linkAttribute": {{}}}}'
    symbols = ", ".join(symbol.format(index, link.format(index)) for index in range(60_000))
    return f'{{"DSRModel": {{"symbols": {{{symbols}}}}}}}'.encode()


def _collada(encoding: str, entities: bool) -> bytes:
    nested = [f"<!ENTITY {name} '{f'&{inner};' * 10}'>" for inner, name in zip("abcdefgh", "bcdefghi", strict=True)]
    doctype = f"<!DOCTYPE x [<!ENTITY a 'aaaaaaaaaa'>{''.join(nested)}]>"
    body = f"{doctype if entities else ''}<COLLADA>{'&i;' if entities else '<a/>' * 5_000_000}</COLLADA>"
    return f'<?xml version="1.0" encoding="{encoding}"?>'.encode() + body.encode(encoding)


def _toml_nested() -> bytes:
    return b"a = " + b"[" * 100_000


def _toml_large() -> bytes:
    return b"".join(b"k%d = 1\n" % index for index in range(2_000_000))


def _toml_key() -> bytes:
    return b"a" + b".a" * 2_000_000 + b" = 1"


def _toml_number() -> bytes:
    return b"a = " + b"9" * 4_000_000


def _urdf_chain() -> bytes:
    """Each link hangs on the one before."""
    links = "".join(f'<link name="l{number}"/>' for number in range(30_001))
    joint = '<joint name="j{0}" type="fixed"><parent link="l{0}"/><child link="l{1}"/></joint>'
    joints = "".join(joint.format(number, number + 1) for number in range(30_000))
    return f'<robot name="r">{links}{joints}</robot>'.encode()


def _stl_liar() -> bytes:
    return bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(50)


def _obj_quads() -> bytes:
    return _TRIANGLE_OBJ + b"f" + b" 1 2 3" * 2_000_000


def _obj_materials() -> bytes:
    return _TRIANGLE_OBJ + b"".join(b"usemtl m%d\nf 1 2 3\n" % index for index in range(150_000))


def _stl_solids() -> bytes:
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    return (b"solid a\n" + facet + b"endsolid a\n") * 100_000


def _png(width: int, height: int) -> bytes:
    def piece(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9)
    row = bytes(1 + (width + 7) // 8)
    rows = b"".join([packer.compress(row) for _ in range(height)] + [packer.flush()])
    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + piece(b"IHDR", head) + piece(b"IDAT", rows) + piece(b"IEND", b"")


def _jpeg_hidden() -> bytes:
    """The size of one pixel stands where only who takes `FF 00` for a segment looks; decoders find the other one."""
    small = b"\xff\xc0\x00\x11\x08\x00\x01\x00\x01\x03" + bytes(8)
    size = struct.pack(">HH", 30_000, 30_000)
    parts = b"".join(bytes((index, 0x11, 0)) for index in (1, 2, 3))
    large = b"\xff\xc2\x00\x11\x08" + size + b"\x03" + parts
    return b"\xff\xd8\xff\x00" + struct.pack(">H", len(small) + 2) + small + large + b"\xff\xd9"


BOMBS = [
    Bomb("chunk.mcap", "one chunk of 4 GiB of zeros in 131 KB", _mcap_chunk),
    Bomb("liar.mcap", "a chunk that says 1000 bytes and unpacks to 256 MiB", _mcap_liar),
    Bomb("records.mcap", "four chunks of four million empty messages", _mcap_records),
    Bomb("instances.glb", "2000 primitives at each of 400 nodes", _glb_instances),
    Bomb("zeros.glb", "an accessor without data that stands for 4 GiB of zeros", _glb_zeros),
    Bomb("nodes.glb", "two million empty nodes", _glb_nodes),
    Bomb("diamonds.glb", "nodes with two parents, 2^40 in all", _glb_diamonds),
    Bomb("problems.json", "60 000 edges of nodes that are not there", _json_problems),
    Bomb("types.json", "150 000 nodes of unknown types", _json_types),
    Bomb("lists.json", "20 million empty lists", _json_lists),
    Bomb("cortex.json", "60 000 nodes of types and links that are not there", _cortex_problems),
    Bomb("utf7.dae", "entities that expand to a gigabyte, in UTF-7", lambda: _collada("utf-7", entities=True)),
    Bomb("utf16.dae", "the same in UTF-16", lambda: _collada("utf-16", entities=True)),
    Bomb("elements.dae", "five million XML elements", lambda: _collada("utf-8", entities=False)),
    Bomb("utf7.urdf", "entities that expand to a gigabyte, in UTF-7", lambda: _collada("utf-7", entities=True)),
    Bomb("elements.urdf", "five million XML elements", lambda: _collada("utf-8", entities=False)),
    Bomb("nested.toml", "100 000 lists inside each other", _toml_nested),
    Bomb("large.toml", "two million keys", _toml_large),
    Bomb("key.toml", "a key of two million parts", _toml_key),
    Bomb("number.toml", "a number of four million digits", _toml_number),
    Bomb("chain.urdf", "a robot of 30 000 links in a row", _urdf_chain),
    Bomb("liar.stl", "four thousand million triangles, it says", _stl_liar),
    Bomb("face.obj", "one face of six million corners", _obj_quads),
    Bomb("materials.obj", "a triangle in each of 150 000 materials", _obj_materials),
    Bomb("solids.stl", "a triangle in each of 100 000 solids", _stl_solids),
    Bomb("hidden.jpeg", "a camera image of 900 million pixels that hides its size", _jpeg_hidden),
    Bomb("image.png", "a camera image of 900 million pixels in 110 KB", lambda: _png(30_000, 30_000)),
]
