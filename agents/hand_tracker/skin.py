"""The degraded way to find hands, without a model: skin colour within a band of depth, contours, fingertips.

It takes every patch of skin colour of the right size for a hand, does not tell left from right nor which finger is
which, and sees the outermost visible end of a finger as its tip. Two hands that touch are one to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.frame_images import Color, Depth
from agents.hand_tracker.config import HandTrackerConfig, SkinModel
from agents.hand_tracker.depth import behind_surface, depth_at, images_with_depth
from agents.hand_tracker.fingertips import Patch, Tip, fingertips
from agents.hand_tracker.sighting import Outline, SeenHand, Source
from dsr.images.blobs import Frame
from dsr.math3d import quaternions
from dsr.math3d.quaternions import Quaternion
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_GOES_ON = 0.03  # m, of the depth between a hand and what goes on from it
_GAP = 0.006  # m, between the outline and that: pixels at its edge are of neither colour
_AROUND = 0.06  # m about the hand in which that is looked for
_LEAST_AREA = 0.002  # m^2 of it there: less is an object in the hand
_LEAST_WIDTH = 0.015  # m, of where it begins
_BACK = 0.5  # cosine between the directions to a tip and to the wrist, above which that is none
_AGREE = 0.8  # length of the mean of the unit vectors to where it begins; at less it does so on several sides


def find_wrist(patch: Patch, middle: Array, body: Mask, depth: NDArray[np.float32], focal: float) -> Array | None:
    """Where the arm begins (2,) px; None if nothing tells, or more than one thing goes on from the hand.

    Args:
        patch: the hand.
        middle: (2,) px, of its palm.
        body: (h, w) what is above the table and near enough, but not of the colour of skin.
        depth: (h, w) m, 0 where it is not known.
        focal: px, of the camera.
    """
    metre = focal / patch.distance  # px
    margin, gap = math.ceil(_AROUND * metre), max(2, round(_GAP * metre))
    rows, columns = _window(patch, margin, depth.shape)
    inside = np.zeros(depth.shape, np.uint8)
    height, width = patch.inside.shape
    u, v = patch.corner
    inside[v : v + height, u : u + width] = patch.inside
    hand, near = inside[rows, columns], depth[rows, columns]
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * gap + 1, 2 * gap + 1))
    beside = cv2.dilate(np.where(hand > 0, near, np.float32(0.0)), kernel)
    ring = (beside > 0) & (hand == 0)
    others = body[rows, columns] & (near > 0) & (hand == 0)
    edge = _edge(rows, columns, depth.shape)
    begins = ring & (np.abs(near - beside) < _GOES_ON)
    found = [*_begins(others, begins, edge, metre), _pixels((hand > 0) & edge)]
    places = np.concatenate(found) + np.array((columns.start, rows.start))
    if len(places) < _LEAST_WIDTH * metre:
        return None
    directions = places - middle
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    return places.mean(axis=0) if np.linalg.norm(directions.mean(axis=0)) >= _AGREE else None


def is_cut(patch: Patch, depth: Depth, focal: float) -> bool:
    """Whether something in front of a hand, or the edge of the image, hides a part of it for all that is known.

    Args:
        patch: the hand.
        depth: (h, w) m, 0 where it is not known.
        focal: px, of the camera.
    """
    rows, columns = _window(patch, 2 * _BESIDE, depth.shape)
    inside = np.zeros(depth.shape, np.uint8)
    height, width = patch.inside.shape
    u, v = patch.corner
    inside[v : v + height, u : u + width] = patch.inside
    hand, near = inside[rows, columns], depth[rows, columns]
    if (_edge(rows, columns, depth.shape) & (hand > 0)).any():
        return True
    kernel = np.ones((2 * _BESIDE + 1, 2 * _BESIDE + 1), np.uint8)
    nearest = cv2.erode(np.where((hand > 0) & (near > 0), near, _FAR), kernel)
    beside = (hand == 0) & (near > 0) & (nearest < _FAR)
    in_front = beside & (near < nearest - _JUMP)
    return float(in_front.sum()) / _BESIDE > _LEAST_CUT * focal / patch.distance


def away_from(wrist: Array, middle: Array, tips: Sequence[Tip]) -> list[Tip]:
    """Select the tips that are not beside the wrist (2,) px, seen from the middle (2,) px of the palm."""
    back = (wrist - middle) / max(float(np.linalg.norm(wrist - middle)), 1e-9)
    ways = [tip.centre - middle for tip in tips]
    return [tip for tip, way in zip(tips, ways, strict=True) if way @ back <= _BACK * np.linalg.norm(way)]


def _window(patch: Patch, margin: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    (u, v), (height, width) = patch.corner, patch.inside.shape
    rows = slice(max(v - margin, 0), min(v + height + margin, shape[0]))
    return rows, slice(max(u - margin, 0), min(u + width + margin, shape[1]))


def _begins(others: Mask, ring: Mask, edge: Mask, metre: float) -> list[Array]:
    """Pixels (n, 2) beside the hand of each thing that goes on from it far enough, or out of the image."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(others.astype(np.uint8), connectivity=4)
    leaving = set(np.unique(labels[edge]).tolist())
    least = _LEAST_AREA * metre**2
    likely = [k for k in range(1, count) if k in leaving or stats[k, cv2.CC_STAT_AREA] >= least]
    return [_pixels(ring & (labels == label)) for label in likely]


def _edge(rows: slice, columns: slice, shape: tuple[int, ...]) -> Mask:
    """(h, w) of the window, where the image ends."""
    v, u = np.arange(rows.start, rows.stop), np.arange(columns.start, columns.stop)
    ends_v, ends_u = (v == 0) | (v == shape[0] - 1), (u == 0) | (u == shape[1] - 1)
    return np.asarray(ends_v[:, None] | ends_u[None, :])


def _pixels(mask: Mask) -> Array:
    """(n, 2) px"""
    v, u = np.nonzero(mask)
    return np.column_stack([u, v]).astype(float)


SIGMA = 0.004
"""m, standard deviation of each coordinate of a fingertip"""
PALM_SIGMA = 0.013
"""m, likewise of the middle of the palm: the widest place of an outline that may be seen from the side"""
MOST_HANDS = 4
"""Patches of skin that are looked at, the largest first."""
_TO_THE_FINGERS = 0.019
"""m, from the middle of the widest place of a hand to the mean of wrist and knuckles"""
_BY_WRIST, _VAGUE = 0.15, 1.0
"""rad, standard deviations of a palm's rotation if the wrist tells it, and if nothing does"""
_BESIDE = 3  # px around an outline, where what hides a part of the hand is looked for
_FAR = np.float32(1e6)  # m, beyond what any camera sees
_LEAST_CUT = 0.015  # m of an outline along something in front of it: a finger's width
_JUMP = 0.03  # m, of the depth between neighbouring pixels that are not of one hand
_KERNEL = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))


_UP_THE_FINGER = 2.0  # fingertip radii, to where the slope of a finger is measured
_BEYOND = 2.0  # fingertip radii from a tip's centre, one of which is beyond the finger, to what may hide its end
_MOST_BELOW = 2.5


class SkinFinder:
    """Finds hands by skin colour and depth."""

    source: Source = "skin colour"

    def __init__(self, config: HandTrackerConfig) -> None:
        self._config = config

    def find(self, frame: Frame, table: Array | None) -> list[SeenHand]:
        """The hands in a frame, at most `MOST_HANDS`. Raises `WireError` for an unusable frame."""
        color, depth, intrinsics = images_with_depth(frame)
        colored, near = skin(color, self._config.skin), in_band(depth, intrinsics, table, self._config.skin)
        found = []
        for patch in self._patches(colored & near, depth, intrinsics):
            hand = self._hand(patch, near & ~colored, depth, intrinsics)
            found += [] if hand is None else [hand]
        return found

    def close(self) -> None:
        """There is nothing to release."""

    def _patches(self, mask: Mask, depth: Depth, intrinsics: Intrinsics) -> list[Patch]:
        """Connected patches of skin of a hand's size, the largest first."""
        smooth = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, _KERNEL)
        smooth[jumps(depth, mask)] = 0
        smooth = cv2.morphologyEx(smooth, cv2.MORPH_OPEN, _KERNEL)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(smooth, connectivity=8)
        least, most = self._config.skin.area
        patches = []
        for label in range(1, count):
            x, y, width, height, pixels = (int(number) for number in stats[label])
            window = np.s_[y : y + height, x : x + width]
            inside = np.asarray(labels[window] == label)
            values = depth[window][inside & (depth[window] > 0)]
            if values.size:
                distance = float(np.median(values))
                if least <= pixels * distance**2 / (intrinsics.fx * intrinsics.fy) <= most:
                    patches.append(Patch((x, y), inside, distance))
        patches.sort(key=lambda patch: -int(patch.inside.sum()))
        return patches[:MOST_HANDS]

    def _hand(self, patch: Patch, body: Mask, depth: Depth, intrinsics: Intrinsics) -> SeenHand | None:
        mask = np.zeros(depth.shape, bool)
        height, width = patch.inside.shape
        mask[patch.corner[1] : patch.corner[1] + height, patch.corner[0] : patch.corner[0] + width] = patch.inside
        radius = self._config.fingertip_radius
        middle, found = fingertips(patch, intrinsics.fx, radius)
        surface = depth_at(depth, middle, 0.01 * intrinsics.fx / patch.distance, mask)
        if surface is None:
            return None
        palm = behind_surface(middle, surface, self._config.palm_radius, intrinsics)
        if not np.isfinite(palm).all():
            return None
        wrist = find_wrist(patch, middle, body, depth, intrinsics.fx)
        tips: dict[int, Array] = {}
        for tip in found if wrist is None else away_from(wrist, middle, found):
            centre = self._centre(tip, patch.distance, mask, depth, intrinsics)
            if centre is not None and np.isfinite(centre).all():
                tips[len(tips)] = centre
        elbow = None if wrist is None else _surface(wrist, patch, depth, intrinsics)
        along = _along(palm, tips, elbow, mask, depth, intrinsics)
        area = float(patch.inside.sum()) * patch.distance**2 / (intrinsics.fx * intrinsics.fy)
        outline = None if is_cut(patch, depth, intrinsics.fx) else Outline(palm, area)
        palm = palm + _TO_THE_FINGERS * along
        sigma = _VAGUE if elbow is None else _BY_WRIST
        turn = None if len(tips) > (elbow is not None) else sigma**2 * np.eye(3)
        pose = Pose(palm, _rotation(palm, along))
        return SeenHand(pose, tips, False, "unknown", SIGMA, turn, PALM_SIGMA, elbow is not None, outline)

    def _centre(self, tip: Tip, distance: float, mask: Mask, depth: Depth, intrinsics: Intrinsics) -> Array | None:
        """(3,) m, of a fingertip; None if its depth is not known, or if something in front of it hides its end."""
        radius = self._config.fingertip_radius
        pixels = radius * intrinsics.fx / distance
        there = depth_at(depth, tip.centre, 0.35 * pixels, mask)
        beyond = depth_at(depth, tip.centre - _BEYOND * pixels * tip.inwards, 0.35 * pixels, ~mask)
        if there is None or (beyond is not None and beyond < there - _JUMP):
            return None
        above = tip.centre + _UP_THE_FINGER * pixels * tip.inwards
        depth_above = depth_at(depth, above, 0.35 * pixels, mask)
        near = behind_surface(tip.centre, there, 0.0, intrinsics)
        factor = 1.0 if depth_above is None else _below(near, behind_surface(above, depth_above, 0.0, intrinsics))
        return behind_surface(tip.centre, there, radius * factor, intrinsics)


def _below(near: Array, far: Array) -> float:
    """By how much the line of sight at a finger's tip is longer in flesh than the finger's radius.

    `near` (3,) is seen at the tip's centre, `far` further up the finger: where that slopes away from the camera the ray
    meets the side of the finger, not its end.
    """
    if near[2] <= far[2]:
        return 1.0
    along = (far - near) / max(float(np.linalg.norm(far - near)), 1e-9)
    cosine = float(along @ near) / float(np.linalg.norm(near))
    return min(1.0 / max(math.sqrt(max(1.0 - cosine**2, 0.0)), 1e-3), _MOST_BELOW)


def skin(color: Color, model: SkinModel) -> Mask:
    """(h, w) where an RGB image has the colour of skin."""
    hsv = cv2.cvtColor(cv2.GaussianBlur(color, (3, 3), 0), cv2.COLOR_RGB2HSV)
    hue, saturation, value = (hsv[..., k] for k in range(3))
    low, high = model.hue[0] / 2.0, model.hue[1] / 2.0  # OpenCV counts in two degrees
    in_hue = (hue >= low) & (hue <= high) if low <= high else (hue >= low) | (hue <= high)
    for channel, (least, most) in ((saturation, model.saturation), (value, model.value)):
        in_hue &= (channel >= 255 * least) & (channel <= 255 * most)
    return np.asarray(in_hue)


def in_band(depth: Depth, intrinsics: Intrinsics, table: Array | None, model: SkinModel) -> Mask:
    """(h, w) where the depth is that of a hand, or not known: in the band, and above the plane (4,) of a table."""
    near, far = model.depth
    good = (depth == 0) | ((depth >= near) & (depth <= far))
    if table is not None:
        x, y = intrinsics.slopes()
        slope = (table[0] * x + table[1] * y + table[2]).astype(np.float32)
        good &= (depth == 0) | (depth * slope + np.float32(table[3]) >= model.above_table)
    return np.asarray(good)


def jumps(depth: Depth, mask: Mask) -> Mask:
    """(h, w) where the depth jumps within the mask: one hand in front of another."""
    known = mask & (depth > 0)
    far = cv2.dilate(np.where(known, depth, np.float32(0.0)), _KERNEL)
    near = cv2.erode(np.where(known, depth, np.float32(np.inf)), _KERNEL)
    return np.asarray(known & (far - near > _JUMP))


def _surface(pixel: Array, patch: Patch, depth: Depth, intrinsics: Intrinsics) -> Array | None:
    """(3,) m, what is seen around a pixel (2,) at the edge of a hand."""
    there = depth_at(depth, pixel, 0.01 * intrinsics.fx / patch.distance)
    point = None if there is None else behind_surface(pixel, there, 0.0, intrinsics)
    return point if point is not None and np.isfinite(point).all() else None


def _along(
    palm: Array, tips: dict[int, Array], wrist: Array | None, mask: Mask, depth: Depth, intrinsics: Intrinsics
) -> Array:
    """(3,) unit vector from the palm to the fingers: to their tips and away from the wrist, else along the patch."""
    told = tips and (wrist is None or len(tips) > 1)  # one alone may be a thumb's
    ways = [np.mean(list(tips.values()), axis=0) - palm] if told else []
    ways += [] if wrist is None else [palm - wrist]
    if ways:
        direction = np.sum([way / max(float(np.linalg.norm(way)), 1e-9) for way in ways], axis=0)
    else:
        rows, columns = np.nonzero(mask & (depth > 0))
        points = intrinsics.rays(np.column_stack([columns, rows])[::7].astype(float))
        points = points * depth[rows[::7], columns[::7]][:, None]
        direction = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(direction / max(float(np.linalg.norm(direction)), 1e-9))


def _rotation(palm: Array, along: Array) -> Quaternion:
    """Of a hand whose fingers point `along` and whose back is towards the camera as far as that allows."""
    back = -palm / np.linalg.norm(palm)
    across = np.cross(back, along)
    length = float(np.linalg.norm(across))
    if length < 1e-3:
        across, length = np.array([1.0, 0.0, 0.0]), 1.0
    across = across / length
    matrix = np.column_stack([along, across, np.cross(along, across)])
    return quaternions.from_matrix(matrix.tolist())
