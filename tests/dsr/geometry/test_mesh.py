"""Meshes: canonical bytes that are the same for equal meshes everywhere, and the same mesh back from them."""

from __future__ import annotations

import hashlib
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dsr import MeshError, SchemaError, WireError
from dsr.geometry import Bounds, Mesh, mesh_hashes
from tests.dsr.geometry.shapes import CORNERS, FACES, block

FLOATS = st.floats(-1e6, 1e6, width=32)


@st.composite
def meshes(draw: st.DrawFn) -> tuple[list[tuple[float, ...]], list[tuple[int, ...]]]:
    vertices = draw(st.lists(st.tuples(FLOATS, FLOATS, FLOATS), min_size=1, max_size=12))
    index = st.integers(0, len(vertices) - 1)
    return vertices, draw(st.lists(st.tuples(index, index, index), min_size=1, max_size=12))


@given(meshes())
def test_bytes_give_the_same_mesh_back(content: tuple[Any, Any]) -> None:
    mesh = Mesh(*content)
    again = Mesh.decode(bytes(mesh.data))
    assert again == mesh and again.hash == hashlib.sha256(mesh.data).hexdigest()
    assert np.array_equal(again.vertices, np.array(content[0], np.float32))
    assert np.array_equal(again.triangles, content[1])


@given(meshes(), st.sampled_from(["<f4", ">f4", "<f8", ">f8"]), st.sampled_from(["<u4", ">i8", "<i4", ">u2"]))
def test_the_form_of_arrays_does_not_matter(content: tuple[Any, Any], numbers: str, indices: str) -> None:
    vertices = np.asfortranarray(np.array(content[0], numbers))
    triangles = np.array(content[1], indices)[::-1][::-1]
    assert Mesh(vertices, triangles).hash == Mesh(*content).hash


@given(meshes())
def test_minus_zero_is_zero(content: tuple[Any, Any]) -> None:
    vertices = np.array(content[0], np.float64)
    assert Mesh(np.where(vertices == 0.0, -0.0, vertices), content[1]) == Mesh(*content)


@given(meshes(), st.data())
def test_any_other_byte_is_another_mesh_or_none(content: tuple[Any, Any], data: st.DataObject) -> None:
    mesh = Mesh(*content)
    changed = bytearray(mesh.data)
    place = data.draw(st.integers(0, len(changed) - 1))
    changed[place] ^= data.draw(st.integers(1, 255))
    try:
        other = Mesh.decode(bytes(changed))
    except WireError:
        return
    assert other.hash != mesh.hash and other != mesh
    assert Mesh(other.vertices, other.triangles).data == bytes(changed)  # no second encoding of one mesh


@given(st.binary(max_size=200))
def test_nonsense_is_no_mesh(data: bytes) -> None:
    with pytest.raises(WireError):
        Mesh.decode(data)


@given(meshes())
def test_bounds_are_exact(content: tuple[Any, Any]) -> None:
    points = np.array(content[0], np.float32)
    assert Mesh(*content).bounds == Bounds(tuple(points.min(axis=0).tolist()), tuple(points.max(axis=0).tolist()))


def test_golden_bytes() -> None:
    mesh = Mesh([(0, 0, 0), (1, 0, 0), (0, 2, 0)], [(0, 1, 2)])
    expected = b"dsrmesh1" + struct.pack("<II9f3I", 3, 1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 1, 2)
    assert bytes(mesh.data) == expected
    assert mesh.hash == "6ba145e447288962b58087ecd86620caef47fc476e7f86ff9ae376b63ba5d0d7"


def test_another_process_gives_the_same_hash() -> None:
    code = "from tests.dsr.geometry.shapes import block; print(block(0.1, 0.2, 1/3).hash)"
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONHASHSEED": "7"}, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    assert run.stdout.strip() == block(0.1, 0.2, 1 / 3).hash


def test_a_mesh_cannot_be_changed() -> None:
    vertices = np.array(CORNERS)
    mesh = Mesh(vertices, FACES)
    before = mesh.hash
    vertices[:] = 9.0
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0
    assert Mesh.decode(mesh.data).hash == before and mesh.bounds.high == (1.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        (CORNERS, [], "0 triangles"),
        ([], FACES, "0 vertices"),
        (CORNERS, [(0, 1, 8)], "vertex 8; the vertices are 0 to 7"),
        (CORNERS, [(0, 1, -1)], "vertex -1"),
        (CORNERS, [(0.0, 1.0, 2.0)], "expected integers"),
        (CORNERS, [(0, 1, 2, 3)], r"expected integers \(m, 3\)"),
        ([(0, 0), (1, 1)], [(0, 1, 1)], r"expected numbers \(n, 3\)"),
        ([(0, 0, float("nan"))], [(0, 0, 0)], "vertex 0 is"),
        ([(0, 0, 0), (0, 1e39, 0)], [(0, 0, 1)], "vertex 1 is"),
        ([("a", "b", "c")], [(0, 0, 0)], "expected numbers"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices: Any, triangles: Any, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        Mesh(vertices, triangles)


def test_a_huge_mesh_is_refused() -> None:
    vertices = np.broadcast_to(np.zeros(3, np.float32), (23_000_000, 3))
    with pytest.raises(MeshError, match="at most"):
        Mesh(vertices, [(0, 1, 2)])


@pytest.mark.parametrize("text", ["", "x", "A" * 64, "0" * 63, ("0" * 64 + ",") * 2, ",".join(["0" * 64] * 300)])
def test_an_attribute_that_names_no_meshes_is_refused(text: str) -> None:
    with pytest.raises(SchemaError, match="SHA-256"):
        mesh_hashes({"mesh": text})


def test_an_attribute_names_meshes() -> None:
    assert mesh_hashes({}) == ()
    assert mesh_hashes({"mesh": "0" * 64 + "," + "a" * 64}) == ("0" * 64, "a" * 64)


@pytest.mark.parametrize(
    ("vertices", "triangles", "name"),
    [([(0, 0, 0), (1, 0)], [(0, 1, 2)], "vertices"), ([(0, 0, 0)] * 3, [(0, 1, 2), (1,)], "triangles")],
)
def test_rows_of_different_lengths_are_refused(vertices: object, triangles: object, name: str) -> None:
    with pytest.raises(MeshError, match=f"{name} in rows of different lengths"):
        Mesh(vertices, triangles)  # type: ignore[arg-type]
