"""The cases of ADEPT's human test: what a camera recognises in each frame, and what hides things from it."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.adept.unseen.sight import CameraSight, matrices
from benchmarks.adept.unseen.supposing import RecognisedThing
from benchmarks.real.recordings import DataError
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

ROWS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "create": ("disappear", 2, (0, 3, 4)),
    "vanish": ("disappear_fixed", 1, (0, 3, 4)),
    "short overturn": ("overturn", 0, (1,)),
    "long overturn": ("overturn", 3, (2,)),
    "visible discontinuity": ("discontinuous", 2, (3, 5, 4)),
    "invisible discontinuity": ("discontinuous", 1, (0, 5, 4)),
    "delay": ("delay", 1, (0,)),
    "block": ("block", 1, (0,)),
}
"""Of each row of the test: name of its scenes, the variant that violates physics, and those that do not."""
_CENTRE = (-1.5, 0.0, 0.0)  # m, that the camera looks at
_AWAY, _UP = 7.2, math.radians(20)
_WIDTH, _HEIGHT, _FIELD = 480, 320, math.radians(32)  # px, px, and rad from top to bottom
_SHOWN = 0.5
"""1, visible share from which a thing is recognised"""

Frame = tuple[float, float, float, float, float, float] | None


class _Body(msgspec.Struct):
    half_extents: tuple[float, float, float]
    frames: list[Frame]


class _Case(msgspec.Struct):
    dt: float
    objects: list[_Body]
    occluders: list[_Body]


class Moment(NamedTuple):
    """One frame."""

    time: float
    """s"""
    sight: CameraSight
    """The camera, with the screens that hide things"""
    percepts: list[RecognisedThing]


@dataclass(frozen=True)
class Case:
    """One video."""

    moments: tuple[Moment, ...]


def read_case(path: Path) -> Case:
    """Read a file of the data set. Raises `DataError` if it is none."""
    try:
        case = msgspec.json.decode(gzip.decompress(path.read_bytes()), type=_Case)
    except (OSError, EOFError, msgspec.DecodeError) as error:
        raise DataError(f"{path}: {error}") from error
    return Case(tuple(_moments(case)))


def _moments(case: _Case) -> Iterator[Moment]:
    for index in range(min(len(body.frames) for body in (*case.objects, *case.occluders))):
        screens = [part for body in case.occluders if (part := _part(body, index)) is not None]
        things = [(body, part) for body in case.objects if (part := _part(body, index)) is not None]
        sight = CameraSight(CAMERA, LENS, tuple(screens), tuple(f"screen {number}" for number in range(len(screens))))
        yield Moment(index * case.dt, sight, list(_recognised(sight, things)))


def _recognised(sight: CameraSight, things: Sequence[tuple[_Body, Part]]) -> Iterator[RecognisedThing]:
    """Things of which enough is seen past the screens and each other; their looks are all that tells them apart."""
    for body, part in things:
        others = tuple(other for _, other in things if other is not part)
        whole = CameraSight(sight.world_from_camera, sight.intrinsics, (*sight.obstacles, *others),
                      (*sight.names, *("thing" for _ in others)))  # fmt: skip
        share = whole.shares("", part.size, np.array([part.position]), matrices([part.rotation]))[0]
        if share >= _SHOWN:
            kind = " ".join(f"{edge:.4f}" for edge in body.half_extents)
            yield RecognisedThing(kind, part.size, np.array(part.position), part.rotation)


def _part(body: _Body, index: int) -> Part | None:
    frame = body.frames[index]
    if frame is None:
        return None
    x, y, z = body.half_extents
    return Part("box", (2 * x, 2 * y, 2 * z), frame[:3], _quaternion(frame[3:]))


def _quaternion(angles: Sequence[float]) -> Quaternion:
    x, y, z, w = Rotation.from_euler("xyz", angles).as_quat().tolist()
    return x, y, z, w


def _camera() -> tuple[Pose, Intrinsics]:
    """The camera of the data set: it looks from +x, 20 degrees from above."""
    away = np.array([math.cos(_UP), 0.0, math.sin(_UP)])
    ahead, right = -away, np.array([0.0, 1.0, 0.0])
    rotation = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    place = np.array(_CENTRE) + _AWAY * away
    focal = 0.5 * _HEIGHT / math.tan(0.5 * _FIELD)
    lens = Intrinsics(focal, focal, 0.5 * (_WIDTH - 1), 0.5 * (_HEIGHT - 1), _WIDTH, _HEIGHT)
    x, y, z = place.tolist()
    return Pose((x, y, z), quaternions.from_matrix(rotation.tolist())), lens


CAMERA, LENS = _camera()
"""world_from_camera, and the intrinsics, of the data set"""
