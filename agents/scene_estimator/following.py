"""Follows the tags of one camera from frame to frame: what moves is blurred, and nothing flips over in 25 ms.

A tag that moves is drawn with soft edges, which a detector finds further inside: its corners are moved out again.
A square seen from afar fits two poses; which of them is right is decided by the frames before as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.scene_estimator.detection import Tag
from agents.scene_estimator.pose import NoiseModel, TagFit, most_likely, possible_tag_poses
from agents.scene_estimator.reading import crossings
from dsr.math3d.batches import Array, inverses, logs
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

_LOST_AFTER = 0.5
"""s without a tag after which nothing that was known of it counts"""
_SPEED = 1.0
"""m/s, standard deviation of a tag's velocity in the camera frame: hands and arms are seldom faster"""
_TURNING = 10.0
"""rad/s, standard deviation of its angular velocity, likewise"""
_ALIKE = 0.1
"""s within which errors of a tag's corners are alike, so that a second frame tells little news"""
_UNLIKELY = 40.0
"""Twice the log of odds beyond which a pose is given up: one in 5e8"""


class Sharpener:
    """Takes motion blur off the corners of the tags of one camera.

    Args:
        blur: s; edges of what moves are found inside by so much times their speed.
    """

    def __init__(self, blur: float) -> None:
        self._blur = blur
        self._seen: dict[int, tuple[float, Array]] = {}

    def sharpened(self, tags: Sequence[Tag], stamp: float) -> list[Tag]:
        """Tags (px) without the blur of their motion since the last frame (stamps in s), with what that leaves unsure.

        How much white outshines black differs from place to place, so that the shift is as uncertain as it is large.
        """
        result, befores = list(tags), [self._seen.get(tag.marker_id) for tag in tags]
        self._seen.update({tag.marker_id: (stamp, tag.corners) for tag in tags})
        moved, shifts = [], []
        for place, (tag, before) in enumerate(zip(tags, befores, strict=True)):
            if self._blur == 0.0 or before is None or not 0.0 < stamp - before[0] <= _LOST_AFTER:
                continue
            if tag.corners is not before[1] and (tag.corners != before[1]).any():
                moved.append(place)
                shifts.append(self._blur * (tag.corners - before[1]) / (stamp - before[0]))
        if moved:
            for place, tag in zip(moved, _drawn_out([tags[place] for place in moved], np.array(shifts)), strict=True):
                result[place] = tag
        return result


class _Seen(NamedTuple):
    """A tag in the last frame that showed it."""

    stamp: float
    """s"""
    fits: list[TagFit]
    """With the cost of all frames so far, that of the most likely one 0"""


class TagFollower:
    """Poses of the tags of one camera, each with what its last frames told."""

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise
        self._sharpener = Sharpener(noise.blur)
        self._seen: dict[int, _Seen] = {}

    def poses(
        self,
        tags: Sequence[Tag],
        depth: NDArray[np.float32] | None,
        intrinsics: Intrinsics,
        tag_sizes: Sequence[float],
        stamp: float,
    ) -> list[Pose | None]:
        """Each `camera_from_tag` with covariance, as `estimate_tag_pose` gives it, in view of earlier frames.

        Args:
            tags: their corners, px; no two with one id.
            depth: (h, w) m, of the same exposure and intrinsics; None without a depth camera.
            intrinsics: px, and the distortion of the lens.
            tag_sizes: side of each black square, m.
            stamp: s, of the exposure; a frame that is older than the last one is judged by itself.
        """
        tags = self._sharpener.sharpened(tags, stamp)
        found = possible_tag_poses(tags, depth, intrinsics, tag_sizes, self._noise)
        return [most_likely(fits) for fits in self._in_view_of_the_last(tags, found, stamp)]

    def _in_view_of_the_last(self, tags: list[Tag], found: list[list[TagFit]], stamp: float) -> list[list[TagFit]]:
        """The fits of each tag that are likely enough after the frames before, with the cost of all of them."""
        lasts = [self._seen.get(tag.marker_id) for tag in tags]
        pairs = [
            (fit, last, stamp - last.stamp)
            for fits, last in zip(found, lasts, strict=True)
            if last is not None and 0.0 < stamp - last.stamp <= _LOST_AFTER
            for fit in fits
        ]
        costs = {id(fit): cost for (fit, _, _), cost in zip(pairs, _costs(pairs), strict=True)}
        told = [[fit._replace(cost=costs.get(id(fit), fit.cost)) for fit in fits] for fits in found]
        likely = []
        for tag, fits in zip(tags, told, strict=True):
            best = min((fit.cost for fit in fits), default=0.0)
            kept = [fit._replace(cost=fit.cost - best) for fit in fits if fit.cost - best < _UNLIKELY]
            if kept:
                self._seen[tag.marker_id] = _Seen(stamp, kept)
            likely.append(kept)
        return likely


def _costs(pairs: list[tuple[TagFit, _Seen, float]]) -> list[float]:
    """Twice the negative log likelihoods of poses now and of the ways to them from the last frame, so many s ago."""
    ways = [(place, before) for place, (_, last, _) in enumerate(pairs) for before in last.fits]
    if not ways:
        return []
    froms = np.array([before.pose for _, before in ways])
    aparts = logs(inverses(froms) @ np.array([pairs[place][0].pose for place, _ in ways]))
    seconds = np.array([pairs[place][2] for place, _ in ways])
    moved = np.eye(6) * (np.repeat([_SPEED, _TURNING], 3) * seconds[:, None])[:, None] ** 2
    spread = moved + np.array([before.covariance + pairs[place][0].covariance for place, before in ways])
    squares = (aparts * np.linalg.solve(spread, aparts[:, :, None])[..., 0]).sum(axis=1)
    least = [_UNLIKELY] * len(pairs)  # at most: whatever was seen, it may have been wrong
    for (place, before), square in zip(ways, squares.tolist(), strict=True):
        least[place] = min(least[place], before.cost + square)
    return [min(1.0, ago / _ALIKE) * fit.cost + way for (fit, _, ago), way in zip(pairs, least, strict=True)]


def _drawn_out(tags: list[Tag], shifts: Array) -> list[Tag]:
    """Tags with each edge moved out along its normal, as far as its ends' `shifts` (n, 4, 2) px go along that."""
    corners, by_edge = np.array([tag.corners for tag in tags]), 0.5 * (shifts + np.roll(shifts, -1, axis=1))
    along = np.roll(corners, -1, axis=1) - corners
    sides, lengths = np.linalg.norm(along, axis=2), np.linalg.norm(by_edge, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        outward = np.stack([along[..., 1], -along[..., 0]], axis=2) / sides[..., None]
        outward *= np.sign((outward * (corners - corners.mean(axis=1, keepdims=True))).sum(axis=2))[..., None]
        out = np.abs((outward * by_edge).sum(axis=2))
        drawn = crossings(corners + out[..., None] * outward, along)
    right = (sides.min(axis=1) > 2.0 * lengths.max(axis=1)) & np.isfinite(drawn).all(axis=(1, 2))
    stds = np.hypot([tag.corner_std for tag in tags], lengths.mean(axis=1)).tolist()
    return [
        Tag(tag.marker_id, drawn[place] if right[place] else tag.corners, stds[place]) for place, tag in enumerate(tags)
    ]
