"""Reads the collision shapes of a robot description (URDF), each as boxes around it.

https://wiki.ros.org/urdf/XML/link. SI units. The shapes are boxes, cylinders, spheres and meshes. Whatever else there
is, and a mesh that is not found, is refused: the arm would be planned for as if there were nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from agents.arm_controller.model.mesh_boxes import boxes_around
from agents.arm_controller.model.shapes import LinkBox
from agents.urdf_elements import attribute, collision_solid, origin, vector
from agents.urdf_files import find_mesh
from dsr.errors import ConfigError
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

_UNSCALED: Vector3 = (1.0, 1.0, 1.0)


def read_boxes(link: ET.Element, folder: Path) -> tuple[LinkBox, ...]:
    """The boxes around the collision shapes of a <link> of a description in `folder`.

    ValueError for a shape that is not known, has no volume, or cannot be read.
    """
    return tuple(
        box.seen_from(origin(shape.find("origin")))
        for shape in link.findall("collision")
        for box in _boxes(attribute(link, "name"), shape, folder)
    )


def _boxes(link: str, collision: ET.Element, folder: Path) -> tuple[LinkBox, ...]:
    """The boxes around a <collision> of the link of that name, in its own frame."""
    meshes = collision.findall("geometry/mesh")
    try:
        if len(meshes) == 1 and len(collision.findall("geometry/*")) == 1:
            file = find_mesh(attribute(meshes[0], "filename"), folder)
            return boxes_around(file, _scale(meshes[0]))
        kind, (x, y, z) = collision_solid(collision)
    except (ValueError, ConfigError) as error:
        raise ValueError(f"link {link!r}: {error}") from error
    if min(x, y, z) <= 0.0:
        raise ValueError(f"link {link!r}: its collision <{kind}> has no volume; expected lengths above 0 m")
    return (LinkBox(Pose.identity(), (x / 2, y / 2, z / 2)),)


def _scale(mesh: ET.Element) -> Vector3:
    scale = vector(mesh, "scale", _UNSCALED)
    if not all(scale):
        raise ValueError(f"<mesh scale={mesh.get('scale')!r}>: expected no zero")
    return scale
