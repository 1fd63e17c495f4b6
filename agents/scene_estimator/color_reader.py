"""Finds objects of known colour and shape in camera frames."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from agents.frame_images import images
from agents.scene_estimator.colored import ColoredObject, ColorSighting
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.placing import Guess, Placed, place
from agents.scene_estimator.pose import NoiseModel
from agents.scene_estimator.segmentation import ColorImage
from dsr.images.blobs import Frame
from dsr.math3d.transforms import Pose
from dsr.perception.scales import LONGEST_GAP

_PATIENCE = 10
"""Frames after which a shape that fits with no yaw is tried with all of them again"""
_LONGEST_PAUSE = 160
"""Frames from one search of all rotations to the next, at most. A search takes 0.2 s of a box, and 1.7 s of a cup of
13 parts: that is 1 to 10 % of a core at 10 Hz."""


class _Known(NamedTuple):
    guess: Guess = Guess()
    frames: int = 0
    """For which no other yaw is looked for."""
    turns: int = 0
    """Frames for which no other rotation is looked for, seen or not"""
    pause: int = _PATIENCE
    """Such frames after the next search in vain, twice as many each time, up to `_LONGEST_PAUSE`"""
    stamp: float = math.inf
    """s, of the last frame in which it was looked for"""


def _lost(known: _Known) -> _Known:
    """Of what was not found: who knows how it is turned when it is found again."""
    return known._replace(guess=known.guess._replace(followed=False))


class ColorReader:
    """Finds objects by their colour, in one camera's frames or in those of several.

    Args:
        noise: error model of the cameras.
    """

    def __init__(self, noise: NoiseModel) -> None:
        self._noise = noise
        self._known: dict[str, _Known] = {}
        self._has_searched = False
        """Whether all rotations of an object were tried in this frame."""

    def read(self, frame: Frame, objects: list[ColoredObject], world_from_camera: Pose) -> list[ColorSighting]:
        """Sightings of `objects` in the frame; none without depth. Raises `WireError` for an unusable frame."""
        color, depth, intrinsics = images(frame)
        if depth is None or not objects:
            return []
        picture, view = ColorImage(color), FrameView(depth, intrinsics, world_from_camera)
        self._has_searched = False
        self._known = {known.name: self._looked_for(known.name, frame.stamp) for known in objects}
        found = [(known, self._place(known, picture, view)) for known in objects]
        return [self._sighting(known, placed, frame.stamp) for known, placed in found if placed is not None]

    def _looked_for(self, name: str, stamp: float) -> _Known:
        """What is known of an object as it is looked for at `stamp` (s). Cameras may show nothing for a while."""
        last = self._known.get(name, _Known())
        last = last if stamp - last.stamp <= LONGEST_GAP else _lost(last)
        return last._replace(turns=max(last.turns - 1, 0), stamp=stamp)

    def _place(self, known: ColoredObject, picture: ColorImage, view: FrameView) -> Placed | None:
        last, noise = self._known[known.name], self._noise.inverse_depth_std
        mask = picture.mask(known.color)
        if not mask.any():
            self._known[known.name] = _lost(last)
            return None

        def may_turn() -> bool:
            return self._may_turn(known.name)

        may_search = last.frames == 0
        placed = place(
            view, mask, known.shape, known.size, noise, last.guess,
            tagged=known.tagged, search=may_search, may_turn=may_turn,
        )  # fmt: skip
        if placed is not None:
            last = self._known[known.name]
            frames = 0 if placed.fits else _PATIENCE if may_search else last.frames - 1
            last = last._replace(guess=placed.guess, frames=frames)
            self._known[known.name] = last._replace(turns=0, pause=_PATIENCE) if placed.fits else last
        else:
            self._known[known.name] = _lost(self._known[known.name])
        return placed

    def _may_turn(self, name: str) -> bool:
        """Whether all rotations of an object may be tried now: of one object a frame, and ever more rarely in vain."""
        last = self._known[name]
        if self._has_searched or last.turns > 0:
            return False
        self._has_searched = True
        self._known[name] = last._replace(turns=last.pause + 1, pause=min(2 * last.pause, _LONGEST_PAUSE))
        return True

    def _sighting(self, known: ColoredObject, placed: Placed, stamp: float) -> ColorSighting:
        """Of rotations that look alike only a tag tells which it is: of what has one, colours tell no turn."""
        ray = placed.position / np.linalg.norm(placed.position)
        covariance = placed.covariance + self._noise.depth_bias_std**2 * np.outer(ray, ray)
        lean, yaw_sigma = (None, math.inf) if known.tagged else (placed.lean, placed.yaw_sigma)
        return ColorSighting(known.name, placed.position, covariance, stamp, lean, placed.guess.yaw, yaw_sigma)
