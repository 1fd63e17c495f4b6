"""Loads a robot into the physics engine: its meshes as OBJ files, with the axes that the arm controller takes them by.

The engine turns COLLADA by what the file says of `up`, which ROS does not, and knows no GLB. So both see one shape.
"""

from __future__ import annotations

import logging
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pybullet

from agents.plant.bullet import Bullet
from agents.plant.read_files import folder_to_read, name_by_content
from agents.urdf_elements import attribute, parse_urdf
from agents.urdf_files import find_mesh
from agents.xacro_file import Value, read_robot
from dsr.errors import ConfigError
from dsr.geometry import load_model
from dsr.math3d.transforms import Pose

_FLAGS = pybullet.URDF_USE_INERTIA_FROM_FILE
log = logging.getLogger("agents.plant")


def load_body(bullet: Bullet, file: Path, base: Pose, args: Mapping[str, Value] | None = None) -> int:
    """The physics engine's number of the robot in `file`, its root link fixed at `base` (world_from_root).

    `args` are arguments of its macros.

    Raises `ConfigError` for a file that cannot be read, or that the engine cannot load.
    """
    with folder_to_read() as folder:
        description = _prepared(file, folder, args)
        prepared = folder / f"{name_by_content('robot', description)}.urdf"
        prepared.write_bytes(description)
        try:
            body: int = bullet.load_urdf(str(prepared), base.t, base.q, useFixedBase=True, flags=_FLAGS)
        except pybullet.error as error:
            raise ConfigError("the physics engine cannot load it", file=str(file)) from error
    return body


def _prepared(file: Path, folder: Path, args: Mapping[str, Value] | None) -> bytes:
    """The description with its meshes written to `folder`."""

    def prepare(root: ET.Element) -> bytes:
        for link in root.findall("link"):
            for kind in ("collision", "visual"):
                for shape in link.findall(kind):
                    _replace_mesh(link, shape, file.parent, folder)
        return ET.tostring(root)

    return parse_urdf(read_robot(file, args), str(file), prepare)


def _replace_mesh(link: ET.Element, shape: ET.Element, beside: Path, folder: Path) -> None:
    """Write the mesh of a shape to `folder`. One that is drawn only and not found is left out, and told."""
    mesh = shape.find("geometry/mesh")
    if mesh is None:
        return
    try:
        source = find_mesh(attribute(mesh, "filename"), beside)
        written = _written(source, folder)
    except (ValueError, ConfigError) as error:
        if shape.tag == "collision":
            raise ValueError(f"link {link.get('name')!r}: {error}") from error
        log.warning("link %r is not drawn: %s", link.get("name"), error)
        link.remove(shape)
    else:
        mesh.set("filename", str(written))


def _written(source: Path, folder: Path) -> Path:
    """An OBJ file with the triangles of a mesh file, each of its meshes as an object, which is one convex hull."""
    model = load_model(source, up="z")
    lines: list[str] = []
    frames: dict[str, Pose] = {}
    first = 1
    for node in model.nodes:
        frames[node.name] = node.pose if node.parent is None else frames[node.parent] @ node.pose
        for mesh in node.meshes:
            lines.append(f"o part_{first}")
            points = frames[node.name].apply(mesh.vertices.astype(np.float64))
            lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
            lines += [f"f {a + first} {b + first} {c + first}" for a, b, c in mesh.triangles.tolist()]
            first += len(points)
    shape = "\n".join([*lines, ""]).encode("ascii")
    file = folder / f"{name_by_content('mesh', shape)}.obj"
    file.write_bytes(shape)
    return file
