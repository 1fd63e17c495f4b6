"""How much of each object a camera should see: rays from the camera to the tags, cut off by boxes.

No physics engine is asked: a `Sight` is cheap, deterministic, and can be sent to another process.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr import quaternions
from dsr.intrinsics import Intrinsics
from dsr.transforms import Pose
from simulation_handler.geometry import Solid

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TAG_RATIO = 0.8
"""Side of a tag over the shorter side of the face (+z) that carries it."""
STEEPEST = math.radians(75)
"""rad between a tag's normal and the viewing ray, beyond which it is not found"""
SMALLEST = 12.0
"""px, the side of the smallest tag that is found"""

_GRID = 5  # rays along each side of a tag
_REACH = 0.95  # of half a tag's side, up to which the rays go
_GAP = 5e-4  # m before its target at which a ray counts as having arrived
_MARGIN = 0.005  # m around an obstacle within which a camera counts as part of it
_LEAST = 1e-12  # stands for the direction cosine of a ray that is parallel to a face

_SIDE = np.linspace(-_REACH, _REACH, _GRID)
_RAYS = np.stack(np.meshgrid(_SIDE, _SIDE), axis=-1).reshape(-1, 2)  # (rays, 2), in half sides of the tag


@dataclass(frozen=True)
class View:
    """A camera and where it is."""

    camera: str
    """Name of its node."""
    world_from_camera: Pose
    """Of the optical frame: z forward, x right, y down."""
    intrinsics: Intrinsics


class Glance(NamedTuple):
    """What a camera should see of one object."""

    share: float
    """Of the tag's area, 0 to 1."""
    hidden_by: str
    """The solid or obstacle that hides most of the tag; empty if nothing does."""


class _Boxes(NamedTuple):
    """n boxes."""

    names: list[str]
    centre: Array
    """(n, 3) m"""
    turn: Array
    """(n, 3, 3) world_from_box"""
    half: Array
    """(n, 3) m, half the edge lengths"""
    radius: Array
    """(n,) m, from the centre to a corner"""

    @staticmethod
    def of(solids: Sequence[Solid]) -> _Boxes:
        half = 0.5 * np.array([solid.size for solid in solids], dtype=np.float64).reshape(-1, 3)
        turns = [quaternions.to_matrix(solid.rotation) for solid in solids]
        return _Boxes(
            [solid.name for solid in solids],
            np.array([solid.position for solid in solids], dtype=np.float64).reshape(-1, 3),
            np.array(turns, dtype=np.float64).reshape(-1, 3, 3),
            half,
            np.sqrt((half * half).sum(axis=1)),
        )

    def and_also(self, others: _Boxes) -> _Boxes:
        arrays = [np.concatenate(pair) for pair in zip(self[1:], others[1:], strict=True)]
        return _Boxes(self.names + others.names, *arrays)

    def without(self, left_out: Flags) -> _Boxes:
        kept = ~left_out
        return _Boxes([name for name, keep in zip(self.names, kept, strict=True) if keep], *(a[kept] for a in self[1:]))

    def contain(self, point: Array, margin: float) -> Flags:
        """(n,) whether a point (3,) is inside, or outside by at most `margin` m."""
        inside: Flags = np.all(np.abs(self.into(point)) <= self.half + margin, axis=1)
        return inside

    def into(self, point: Array) -> Array:
        """(n, 3) a point (3,) of the world in the frame of each box."""
        local: Array = ((point - self.centre)[:, None, :] @ self.turn)[:, 0]
        return local


class _Camera:
    """A view made ready for many looks."""

    def __init__(self, view: View, obstacles: _Boxes) -> None:
        self.view = view
        self.eye = np.array(view.world_from_camera.t)
        self.turn = np.array(quaternions.to_matrix(view.world_from_camera.q))
        self.obstacles = obstacles.without(obstacles.contain(self.eye, _MARGIN))


class Sight:
    """What some cameras should see.

    Args:
        views: the cameras.
        obstacles: boxes that hide and are not looked for, such as parts of the arm. One that a camera is in hides
            nothing from that camera.
    """

    def __init__(self, views: Sequence[View], obstacles: Sequence[Solid] = ()) -> None:
        boxes = _Boxes.of(obstacles)
        self._cameras = [_Camera(view, boxes) for view in views]

    def shares(self, solids: Sequence[Solid]) -> dict[tuple[str, str], float]:
        """Share (0 to 1) of the tag of each solid that each camera should see, by (camera, name).

        A tag is a square of `TAG_RATIO` in the middle of the +z face. One that faces away by more than `STEEPEST`
        or would be smaller than `SMALLEST` counts as unseen, as does what lies outside the image.
        """
        boxes = _Boxes.of(solids)
        return {
            (camera.view.camera, name): share
            for camera in self._cameras
            for name, share in zip(boxes.names, _look(camera, boxes)[0].tolist(), strict=True)
        }

    def glances(self, solids: Sequence[Solid]) -> dict[tuple[str, str], Glance]:
        """The same, also saying what hides most of each tag."""
        boxes, found = _Boxes.of(solids), {}
        for camera in self._cameras:
            shares, hiding = _look(camera, boxes)
            names = boxes.names + camera.obstacles.names
            for index, (name, share) in enumerate(zip(boxes.names, shares.tolist(), strict=True)):
                most = int(hiding[index].argmax())
                hidden_by = names[most] if hiding[index, most] > 0 else ""
                found[camera.view.camera, name] = Glance(share, hidden_by)
        return found


def _look(camera: _Camera, solids: _Boxes) -> tuple[Array, NDArray[np.int64]]:
    """Shares (n,) of the tags of n solids, and how many rays (n, n + obstacles) each solid and obstacle cuts off."""
    targets = _targets(solids)
    seen = _found(camera, solids, targets)
    boxes = solids.and_also(camera.obstacles)
    hiding = np.zeros((len(solids.names), len(boxes.names)), dtype=np.int64)
    face, box = _candidates(camera.eye, targets, seen, boxes)
    if len(face):
        cut_off = _cut_off(camera.eye, targets[face], boxes, box) & seen[face]
        hiding[face, box] = cut_off.sum(axis=1)
        hidden = np.zeros_like(seen)
        np.logical_or.at(hidden, face, cut_off)
        seen &= ~hidden
    return seen.mean(axis=1), hiding


def _targets(solids: _Boxes) -> Array:
    """(n, rays, 3) points of the tags, m in the world frame."""
    half = TAG_RATIO * solids.half[:, :2].min(axis=1)
    local = np.empty((len(solids.names), len(_RAYS), 3))
    local[:, :, :2] = _RAYS * half[:, None, None]
    local[:, :, 2] = solids.half[:, 2, None]
    points: Array = local @ solids.turn.transpose(0, 2, 1) + solids.centre[:, None, :]
    return points


def _found(camera: _Camera, solids: _Boxes, targets: Array) -> Flags:
    """(n, rays) which points of the tags would be seen if nothing were in the way."""
    lens = camera.view.intrinsics
    points = (targets - camera.eye) @ camera.turn
    depth = points[..., 2]
    ahead = depth > _LEAST
    safe = np.where(ahead, depth, 1.0)
    u, v = points[..., 0] / safe * lens.fx + lens.cx, points[..., 1] / safe * lens.fy + lens.cy
    inside: Flags = ahead & (u >= 0) & (u <= lens.width - 1) & (v >= 0) & (v <= lens.height - 1)
    middle = len(_RAYS) // 2
    ray = targets[:, middle] - camera.eye
    cosine = -(ray * solids.turn[:, :, 2]).sum(axis=1)
    side = 2 * TAG_RATIO * solids.half[:, :2].min(axis=1) * lens.fx
    found: Flags = cosine >= math.cos(STEEPEST) * np.sqrt((ray * ray).sum(axis=1))
    found &= side >= SMALLEST * safe[:, middle]
    inside &= found[:, None]
    return inside


def _candidates(eye: Array, targets: Array, seen: Flags, boxes: _Boxes) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs (tag, box) of which the box may hide the tag: its ball meets the tube around the rays to the tag."""
    ray = targets[:, len(_RAYS) // 2] - eye
    corner = targets[:, 0] - targets[:, len(_RAYS) // 2]
    to_box = boxes.centre - eye
    along = np.clip((ray @ to_box.T) / np.maximum((ray * ray).sum(axis=1), _LEAST)[:, None], 0.0, 1.0)
    gap = to_box[None] - along[:, :, None] * ray[:, None]
    reach: Array = boxes.radius[None] + np.sqrt((corner * corner).sum(axis=1))[:, None]
    near: Flags = np.less_equal((gap * gap).sum(axis=2), reach * reach)
    near &= np.any(seen, axis=1)[:, None]
    np.fill_diagonal(near, False)  # no convex face is hidden by its own body
    face, box = np.nonzero(near)
    return face, box


def _cut_off(eye: Array, targets: Array, boxes: _Boxes, box: NDArray[np.int64]) -> Flags:
    """(k, rays) which rays to the points (k, rays, 3) meet box `box[k]` before (slabs: Kay and Kajiya, 1986)."""
    way = targets - eye
    direction = way @ boxes.turn[box]
    direction = np.where(np.abs(direction) < _LEAST, _LEAST, direction)
    start, half = boxes.into(eye)[box][:, None], boxes.half[box][:, None]
    one, other = (-half - start) / direction, (half - start) / direction
    enters, leaves = np.minimum(one, other).max(axis=2), np.maximum(one, other).min(axis=2)
    arrived = 1.0 - _GAP / np.maximum(np.sqrt((way * way).sum(axis=2)), _GAP)
    cut_off: Flags = (enters < leaves) & (leaves > 0.0) & (enters < arrived)
    return cut_off
