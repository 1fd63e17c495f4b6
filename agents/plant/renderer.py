"""Pictures of a physics world: by OpenGL where that works, else by pybullet's own software renderer."""

from __future__ import annotations

import logging
from typing import Any, Literal

import msgspec
import numpy as np
import pybullet
from numpy.typing import NDArray

from agents.plant.bullet import Bullet
from agents.plant.looks import Looks
from agents.plant.opengl import Light, OpenGl
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

log = logging.getLogger("agents.plant.renderer")

RendererName = Literal["auto", "opengl", "tiny"]

NEAR, FAR = 0.02, 8.0
"""m, the planes between which the renderer sees"""
_GL_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
_UPSIDE_DOWN = np.diag([1.0, -1.0, 1.0, 1.0])  # the first row of OpenGL's images is the lowest
_LIGHT = Light(towards=(0.5, -0.8, 2.0), ambient=0.672, diffuse=0.336, sky=(1.0, 1.0, 1.0))
_TINY_LIGHT = {
    "lightDirection": _LIGHT.towards,
    "lightDistance": 3.0,
    "lightAmbientCoeff": _LIGHT.ambient,
    "lightDiffuseCoeff": _LIGHT.diffuse,
    "lightSpecularCoeff": 0.0,
    "shadow": 0,
}
_TINY_SHIFT = (-0.5, 0.5)  # px, where TinyRenderer's principal point is to be asked for, measured
_BODY_MASK = (1 << 24) - 1
_UNMOVED = 1e-6
"""m, rad or 1 (of a quaternion) up to which nothing has moved for the eye: a hundredth of a pixel at the nearest."""


class RenderedPicture(msgspec.Struct, frozen=True):
    """The images of an ideal camera: colour, depth and bodies, without noise. They cannot be written to."""

    color: NDArray[np.uint8]
    """(h, w, 3) colours, RGB, 0 to 255."""
    depth: NDArray[np.float32]
    """(h, w) m along the optical axis"""
    bodies: NDArray[np.int32] | None
    """(h, w) the physics engine's number of the body seen, negative for none; None if not asked for"""


class _Shot(msgspec.Struct, frozen=True):
    """A picture, and all that it depends on but the looks of bodies, which never change."""

    asked: tuple[Intrinsics, bool]
    state: NDArray[np.float64]
    picture: RenderedPicture

    def shows(self, asked: tuple[Intrinsics, bool], state: NDArray[np.float64]) -> bool:
        """Whether the picture would be the same."""
        return (
            asked == self.asked
            and state.shape == self.state.shape
            and bool(np.all(np.abs(state - self.state) <= _UNMOVED))
        )


class Renderer:
    """Renders the world of one physics client; as long as nothing moves, the picture of a camera is made once.

    Args:
        bullet: the physics client, still without bodies: OpenGL does not draw those that were there before it.
        wanted: `auto` and `opengl` prefer OpenGL, `tiny` is the software renderer of the physics engine.
    """

    def __init__(self, bullet: Bullet, wanted: RendererName = "auto") -> None:
        self._bullet = bullet
        self._last: dict[str, _Shot] = {}
        """The last picture of each camera"""
        self._opengl: OpenGl | None = None
        if wanted != "tiny":
            looks = Looks()
            try:
                self._opengl = OpenGl(looks, _LIGHT)
            except OSError as error:
                log.warning("rendering in software, several times slower: %s", error)
            else:
                bullet.looks = looks

    @property
    def name(self) -> str:
        """`opengl` or `tiny`."""
        return "tiny" if self._opengl is None else "opengl"

    def render(
        self, world_from_camera: Pose, intrinsics: Intrinsics, *, bodies: bool = False, camera: str = ""
    ) -> RenderedPicture:
        """The world seen from `world_from_camera` (optical frame), with body numbers if `bodies`.

        The last picture of each `camera`, by its name, is kept.
        """
        asked, state, shot = (intrinsics, bodies), self._state(world_from_camera), self._last.get(camera)
        if shot is None or not shot.shows(asked, state):
            shot = self._last[camera] = _Shot(asked, state, self._draw(world_from_camera, intrinsics, bodies))
        return shot.picture

    def _state(self, world_from_camera: Pose) -> NDArray[np.float64]:
        """Which bodies there are, where they and the camera are, and how their joints are."""
        bullet = self._bullet
        values: list[float] = [bullet.changes, *world_from_camera.t, *world_from_camera.q]
        for index in range(bullet.getNumBodies()):
            body = bullet.getBodyUniqueId(index)
            position, rotation = bullet.getBasePositionAndOrientation(body)
            values += [body, *position, *rotation]
            if joints := bullet.getNumJoints(body):
                values += [state[0] for state in bullet.getJointStates(body, range(joints))]
        return np.array(values)

    def _draw(self, world_from_camera: Pose, intrinsics: Intrinsics, bodies: bool) -> RenderedPicture:
        opengl = self._opengl
        if opengl is None:
            return self._draw_tiny(world_from_camera, intrinsics, bodies)
        clip_from_camera = _UPSIDE_DOWN @ _projection(intrinsics, (0.0, 0.0)) @ _GL_FROM_OPTICAL
        places, size = self._bullet.links(opengl.bodies), (intrinsics.width, intrinsics.height)
        clip_from_world = clip_from_camera @ world_from_camera.inverse().matrix
        color, depth, numbers = opengl.draw(clip_from_world, places, size, bodies=bodies)
        return RenderedPicture(_kept(color), _kept(depth), None if numbers is None else _kept(numbers))

    def _draw_tiny(self, world_from_camera: Pose, intrinsics: Intrinsics, bodies: bool) -> RenderedPicture:
        _, _, color, depth, segments = self._bullet.getCameraImage(
            intrinsics.width,
            intrinsics.height,
            _column_major(_GL_FROM_OPTICAL @ world_from_camera.inverse().matrix),
            _column_major(_projection(intrinsics, _TINY_SHIFT)),
            renderer=pybullet.ER_TINY_RENDERER,
            flags=0 if bodies else pybullet.ER_NO_SEGMENTATION_MASK,
            **_TINY_LIGHT,
        )
        shape = (intrinsics.height, intrinsics.width)
        rgb = np.reshape(np.asarray(color, np.uint8), (*shape, 4))[..., :3]
        return RenderedPicture(
            _kept(np.ascontiguousarray(rgb)),
            _kept(_metric(np.reshape(np.asarray(depth, np.float32), shape))),
            _kept(_body_numbers(np.reshape(np.asarray(segments, np.int32), shape))) if bodies else None,
        )

    def close(self) -> None:
        """Free what OpenGL keeps; harmless when repeated."""
        if self._opengl is not None:
            self._opengl.close()
            self._opengl = self._bullet.looks = None


def opengl_works() -> bool:
    """Whether OpenGL renders here without a window."""
    try:
        OpenGl(Looks(), _LIGHT).close()
    except OSError:
        return False
    return True


def _projection(intrinsics: Intrinsics, shift: tuple[float, float]) -> NDArray[np.float64]:
    """(4, 4) OpenGL projection of the camera, with the principal point `shift` px away."""
    cx, cy = intrinsics.cx + shift[0], intrinsics.cy + shift[1]
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[0, 2] = 2 * intrinsics.fx / intrinsics.width, 1 - (2 * cx + 1) / intrinsics.width
    matrix[1, 1], matrix[1, 2] = 2 * intrinsics.fy / intrinsics.height, (2 * cy + 1) / intrinsics.height - 1
    matrix[2, 2], matrix[2, 3] = -(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
    matrix[3, 2] = -1
    return matrix


def _metric(buffer: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth in m of an OpenGL depth buffer (0 near, 1 far); 0 where nothing was seen."""
    depth = np.float32(FAR * NEAR) / (np.float32(FAR) - np.float32(FAR - NEAR) * buffer)
    return np.where(buffer < 1.0, depth, np.float32(0.0))


def _body_numbers(segments: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.where(segments >= 0, segments & _BODY_MASK, -1)


def _kept(image: NDArray[Any]) -> NDArray[Any]:
    """The image, which nobody may write to: it may be shown again."""
    image.setflags(write=False)
    return image


def _column_major(matrix: NDArray[np.float64]) -> list[float]:
    values: list[float] = matrix.T.ravel().tolist()
    return values
