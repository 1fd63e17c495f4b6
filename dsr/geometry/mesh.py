"""Triangle meshes as immutable values with canonical bytes, by whose hash everybody knows them.

Canonical bytes, little-endian: 8 bytes `dsrmesh1`, the number of vertices and of triangles (uint32 each), the vertices
(float32, x y z each), the triangles (uint32, three indices each). Numbers are finite, and zero is never negative, so
equal meshes have equal bytes and the same hash in every process.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dsr.errors import MeshError, SchemaError, WireError
from dsr.math3d.quaternions import Vector3

MOST_BYTES = 1 << 28
"""Bytes that one mesh may have: about 9 million vertices."""
MOST_AT_NODE = 256
"""Meshes of one node."""
_MAGIC = b"dsrmesh1"
_HEADER = struct.Struct("<8sII")
_VERTEX, _TRIANGLE = 12, 12  # bytes
_NEGATIVE_ZERO = 0x80000000
_HASH = re.compile(r"[0-9a-f]{64}")

Bytes = bytes | memoryview


class Bounds(NamedTuple):
    """A box parallel to the axes of some frame."""

    low: Vector3
    """Least x, y, z, m."""
    high: Vector3
    """Greatest x, y, z, m."""


class Mesh:
    """Triangles in the frame of a node. Immutable; equal if its canonical bytes are.

    Args:
        vertices: (n, 3) m, kept as float32.
        triangles: (m, 3) indices of vertices; counter-clockwise, seen from outside.

    Raises:
        MeshError: for no triangles, rows that are not of three numbers, numbers that are not finite as float32, indices
            of no vertex, or too many of them.
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        given, corners = _array(vertices, "vertices"), _array(triangles, "triangles")
        _check_size(len(np.atleast_1d(given)), len(np.atleast_1d(corners)))
        points = _points(given)
        indices = _indices(corners, len(points))
        header = _HEADER.pack(_MAGIC, len(points), len(indices))
        self._set(b"".join((header, points.tobytes(), indices.tobytes())))

    @classmethod
    def decode(cls, data: Bytes, hash: str | None = None) -> Mesh:
        """The mesh with these canonical bytes, which are not copied; `hash` is theirs, if that was checked before.

        Raises `WireError` if they are no such bytes.
        """
        self = cls.__new__(cls)
        self._set(data)
        if hash is not None:
            self.hash = hash
        if len(self.vertices) == 0 or len(self.triangles) == 0:
            raise WireError("a mesh without triangles")
        if not np.isfinite(self.vertices).all() or (self.vertices.view(np.uint32) == _NEGATIVE_ZERO).any():
            raise WireError("a mesh whose numbers are not finite, or minus zero")
        if int(self.triangles.max()) >= len(self.vertices):
            raise WireError(f"a triangle of vertex {int(self.triangles.max())}; there are {len(self.vertices)}")
        return self

    def _set(self, data: Bytes) -> None:
        view = memoryview(data)
        count, triangles = _counts(view)
        end = _HEADER.size + _VERTEX * count
        self.data: Bytes = data
        """The canonical bytes."""
        self.vertices: NDArray[np.float32] = _read_only(view[_HEADER.size : end], np.dtype("<f4")).reshape(count, 3)
        """(n, 3) m, read-only"""
        self.triangles: NDArray[np.uint32] = _read_only(view[end:], np.dtype("<u4")).reshape(triangles, 3)
        """(m, 3) indices of vertices, read-only"""

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the canonical bytes, 64 hexadecimal digits."""
        return hash_of(self.data)

    @cached_property
    def bounds(self) -> Bounds:
        """The box around all vertices, exactly."""
        low, high = self.vertices.min(axis=0).tolist(), self.vertices.max(axis=0).tolist()
        return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))

    @property
    def nbytes(self) -> int:
        """Size of the canonical bytes."""
        return len(self.data)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Mesh) and (self is other or self.hash == other.hash)

    def __hash__(self) -> int:
        return hash(self.hash)

    def __repr__(self) -> str:
        return f"Mesh({len(self.vertices)} vertices, {len(self.triangles)} triangles, {self.hash[:12]})"


def hash_of(data: Bytes) -> str:
    """Compute the hash (SHA-256, hexadecimal) that names the mesh with these canonical bytes."""
    return hashlib.sha256(data).hexdigest()


def is_hash(text: str) -> bool:
    """Whether `text`, which may come from anywhere, can be the hash of a mesh."""
    return _HASH.fullmatch(text) is not None


def mesh_hashes(node: Mapping[str, Any]) -> tuple[str, ...]:
    """The hashes in the attribute `mesh` of a node; none without it. Raises `SchemaError` for text that is none."""
    value = node.get("mesh")
    if value is None:
        return ()
    hashes = tuple(str(value).split(","))
    if len(hashes) > MOST_AT_NODE or not all(map(is_hash, hashes)):
        raise SchemaError(f"{node}: mesh {str(value)[:80]!r}; expected up to {MOST_AT_NODE} SHA-256, comma-separated")
    return hashes


def joined_bounds(boxes: Iterable[Bounds]) -> Bounds | None:
    """The box around all of them; None for none."""
    listed = list(boxes)
    if not listed:
        return None
    low = np.min([box.low for box in listed], axis=0).tolist()
    high = np.max([box.high for box in listed], axis=0).tolist()
    return Bounds((low[0], low[1], low[2]), (high[0], high[1], high[2]))


def _array(given: ArrayLike, name: str) -> NDArray[Any]:
    try:
        return np.asarray(given)
    except ValueError as error:
        raise MeshError(f"{name} in rows of different lengths; expected three numbers each") from error


def _points(given: NDArray[Any]) -> NDArray[np.float32]:
    if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "fiu":
        raise MeshError(f"vertices of shape {given.shape}, {given.dtype}; expected numbers (n, 3)")
    with np.errstate(over="ignore"):
        points = given.astype("<f4") + np.float32(0.0)  # which turns minus zero into zero
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise MeshError(f"vertex {row} is {given[row].tolist()}; expected finite numbers (float32)")
    return points


def _indices(given: NDArray[Any], count: int) -> NDArray[np.uint32]:
    if given.ndim != 2 or given.shape[1] != 3 or given.dtype.kind not in "iu":
        raise MeshError(f"triangles of shape {given.shape}, {given.dtype}; expected integers (m, 3)")
    if given.min() < 0 or given.max() >= count:
        wrong = int(given.min() if given.min() < 0 else given.max())
        raise MeshError(f"a triangle of vertex {wrong}; the vertices are 0 to {count - 1}")
    return given.astype("<u4")


def _check_size(vertices: int, triangles: int) -> None:
    if not vertices or not triangles:
        raise MeshError(f"a mesh of {vertices} vertices and {triangles} triangles; expected one triangle or more")
    size = _HEADER.size + _VERTEX * vertices + _TRIANGLE * triangles
    if size > MOST_BYTES:
        raise MeshError(f"{vertices} vertices and {triangles} triangles are {size} bytes; at most {MOST_BYTES}")


def _counts(view: memoryview) -> tuple[int, int]:
    """Numbers of vertices and triangles. Raises `WireError` unless the bytes are just those."""
    if not _HEADER.size <= len(view) <= MOST_BYTES:
        raise WireError(f"a mesh of {len(view)} bytes; expected {_HEADER.size} to {MOST_BYTES}")
    magic, vertices, triangles = _HEADER.unpack_from(view)
    if magic != _MAGIC or len(view) != _HEADER.size + _VERTEX * vertices + _TRIANGLE * triangles:
        raise WireError(f"{len(view)} bytes that begin with {magic!r} are no mesh of {vertices} vertices")
    return vertices, triangles


def _read_only(view: memoryview, dtype: np.dtype[Any]) -> NDArray[Any]:
    array = np.frombuffer(view, dtype)
    array.flags.writeable = False
    return array
