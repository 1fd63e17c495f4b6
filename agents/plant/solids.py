"""Bodies in the physics engine: collision shapes made of parts, and what they look like."""

from __future__ import annotations

from pathlib import Path

import pybullet

from agents.plant.bullet import Bullet
from agents.plant.meshes import Color, Size, write_box, write_shape
from dsr.math3d.shapes import Shape

_KINDS = {"box": pybullet.GEOM_BOX, "cylinder": pybullet.GEOM_CYLINDER, "sphere": pybullet.GEOM_SPHERE}


def collision_shape(bullet: Bullet, size: Size, shape: Shape = ()) -> int:
    """The physics engine's number of a shape: its parts, or a solid box of `size` m without any."""
    if not shape:
        number: int = bullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[side / 2 for side in size])
        return number
    number = bullet.createCollisionShapeArray(
        shapeTypes=[_KINDS[part.kind] for part in shape],
        halfExtents=[[side / 2 for side in part.size] for part in shape],
        radii=[part.size[0] / 2 for part in shape],
        lengths=[part.size[2] for part in shape],
        collisionFramePositions=[part.position for part in shape],
        collisionFrameOrientations=[part.rotation for part in shape],
    )
    return number


def visual_shape(
    bullet: Bullet, folder: Path, name: str, size: Size, color: Color, marker_id: int | None = None, shape: Shape = ()
) -> int:
    """The physics engine's number of what it looks like; `folder` may be deleted once a body has it."""
    if shape:
        file = write_shape(folder, name, size, shape, color, marker_id)
    else:
        file = write_box(folder, name, size, color, marker_id)
    number: int = bullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(file))
    return number
