"""Textured bodies as OBJ + MTL + PNG files, which both renderers draw alike."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.plant.read_files import name_by_content
from agents.plant.tags import tagged_face
from dsr.math3d import quaternions
from dsr.math3d.shapes import Part, Shape

Color = tuple[float, ...]
"""Red, green and blue, 0 to 1."""
Size = tuple[float, float, float]
Array = NDArray[np.float64]
Facet = tuple[Array, Array, Array]
"""Corners (4, 3), their normals (4, 3) and their places in the texture (4, 2); the corners counter-clockwise."""

_FACES = (  # normal, then the directions to the right and up as seen from outside
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
)
_CORNERS = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), dtype=float)
_PLAIN = np.tile((0.75, 0.5), (4, 1))  # a place in the half of the texture that has the body's colour
_SEGMENTS = 32  # of a circle
_LEVEL = 1e-6  # m, within which a facet is on top: the depth buffer could not tell it from the tag


def write_box(folder: Path, name: str, size: Size, color: Color, marker_id: int | None = None) -> Path:
    """Write a box of `size` m, with a tag on its +z face if `marker_id` is given; returns the OBJ file."""
    return _write(folder, name, _texture(size, color, marker_id), _box(size, tagged=True))


def write_shape(folder: Path, name: str, size: Size, shape: Shape, color: Color, marker_id: int | None = None) -> Path:
    """Write a body made of parts; the tag's face takes the place of all that is on top of its bounding box."""
    facets = [facet for part in shape for facet in facets_of(part)]
    if marker_id is not None:
        top = 0.5 * size[2] - _LEVEL
        facets = [facet for facet in facets if facet[0][:, 2].min() < top] + [next(_box(size, tagged=True))]
    return _write(folder, name, _texture(size, color, marker_id), facets)


def _texture(size: Size, color: Color, marker_id: int | None) -> NDArray[np.uint8]:
    """Left half: the +z face. Right half: all others."""
    bgr = np.round(np.array(color[::-1]) * 255).astype(np.uint8)
    if marker_id is None:
        return np.full((8, 16, 3), bgr, np.uint8)
    face = cv2.cvtColor(tagged_face(marker_id, size[0], size[1]), cv2.COLOR_GRAY2BGR)
    return np.hstack([face, np.broadcast_to(bgr, face.shape)]).astype(np.uint8)


def _box(size: Size, *, tagged: bool = False) -> Iterator[Facet]:
    """The faces of a box, +z first, which shows the left half of the texture if it is tagged."""
    half = np.array(size) / 2
    for index, face in enumerate(_FACES):
        normal, right, up = (np.array(direction) for direction in face)
        corners = [half * (normal + (2 * u - 1) * right + (2 * v - 1) * up) for u, v in _CORNERS]
        places = _CORNERS * (0.5, 1.0) if tagged and index == 0 else _PLAIN
        yield np.array(corners), np.tile(normal, (4, 1)).astype(float), places


def facets_of(part: Part) -> Iterator[Facet]:
    """The surface of a part, in the body's frame."""
    turn, position = np.array(quaternions.to_matrix(part.rotation)), np.array(part.position)
    own = {"box": lambda: _box(part.size), "cylinder": lambda: _cylinder(part.size), "sphere": lambda: _ball(part.size)}
    for corners, normals, places in own[part.kind]():
        yield corners @ turn.T + position, normals @ turn.T, places


def _cylinder(size: Size) -> Iterator[Facet]:
    """Its side, and its ends as slices whose fourth corner is their third one again."""
    radius, height = 0.5 * size[0], 0.5 * size[2]
    for one, other in _arcs(_SEGMENTS, 2 * np.pi):
        side = np.array([one, other, other, one])
        yield _at(radius * side, (-height, -height, height, height)), _at(side, 0.0), _PLAIN
        for end in (1.0, -1.0):
            rim = radius * np.array([one, other][:: int(end)])
            yield _at([(0.0, 0.0), *rim, rim[1]], end * height), np.tile((0.0, 0.0, end), (4, 1)), _PLAIN


def _ball(size: Size) -> Iterator[Facet]:
    for lower, upper in _arcs(_SEGMENTS // 2, np.pi):  # (sine, -cosine) from the lowest point up
        for one, other in _arcs(_SEGMENTS, 2 * np.pi):
            sines = np.array([lower[1], lower[1], upper[1], upper[1]])[:, None]
            cosines = np.array([lower[0], lower[0], upper[0], upper[0]])
            normals = _at(sines * np.array([one, other, other, one]), -cosines)
            yield 0.5 * size[0] * normals, normals, _PLAIN


def _arcs(count: int, angle: float) -> Iterator[tuple[Array, Array]]:
    """Ends (cosine, sine) of the pieces of an arc from 0 to `angle` rad."""
    angles = np.linspace(0.0, angle, count + 1)
    points = np.column_stack([np.cos(angles), np.sin(angles)])
    yield from itertools.pairwise(points)


def _at(points: object, heights: object) -> Array:
    """(4, 3) from (4, 2) and heights."""
    return np.column_stack([np.asarray(points, float), np.broadcast_to(np.asarray(heights, float), (4,))])


def _write(folder: Path, name: str, texture: NDArray[np.uint8], facets: Iterator[Facet] | list[Facet]) -> Path:
    lines: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    triangles = []
    for index, facet in enumerate(facets):
        for kind, rows in zip(("v", "vn", "vt"), facet, strict=True):
            lines[kind] += [f"{kind} " + " ".join(f"{value:.6f}" for value in row) for row in rows]
        triangles += [_triangle(4 * index, corners) for corners in ((1, 2, 3), (1, 3, 4))]
    shape = "\n".join([*lines["v"], *lines["vt"], *lines["vn"], "usemtl body", *triangles, ""])
    picture = cv2.imencode(".png", texture)[1].tobytes()
    name = name_by_content(name, picture, shape.encode())
    material = f"newmtl body\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n"
    (folder / f"{name}.png").write_bytes(picture)
    (folder / f"{name}.mtl").write_text(material, encoding="utf-8")
    file = folder / f"{name}.obj"
    file.write_text(f"mtllib {name}.mtl\n{shape}", encoding="utf-8")
    return file


def _triangle(before: int, corners: tuple[int, int, int]) -> str:
    return "f " + " ".join("/".join([str(before + corner)] * 3) for corner in corners)
