"""Models from files: OBJ, STL and GLB by trimesh, COLLADA by pycollada; whatever is wrong with one is a `ConfigError`.

A file is data from anywhere: it is limited in size, refers to nothing outside of itself (materials and textures are
not read), and what its reader raises names the file.
"""

from __future__ import annotations

import codecs
import re
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dsr.errors import ConfigError, DsrError, MeshError
from dsr.files.data_files import read_file
from dsr.geometry.model import MOST_NODES, Array, Geometry, Model, RawNode, to_model

MOST_FILE_BYTES = 1 << 28
Up = Literal["x", "y", "z"]
"""The axis of a file that points upwards."""

_MOST_LETTERS = 1 << 14
"""Characters of a line of an OBJ file: a face of a thousand corners. The reader takes their square in time."""
_LONG_LINE = re.compile(rf"[^\n]{{{_MOST_LETTERS + 1}}}")
_OBJ_PART = re.compile(r"^[ \t]*[og][ \t]|usemtl", re.MULTILINE)
_STL_PART = re.compile("endsolid", re.IGNORECASE)
"""What begins or ends a part of a file: as the reader, wherever it is in a line."""
_STL_HEADER = struct.Struct("<80xI")
_STL_TRIANGLE = 50  # bytes
_UP: dict[str, Array] = {  # z-up from file, as COLLADA 1.4.1 defines X_UP, Y_UP and Z_UP
    "x": np.array([(0, -1, 0), (0, 0, -1), (1, 0, 0)], dtype=float),
    "y": np.array([(1, 0, 0), (0, 0, -1), (0, 1, 0)], dtype=float),
    "z": np.eye(3),
}


class _Content(NamedTuple):
    """What was read of a file."""

    tops: list[RawNode]
    """Its outermost nodes."""
    unit: float = 1.0
    """m"""
    up: Up = "z"
    warnings: tuple[str, ...] = ()


def load_model(file: Path, *, scale: float = 1.0, up: Up | None = None) -> Model:
    """The meshes of a file with its hierarchy and names, in metres, z up.

    Args:
        file: `.obj`, `.stl`, `.glb` or `.dae`.
        scale: metres of one unit of the file, beside what the file says: OBJ and STL say nothing.
        up: which axis of the file points upwards; by default what the file or its format says, and z for OBJ and STL.

    Raises:
        ConfigError: if there is no such file, or it is empty, too large, of another format, or holds no triangles.
    """
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise ConfigError(f"files of meshes end in {', '.join(READERS)}", file=str(file))
    if not 0.0 < scale < float("inf"):
        raise ConfigError(f"scale {scale}: expected a positive number")
    data = _read(file)
    try:
        content = reader(data)
        metres = np.eye(4)
        metres[:3, :3] = scale * content.unit * _UP[up or content.up]
        return to_model(content.tops, file.stem, metres, content.warnings)
    except DsrError as error:
        raise ConfigError(str(error), file=str(file)) from error
    except Exception as error:  # whatever a reader stumbles over in a wrong file
        reason = f"{type(error).__name__}: {error}".rstrip(": ")
        raise ConfigError(f"no valid {file.suffix[1:].upper()}: {reason:.300}", file=str(file)) from error


def _read(file: Path) -> bytes:
    data = read_file(file, MOST_FILE_BYTES)
    if not data:
        raise ConfigError("is empty", file=str(file))
    return data


def _text(data: bytes) -> str:
    """Raises `MeshError` for what is no text in UTF-8 or Latin-1."""
    if b"\0" in data:
        raise MeshError("is no text: expected UTF-8 or Latin-1")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _check_parts(text: str, part: re.Pattern[str]) -> None:
    """Raise `MeshError` for too many parts: each takes some ms."""
    if sum(1 for _ in part.finditer(text)) > MOST_NODES:
        raise MeshError(f"more than {MOST_NODES} parts")


def _obj(data: bytes) -> _Content:
    from trimesh.exchange.obj import load_obj
    from trimesh.util import wrap_as_stream

    text = _text(data)
    joined = text.replace("\r\n", "\n").replace("\\\n", "")  # lines that go on, as the reader joins them
    _check_parts(joined, _OBJ_PART)
    if _LONG_LINE.search(joined):
        raise MeshError(f"a line of more than {_MOST_LETTERS} characters")
    return _Content(_flat(load_obj(wrap_as_stream(text), skip_materials=True, split_objects=True)))


def _stl(data: bytes) -> _Content:
    from trimesh.exchange.stl import load_stl_ascii, load_stl_binary
    from trimesh.util import wrap_as_stream

    if data.removeprefix(codecs.BOM_UTF8).lstrip()[:5].lower() == b"solid" and b"\0" not in data[: _STL_HEADER.size]:
        text = _text(data)
        _check_parts(text, _STL_PART)
        return _Content(_flat(load_stl_ascii(wrap_as_stream(text))))
    return _Content(_flat(load_stl_binary(wrap_as_stream(data[: _stl_size(data)]))))


def _stl_size(data: bytes) -> int:
    """Bytes of a binary STL, without what some programs write behind it. Raises `MeshError` if it is not whole."""
    triangles = _STL_HEADER.unpack_from(data)[0] if len(data) >= _STL_HEADER.size else 0
    expected = _STL_HEADER.size + _STL_TRIANGLE * int(triangles)
    if len(data) < expected:
        raise MeshError(f"no valid STL: {len(data)} bytes, neither text nor {triangles} triangles in {expected} bytes")
    return expected


def _flat(loaded: Mapping[str, Any]) -> list[RawNode]:
    """One node for each object of a file without hierarchy; without a name of its own, that of the file."""
    pieces: Mapping[str, Any] = loaded.get("geometry") or {"geometry": loaded}
    nodes = [RawNode(str(name), geometry=[_geometry(piece)]) for name, piece in sorted(pieces.items())]
    if len(nodes) == 1:
        return [RawNode("", geometry=nodes[0].geometry)]
    return nodes


def _geometry(piece: Mapping[str, Any]) -> Geometry:
    if piece.get("faces") is None:
        raise MeshError("no triangles")
    from trimesh.geometry import triangulate_quads

    return Geometry(np.asarray(piece["vertices"], dtype=np.float64), triangulate_quads(piece["faces"]))


def _glb(data: bytes) -> _Content:
    from dsr.geometry.glb_file import read_glb

    return _Content(read_glb(data), up="y")  # glTF 2.0, section 3.4


def _dae(data: bytes) -> _Content:
    from dsr.geometry.collada_file import read_collada

    tops, unit, up, warnings = read_collada(_text(data))
    return _Content(tops, unit, up, warnings)


READERS: dict[str, Callable[[bytes], _Content]] = {".obj": _obj, ".stl": _stl, ".glb": _glb, ".dae": _dae}
"""Readers of model files, by the suffix of the file's name."""
