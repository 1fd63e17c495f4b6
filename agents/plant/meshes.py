"""Textured boxes as OBJ + MTL + PNG files, which both renderers draw alike."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from agents.plant.tags import tagged_face

Color = tuple[float, ...]
"""Red, green and blue, 0 to 1."""
Size = tuple[float, float, float]

_FACES = (  # normal, then the directions to the right and up as seen from outside
    ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 0, 1), (0, 1, 0)),
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
)
_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def write_box(folder: Path, name: str, size: Size, color: Color, marker_id: int | None = None) -> Path:
    """Write a box of `size` m, with a tag on its +z face if `marker_id` is given; returns the OBJ file."""
    cv2.imwrite(str(folder / f"{name}.png"), _texture(size, color, marker_id))
    material = f"newmtl box\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n"
    (folder / f"{name}.mtl").write_text(material, encoding="utf-8")
    file = folder / f"{name}.obj"
    file.write_text(_geometry(name, size), encoding="utf-8")
    return file


def _texture(size: Size, color: Color, marker_id: int | None) -> np.ndarray:
    """Left half: the +z face. Right half: all others."""
    bgr = np.round(np.array(color[::-1]) * 255).astype(np.uint8)
    if marker_id is None:
        return np.full((8, 16, 3), bgr, np.uint8)
    face = cv2.cvtColor(tagged_face(marker_id, size[0], size[1]), cv2.COLOR_GRAY2BGR)
    return np.hstack([face, np.broadcast_to(bgr, face.shape)])


def _geometry(name: str, size: Size) -> str:
    half = np.array(size) / 2
    vertices, places, normals, triangles = [], [], [], []
    for index, (normal, right, up) in enumerate(_FACES):
        for u, v in _CORNERS:
            corner = half * (np.array(normal) + (2 * u - 1) * np.array(right) + (2 * v - 1) * np.array(up))
            vertices.append("v {:.6f} {:.6f} {:.6f}".format(*corner))
            places.append(f"vt {u / 2} {v}" if index == 0 else "vt 0.75 0.5")
        normals.append("vn {} {} {}".format(*normal))
        triangles += [_triangle(index, corners) for corners in ((1, 2, 3), (1, 3, 4))]
    return "\n".join([f"mtllib {name}.mtl", *vertices, *places, *normals, "usemtl box", *triangles, ""])


def _triangle(face: int, corners: tuple[int, int, int]) -> str:
    return "f " + " ".join(f"{4 * face + corner}/{4 * face + corner}/{face + 1}" for corner in corners)
