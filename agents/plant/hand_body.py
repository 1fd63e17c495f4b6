"""What a hand looks like in the physics client: a mesh of flesh in its skin, and a sleeve.

The physics client cannot bend a mesh, so a hand whose figure changes gets another body.
"""

from __future__ import annotations

import functools
import math
import tempfile
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.colors import SLEEVE
from agents.plant.bullet import Bullet
from agents.plant.hand_figure import Side
from agents.plant.hand_flesh import flesh
from agents.plant.hand_skin import Skin, skin
from agents.plant.read_files import folder_to_read
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]

NOWHERE = Pose((0.0, 0.0, -50.0))
"""Where no camera looks."""
SLEEVE_LENGTH, SLEEVE_RADIUS = 0.22, 0.028
"""m"""
_AROUND = 12
_RINGS = 3  # of each cap
_FIGURES = 4  # that keep their bodies: a hand that comes, opens, closes and goes has these again and again
_ALIKE = 4  # decimals of m, to which fingertips are told apart: a tenth of a millimetre is not seen


class HandBody:
    """The body of one hand.

    Args:
        bullet: the physics client.
        side: of the hand.
    """

    def __init__(self, bullet: Bullet, side: Side) -> None:
        self._bullet = bullet
        self._side: Side = side
        self._figures: OrderedDict[bytes, int] = OrderedDict()
        with folder_to_read() as folder:
            self._sleeve = self._make(write_capsule(folder, "sleeve", SLEEVE_LENGTH, SLEEVE_RADIUS, SLEEVE))

    def put(self, pose: Pose, tips: Array, forearm: tuple[Array, Array]) -> None:
        """Show the hand at world_from_palm, fingertips (5, 3) in the palm's frame, and its sleeve between points."""
        figure = self._figure(tips)
        for body in self._figures.values():
            self._bullet.set_pose(body, pose if body == figure else NOWHERE)
        self._bullet.set_pose(self._sleeve, capsule_pose(*forearm))

    def hide(self) -> None:
        """Show nothing."""
        for body in (*self._figures.values(), self._sleeve):
            self._bullet.set_pose(body, NOWHERE)

    def _figure(self, tips: Array) -> int:
        """The body for these fingertips; the figure that was shown least lately goes."""
        key = np.round(tips, _ALIKE).tobytes()
        if key not in self._figures:
            while len(self._figures) >= _FIGURES:
                self._bullet.remove_body(self._figures.popitem(last=False)[1])
            self._figures[key] = self._make_flesh(tips)
        self._figures.move_to_end(key)
        return self._figures[key]

    def _make_flesh(self, tips: Array) -> int:
        beside = Path(_skin_folder(self._side).name)
        with tempfile.NamedTemporaryFile("w", suffix=".obj", dir=beside, encoding="ascii") as file:  # a name of its own
            file.write(_mesh(tips, self._side, skin(self._side)))
            file.flush()
            return self._make(Path(file.name))

    def _make(self, file: Path) -> int:
        visual = self._bullet.visual_mesh(file, specularColor=(0.0, 0.0, 0.0))
        body: int = self._bullet.create_body(0, -1, visual, NOWHERE.t, NOWHERE.q)
        if self._bullet.looks is not None:
            self._bullet.looks.forget(str(file))
        return body


@functools.cache
def _skin_folder(side: Side) -> tempfile.TemporaryDirectory[str]:
    """Where the skin of hands of this side is, while this process runs.

    The physics engine keeps a picture for each file name.
    """
    folder = tempfile.TemporaryDirectory(prefix="dsr-hand-")
    cv2.imwrite(f"{folder.name}/hand.png", cv2.cvtColor(skin(side).picture, cv2.COLOR_RGB2BGR))
    (Path(folder.name) / "hand.mtl").write_text(_material("hand"), encoding="ascii")
    return folder


def write_capsule(folder: Path, name: str, length: float, radius: float, color: Vector3) -> Path:
    """Write a capsule about z, `length` m between the centres of its ends; `color` is red, green, blue, 0 to 1."""
    bgr = np.round(np.array(color[::-1]) * 255).astype(np.uint8)
    cv2.imwrite(str(folder / f"{name}.png"), np.full((8, 8, 3), bgr, np.uint8))
    (folder / f"{name}.mtl").write_text(_material(name), encoding="utf-8")
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


def _material(name: str) -> str:
    return f"newmtl surface\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {name}.png\n"


def _mesh(tips: Array, side: Side, dress: Skin) -> str:
    """A hand as an OBJ file, in the palm's frame."""
    shape = flesh(tips, side)
    lines = ["mtllib hand.mtl"]
    lines += ["v {:.5f} {:.5f} {:.5f}".format(*vertex) for vertex in shape.vertices[dress.vertices].tolist()]
    lines += ["vt {:.4f} {:.4f}".format(*corner) for corner in dress.corners.tolist()]
    lines += ["vn {:.3f} {:.3f} {:.3f}".format(*normal) for normal in shape.normals[dress.vertices].tolist()]
    lines += ["usemtl surface"]
    lines += ["f {0}/{0}/{0} {1}/{1}/{1} {2}/{2}/{2}".format(*face) for face in (dress.faces + 1).tolist()]
    return "\n".join([*lines, ""])


def _geometry(name: str, length: float, radius: float) -> str:
    """Of a capsule, as an OBJ file."""
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
    lines += ["vt 0.5 0.5", *("vn {:.6f} {:.6f} {:.6f}".format(*normal) for normal in normals), "usemtl surface"]
    for ring in range(len(latitudes) - 1):
        for k in range(_AROUND):
            a, b = ring * _AROUND + k + 1, ring * _AROUND + (k + 1) % _AROUND + 1
            c, d = a + _AROUND, b + _AROUND
            lines += [_triangle(a, c, d), _triangle(a, d, b)]
    return "\n".join([*lines, ""])


def _triangle(*corners: int) -> str:
    return "f " + " ".join(f"{corner}/1/{corner}" for corner in corners)
