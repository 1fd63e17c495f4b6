"""Targets of a calibration: what they are called, where their points are, and how these are found in a grey image.

Points of grids, boards and squares are in a frame with x right, y down and z away from one who looks at the target.
Those of tags are in the frame of `tag_corners`: x right, y up and z towards the one who looks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.circles import find_circles
from agents.calibrator.hand_eye.grids import upright
from agents.calibrator.hand_eye.square import find_square
from agents.scene_estimator.detection import TagDetector, tag_corners
from dsr.config.toml import TomlFile
from dsr.errors import ConfigError
from dsr.math3d.transforms import Array, Pose

FORMS = (
    "circles:COLUMNSxROWS:SPACING",
    "chessboard:COLUMNSxROWS:SPACING",
    "tag36h11:NUMBER:SIDE",
    "tags:FILE",
    "square:SIDE",
)
"""What a target may be called; lengths are in m"""
_MOST_POINTS = 2500
"""Points of a target: a chessboard of 50 by 50"""
_LONGEST = 10.0
"""m, side of a target: a larger number is none of metres"""
_MOST_ID = 586
"""Of the family 36h11"""


class Target(NamedTuple):
    """A thing whose points can be found in images."""

    name: str
    points: Array
    """(n, 3) m"""
    symmetries: NDArray[np.intp]
    """(s, n) orders of the points that look alike; the first is the identity"""
    find: Callable[[NDArray[np.uint8]], Array | None]
    """(n, 2) px of the points in a grey image, NaN of hidden ones; None if the target does not show"""


class TagPlace(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A tag of a layout."""

    id: int
    size: float
    """m, side of the black square"""
    translation: tuple[float, float, float]
    """m, its centre in the target's frame"""
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion (x, y, z, w): target_from_tag"""


class TagLayout(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file that tells where tags are."""

    tag: tuple[TagPlace, ...]


def read_target(name: str) -> Target:
    """The target of that name, in one of `FORMS`. Raises `ConfigError` for what is none."""
    kind, _, rest = name.partition(":")
    makers: Mapping[str, Callable[[str, str], Target]] = {
        "circles": _circles, "chessboard": _chessboard, "tag36h11": _tag, "tags": _tags, "square": _square,
    }  # fmt: skip
    if kind not in makers or not rest:
        raise ConfigError(f"target {name!r}: expected {', '.join(FORMS[:-1])} or {FORMS[-1]}, lengths in m")
    return makers[kind](name, rest)


def tags_target(name: str, places: Sequence[TagPlace]) -> Target:
    """Tags of the family 36h11 at known places. Raises `ConfigError` for none, or for one twice."""
    ids = [place.id for place in places]
    if not places or len(set(ids)) < len(ids) or not all(0 <= one <= _MOST_ID for one in ids):
        raise ConfigError(f"target {name!r}: expected tags with different ids from 0 to {_MOST_ID}, not {ids}")
    corners = []
    for place in places:
        try:
            pose = Pose(place.translation, place.rotation)
        except ValueError as error:
            raise ConfigError(f"target {name!r}: tag {place.id}: {error}") from error
        corners.append(pose.apply(tag_corners(_length(name, place.size))))
    detector = TagDetector()

    def find(grey: NDArray[np.uint8]) -> Array | None:
        seen = {tag.marker_id: tag.corners for tag in detector.detect(np.repeat(grey[..., None], 3, axis=2))}
        if not seen.keys() & set(ids):
            return None
        return np.concatenate([seen.get(one, np.full((4, 2), np.nan)) for one in ids])

    return Target(name, np.concatenate(corners), np.arange(4 * len(ids))[None], find)


def _circles(name: str, rest: str) -> Target:
    columns, rows, spacing = _grid(name, rest)
    return _grid_target(name, columns, rows, spacing, lambda grey: find_circles(grey, columns, rows))


def _chessboard(name: str, rest: str) -> Target:
    columns, rows, spacing = _grid(name, rest)

    def find(grey: NDArray[np.uint8]) -> Array | None:
        flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
        is_found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), flags=flags)
        if not is_found:
            return None
        return upright(np.asarray(corners, np.float64).reshape(rows, columns, 2)).reshape(-1, 2)

    return _grid_target(name, columns, rows, spacing, find)


def _grid_target(
    name: str, columns: int, rows: int, spacing: float, find: Callable[[NDArray[np.uint8]], Array | None]
) -> Target:
    y, x = np.mgrid[:rows, :columns]
    points = spacing * np.stack([x, y, np.zeros_like(x)], axis=2).reshape(-1, 3)
    order = np.arange(rows * columns).reshape(rows, columns)
    turns = range(4) if rows == columns else (0, 2)
    return Target(name, points, np.array([np.rot90(order, turn).ravel() for turn in turns]), find)


def _tag(name: str, rest: str) -> Target:
    number, _, side = rest.partition(":")
    if not number.isdecimal():
        raise ConfigError(f"target {name!r}: expected {FORMS[2]}, such as tag36h11:7:0.05")
    return tags_target(name, [TagPlace(int(number), _length(name, side), (0.0, 0.0, 0.0))])


def _tags(name: str, rest: str) -> Target:
    return tags_target(name, TomlFile(Path(rest)).convert(TagLayout).tag)


def _square(name: str, rest: str) -> Target:
    half = 0.5 * _length(name, rest)
    points = half * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    return Target(name, points, np.array([np.roll(np.arange(4), -turn) for turn in range(4)]), find_square)


def _grid(name: str, rest: str) -> tuple[int, int, float]:
    counts, _, spacing = rest.partition(":")
    columns, _, rows = counts.partition("x")
    if not (columns.isdecimal() and rows.isdecimal() and min(int(columns), int(rows)) >= 3):
        raise ConfigError(f"target {name!r}: expected COLUMNSxROWS of 3 or more, then the spacing, such as 8x6:0.025")
    if int(columns) * int(rows) > _MOST_POINTS:
        raise ConfigError(f"target {name!r}: expected at most {_MOST_POINTS} points")
    return int(columns), int(rows), _length(name, spacing)


def _length(name: str, text: str | float) -> float:
    try:
        length = float(text)
    except ValueError:
        length = math.nan
    if not 0.0 < length < _LONGEST:
        raise ConfigError(f"target {name!r}: length {str(text)!r}: expected m, between 0 and {_LONGEST:g}")
    return length
