"""What bodies look like: their triangles and pictures, taken from what the physics engine is given to draw."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.plant.meshes import Facet, facets_of
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose

Image = NDArray[np.uint8]
WHITE = np.full((1, 1, 3), 255, np.uint8)


class Painted(msgspec.Struct, frozen=True, eq=False):
    """Triangles with a picture on them."""

    corners: NDArray[np.float32]
    """(3 n, 8) of n triangles: position in m, normal, and the place in the picture, 0 to 1 from its lower left."""
    picture: Image
    """(h, w, 3) RGB, from its upper row."""


class Drawable(msgspec.Struct, frozen=True, eq=False):
    """One of the things that a body shows."""

    link: int
    """As the physics engine numbers them; -1 is the base."""
    pose: Pose
    """link_from_painted"""
    scale: tuple[float, float, float]
    painted: Painted
    color: tuple[float, float, float]
    """Red, green and blue by which the picture is multiplied, 0 to 1."""


class Looks:
    """What all bodies of a physics client look like.

    The engine reads a file whenever a body gets it, but the file may be gone by then. So files are read when they are
    told of.
    """

    def __init__(self) -> None:
        self._files: dict[str, Painted] = {}
        self.bodies: dict[int, tuple[Drawable, ...]] = {}

    def read(self, file: str) -> None:
        """Read a file of a shape that bodies will get."""
        self._files[file] = read_painted(Path(file))

    def forget(self, file: str) -> None:
        """No other body will get this file."""
        self._files.pop(file, None)

    def add(self, body: int, shapes: Iterable[tuple[Any, ...]]) -> None:
        """Take note of a body by what `getVisualShapeData` says of it."""
        self.bodies[body] = tuple(drawn for shape in shapes if (drawn := self._look(shape)) is not None)

    def remove(self, body: int) -> None:
        """The body is no more."""
        self.bodies.pop(body, None)

    def _look(self, shape: tuple[Any, ...]) -> Drawable | None:
        """None for what is invisible, and for a plane without end."""
        _, link, kind, sizes, name, position, rotation, rgba = shape[:8]
        if rgba[3] <= 0.0 or kind == pybullet.GEOM_PLANE:
            return None
        scale = (1.0, 1.0, 1.0)
        if kind == pybullet.GEOM_MESH:
            file, scale = name.decode(), sizes
            painted = self._files.get(file) or read_painted(Path(file))
        else:
            painted = _primitive(kind, sizes)
        return Drawable(link, Pose(position, rotation), scale, painted, rgba[:3])


def _primitive(kind: int, sizes: tuple[float, float, float]) -> Painted:
    """A box by its edges, a sphere by its radius, a cylinder or capsule by length and radius (m)."""
    length, radius = sizes[0], sizes[1]
    parts: dict[int, Callable[[], list[Part]]] = {
        pybullet.GEOM_BOX: lambda: [Part("box", sizes)],
        pybullet.GEOM_SPHERE: lambda: [_ball(length)],
        pybullet.GEOM_CYLINDER: lambda: [Part("cylinder", (2 * radius, 2 * radius, length))],
        pybullet.GEOM_CAPSULE: lambda: [
            Part("cylinder", (2 * radius, 2 * radius, length)),
            *(_ball(radius, end * length / 2) for end in (-1, 1)),
        ],
    }
    return Painted(np.concatenate([_triangles(facet) for part in parts[kind]() for facet in facets_of(part)]), WHITE)


def _ball(radius: float, height: float = 0.0) -> Part:
    return Part("sphere", (2 * radius, 2 * radius, 2 * radius), (0.0, 0.0, height))


def _triangles(facet: Facet) -> NDArray[np.float32]:
    return np.hstack(facet)[[0, 1, 2, 0, 2, 3]].astype(np.float32)


def read_painted(file: Path) -> Painted:
    """A Wavefront OBJ file of one material with a picture, or of none; its faces are triangles.

    Corners without a normal get that of their triangle.
    """
    rows: dict[str, list[list[str]]] = {"v": [], "vt": [], "vn": [], "f": [], "mtllib": []}
    for line in file.read_text(encoding="utf-8").splitlines():
        kind, *words = line.split() or [""]
        if kind in rows:
            rows[kind].append(words)
    corners = [[int(number or 0) for number in f"{corner}//".split("/")[:3]] for face in rows["f"] for corner in face]
    at = np.array(corners, dtype=int).reshape(-1, 3)
    points = np.array(rows["v"], np.float32).reshape(-1, 3)[at[:, 0] - 1]
    places = np.vstack([np.zeros((1, 2), np.float32), np.array(rows["vt"], np.float32).reshape(-1, 2)])[at[:, 1]]
    told = np.vstack([np.zeros((1, 3), np.float32), np.array(rows["vn"], np.float32).reshape(-1, 3)])[at[:, 2]]
    normals = np.where(at[:, 2:] > 0, told, _flat_normals(points))
    return Painted(np.hstack([points, normals, places]).astype(np.float32), _picture(file.parent, rows["mtllib"]))


def _flat_normals(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """(3 n, 3) of the triangles whose corners are points (3 n, 3)."""
    a, b, c = points.reshape(-1, 3, 3).swapaxes(0, 1)
    across = np.cross(b - a, c - a)
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    return np.repeat(across / np.where(lengths > 0, lengths, 1), 3, axis=0).astype(np.float32)


def _picture(folder: Path, materials: list[list[str]]) -> Image:
    """That of the only material, in RGB; white without one."""
    for words in materials:
        for line in (folder / words[0]).read_text(encoding="utf-8").splitlines():
            if line.startswith("map_Kd "):
                image = cv2.imread(str(folder / line.split()[1]), cv2.IMREAD_COLOR_RGB)
                assert image is not None
                return np.asarray(image, np.uint8)
    return WHITE
