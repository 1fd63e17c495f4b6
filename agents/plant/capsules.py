"""Capsules as textured meshes that both renderers draw alike, and whether they are in the way of a view."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
_AROUND = 12
_RINGS = 3  # of each cap


def write_capsule(folder: Path, name: str, length: float, radius: float, color: Vector3) -> Path:
    """Write a capsule about z, `length` m between the centres of its ends; `color` is red, green, blue, 0 to 1."""
    bgr = np.round(np.array(color[::-1]) * 255).astype(np.uint8)
    cv2.imwrite(str(folder / f"{name}.png"), np.full((8, 8, 3), bgr, np.uint8))
    material = f"newmtl skin\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n"
    (folder / f"{name}.mtl").write_text(material, encoding="utf-8")
    file = folder / f"{name}.obj"
    file.write_text(_geometry(name, length, radius), encoding="utf-8")
    return file


def capsule_pose(start: Array, end: Array) -> Pose:
    """The pose of a capsule whose ends are centred at points (3,)."""
    along = end - start
    distance = float(np.linalg.norm(along))
    x, y, z = (float(part) for part in (along / distance if distance > 0.0 else (0.0, 0.0, 1.0)))
    angle = math.acos(max(-1.0, min(1.0, z)))
    norm = math.hypot(x, y)
    axis = (-y / norm * angle, x / norm * angle, 0.0) if norm > 1e-9 else (angle, 0.0, 0.0)
    return Pose(0.5 * (start + end), quaternions.from_rotvec(axis))


def blocked(eye: Array, targets: Array, starts: Array, ends: Array, radii: Array) -> NDArray[np.bool_]:
    """(n, m) whether the view from `eye` (3,) to targets (n, 3) passes through capsules (m,)."""
    nearest = _nearest(eye, targets, starts, ends)
    return np.asarray(nearest < radii)


def _nearest(eye: Array, targets: Array, starts: Array, ends: Array) -> Array:
    """(n, m) least distances between the segments from the eye to targets and those from starts to ends.

    Ericson, Real-Time Collision Detection, 5.1.9, for segments that are not points.
    """
    d1, d2, r = (targets - eye)[:, None], (ends - starts)[None], (eye - starts)[None]
    a, e = (d1 * d1).sum(-1), (d2 * d2).sum(-1)
    b, c, f = (d1 * d2).sum(-1), (d1 * r).sum(-1), (d2 * r).sum(-1)
    denominator = a * e - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(denominator > 1e-12, np.clip((b * f - c * e) / denominator, 0.0, 1.0), 0.0)
        t = np.clip((b * s + f) / e, 0.0, 1.0)
        s = np.clip((b * t - c) / a, 0.0, 1.0)
    first, second = eye + s[..., None] * d1, starts + t[..., None] * d2
    return np.asarray(np.linalg.norm(first - second, axis=-1))


def _geometry(name: str, length: float, radius: float) -> str:
    quarter = np.linspace(0.0, math.pi / 2, _RINGS + 1)
    latitudes = [*((angle, length / 2) for angle in quarter[::-1]), *((-angle, -length / 2) for angle in quarter)]
    normals = [
        (math.cos(angle) * math.cos(turn), math.cos(angle) * math.sin(turn), math.sin(angle))
        for angle, _ in latitudes
        for turn in np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    ]
    heights = np.repeat([height for _, height in latitudes], _AROUND)
    vertices = [(x * radius, y * radius, z * radius + up) for (x, y, z), up in zip(normals, heights, strict=True)]
    lines = [f"mtllib {name}.mtl"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*vertex) for vertex in vertices]
    lines += ["vt 0.5 0.5", *("vn {:.6f} {:.6f} {:.6f}".format(*normal) for normal in normals), "usemtl skin"]
    for ring in range(len(latitudes) - 1):
        for k in range(_AROUND):
            a, b = ring * _AROUND + k + 1, ring * _AROUND + (k + 1) % _AROUND + 1
            c, d = a + _AROUND, b + _AROUND
            lines += [_triangle(a, c, d), _triangle(a, d, b)]
    return "\n".join([*lines, ""])


def _triangle(*corners: int) -> str:
    return "f " + " ".join(f"{corner}/1/{corner}" for corner in corners)
