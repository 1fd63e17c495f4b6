"""How a hand's skin looks: a picture of its back beside one of its palm, with nails, creases and redder fingertips.

It is painted for the hand at rest of hand_flesh.py, as seen from above and from below.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.colors import SKIN
from agents.plant.hand_figure import BONES, TIPS, Side, outstretched
from agents.plant.hand_flesh import FOREARM, Flesh, at_rest

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_PER_METRE = 2000.0  # px: half a millimetre each
_MARGIN = 0.025  # m around the joints
_EDGE, _EDGE_DARKER = 0.004, 0.30  # m from the outline, and share of light lost at it: fingers are told apart there
_RED = np.array([1.02, 0.94, 0.93])  # factors of red, green, blue where blood shows
_PALE = np.array([1.06, 1.06, 1.05])
_NAIL = np.array([1.10, 1.04, 1.06])
_DARK = 0.86  # factor of a crease


class Skin(NamedTuple):
    """A picture, and where each corner of each triangle of the flesh lies in it."""

    picture: Image
    """(h, w, 3) RGB"""
    corners: Array
    """(k, 2) 0 to 1 from the left and the lower edge, of vertices that are doubled where back and palm meet"""
    vertices: NDArray[np.int64]
    """(k,) the flesh's vertex of each of them"""
    faces: NDArray[np.int32]
    """(m, 3) of them"""


@lru_cache(maxsize=4)
def skin(side: Side) -> Skin:
    """The skin of a hand."""
    flesh = at_rest(side)
    joints = outstretched(side)
    low = joints[:, :2].min(axis=0) - _MARGIN - (FOREARM, 0.0)
    high = joints[:, :2].max(axis=0) + _MARGIN
    size = np.ceil((high - low) * _PER_METRE).astype(int)
    back, palm = _views(flesh, joints, low, size)
    picture = np.concatenate([back, palm], axis=0)
    is_back = flesh.normals[flesh.faces, 2].mean(axis=1) >= 0.0
    wanted = flesh.faces + np.where(is_back, 0, len(flesh.vertices))[:, None]
    used, faces = np.unique(wanted, return_inverse=True)
    vertices, below = used % len(flesh.vertices), used >= len(flesh.vertices)
    at = (flesh.vertices[vertices, :2] - low) * _PER_METRE
    u, v = at[:, 0] / size[0], (at[:, 1] + np.where(below, size[1], 0)) / (2 * size[1])
    return Skin(
        picture, np.column_stack([u, 1.0 - v]), vertices.astype(np.int64), faces.reshape(-1, 3).astype(np.int32)
    )


def _views(flesh: Flesh, joints: Array, low: Array, size: NDArray[np.int64]) -> tuple[Image, Image]:
    """The back of the hand and its palm, seen along z."""
    pixels = (joints[:, :2] - low) * _PER_METRE
    outline = np.zeros((size[1], size[0]), np.uint8)
    for face in ((flesh.vertices[:, :2] - low) * _PER_METRE)[flesh.faces]:
        cv2.fillConvexPoly(outline, np.round(face).astype(np.int32), 1)
    depth = cv2.distanceTransform(outline, cv2.DIST_L2, 5) / _PER_METRE
    edge = 1.0 - _EDGE_DARKER * np.exp(-depth / _EDGE)
    common = _mottled(outline.shape) * edge[..., None] * np.array(SKIN)
    common = common * _blend(outline.shape, [pixels[tip] for tip in TIPS], 0.011, _RED)
    back, palm = common.copy(), common * _PALE
    back *= _blend(outline.shape, [pixels[k] for k in (5, 6, 9, 10, 13, 14, 17, 18)], 0.008, _RED)
    palm *= _blend(outline.shape, [pixels[2], 0.5 * (pixels[0] + pixels[17])], 0.02, _RED)
    for a, b in BONES:
        if a not in (0, 1, 5, 9, 13, 17):
            for offset in (-0.0016, 0.0, 0.0016):
                _crease(back, pixels[a], pixels[b], offset, 0.0055)
            _crease(palm, pixels[a], pixels[b], 0.0, 0.0075)
        elif a != 0:
            _crease(palm, pixels[a], pixels[b], 0.38 * float(np.linalg.norm(joints[b] - joints[a])), 0.0085)
    for tip in TIPS:
        _nail(back, pixels[tip - 1], pixels[tip])
    for line in _palm_lines(pixels):
        _line(palm, line, 2)
    return _image(back), _image(palm)


def _mottled(shape: tuple[int, ...]) -> Array:
    """(h, w, 3) factors near 1: skin is not of one colour."""
    rng = np.random.default_rng(5)
    found = np.ones((*shape, 3))
    for cells, amount in ((9, 0.030), (40, 0.018), (150, 0.012)):
        coarse = rng.normal(0.0, amount, (cells, cells, 1)) * np.array([0.7, 1.0, 1.0])
        found *= 1.0 + cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return found


def _blend(shape: tuple[int, ...], places: list[Array], radius: float, factors: Array) -> Array:
    """(h, w, 3) factors that act about places (2,) px, within `radius` m."""
    rows, columns = np.indices(shape)
    weight = np.zeros(shape)
    for u, v in places:
        far = ((columns - u) ** 2 + (rows - v) ** 2) / (radius * _PER_METRE) ** 2
        weight = np.maximum(weight, np.exp(-far))
    return np.asarray(1.0 + weight[..., None] * (factors - 1.0))


def _crease(view: Array, joint: Array, onwards: Array, offset: float, half: float) -> None:
    """A dark line across a finger, `offset` m beyond a joint."""
    along = (onwards - joint) / np.linalg.norm(onwards - joint)
    middle = joint + offset * _PER_METRE * along
    across = half * _PER_METRE * np.array([-along[1], along[0]])
    _line(view, np.array([middle - across, middle + 2.0 * along, middle + across]), 1)


def _line(view: Array, points: Array, thickness: int) -> None:
    mask = np.zeros(view.shape[:2], np.uint8)
    cv2.polylines(mask, [np.round(points).astype(np.int32)], False, 255, thickness, cv2.LINE_AA)
    soft = cv2.GaussianBlur(mask, (5, 5), 1.0)[..., None] / 255.0
    view *= 1.0 - (1.0 - _DARK) * np.asarray(soft, np.float64)


def _nail(view: Array, joint: Array, tip: Array) -> None:
    along = (tip - joint) / np.linalg.norm(tip - joint)
    middle = tip + 0.0005 * _PER_METRE * along
    axes = (round(0.0062 * _PER_METRE), round(0.0050 * _PER_METRE))
    turn = float(np.degrees(np.arctan2(along[1], along[0])))
    centre = (round(float(middle[0])), round(float(middle[1])))
    mask, rim = (np.zeros(view.shape[:2], np.uint8) for _ in range(2))
    cv2.ellipse(mask, centre, axes, turn, 0, 360, 255, -1, cv2.LINE_AA)
    cv2.ellipse(rim, centre, axes, turn, 100, 260, 255, 1, cv2.LINE_AA)
    view *= 1.0 + mask[..., None] / 255.0 * (_NAIL - 1.0)
    view *= 1.0 - (1.0 - _DARK) * rim[..., None] / 255.0


def _palm_lines(pixels: Array) -> list[Array]:
    """Those of heart, head and life, from the joints."""
    wrist, thumb, index, middle, little = (pixels[k] for k in (0, 2, 5, 9, 17))
    heart = [little + 0.20 * (wrist - little), 0.8 * middle + 0.2 * wrist, 0.9 * middle + 0.1 * index]
    head = [0.5 * thumb + 0.5 * index, 0.6 * middle + 0.4 * wrist, 0.55 * little + 0.45 * wrist]
    life = [0.45 * thumb + 0.55 * index, 0.4 * thumb + 0.3 * middle + 0.3 * wrist, 0.85 * wrist + 0.15 * middle]
    return [np.array(line) for line in (heart, head, life)]


def _image(view: Array) -> Image:
    return np.clip(np.round(view * 255.0), 0, 255).astype(np.uint8)
