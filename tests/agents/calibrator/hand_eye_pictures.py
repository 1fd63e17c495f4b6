"""Pictures of targets, as a camera without distortion sees them."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.calibrator.hand_eye.targets import Target
from dsr.math3d.transforms import Array
from dsr.vocabulary.intrinsics import Intrinsics

PINHOLE = Intrinsics(600.0, 600.0, 319.5, 239.5, 640, 480)
_SCALE = 4000.0  # px/m of the print


def printed(target: Target) -> tuple[NDArray[np.uint8], Array]:
    """The print of a target, and the (3, 3) map from m in the target's frame to its pixels."""
    low, high = target.points[:, :2].min(axis=0), target.points[:, :2].max(axis=0)
    margin = 0.35 * float((high - low).max())
    size = ((high - low + 2.0 * margin) * _SCALE).astype(int)
    sheet = np.full((size[1], size[0]), 235, np.uint8)
    kind, _, rest = target.name.partition(":")
    flip = -1.0 if kind.startswith("tag") else 1.0  # the y axis of tags points up
    first = np.array([low[0], high[1] if flip < 0.0 else low[1]])
    to_sheet = np.array(
        [
            [_SCALE, 0.0, (margin - first[0]) * _SCALE],
            [0.0, flip * _SCALE, (margin - flip * first[1]) * _SCALE],
            [0, 0, 1.0],
        ]
    )
    places = (target.points[:, :2] * (1.0, flip) + margin - first * (1.0, flip)) * _SCALE
    if kind == "circles":
        radius = 0.25 * float(rest.split(":")[1]) * _SCALE
        for place in places:
            cv2.circle(sheet, np.round(place * 16).astype(int).tolist(), round(radius * 16), 20, -1, cv2.LINE_AA, 4)
    elif kind == "chessboard":
        side = float(rest.split(":")[1]) * _SCALE
        columns, rows = map(int, rest.split(":")[0].split("x"))
        for row in range(rows + 1):
            for column in range(columns + 1):
                if (row + column) % 2 == 0:
                    x, y = np.round(places[0] + side * (np.array([column, row]) - 1.0)).astype(int)
                    sheet[y : y + round(side), x : x + round(side)] = 20
    elif kind == "square":
        cv2.polylines(
            sheet, [np.round(_around(places, 0.004 * _SCALE)).astype(np.int32)], True, 20, round(0.008 * _SCALE)
        )
    else:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        for index, number in enumerate(map(int, rest.split(":")[0].split(","))):
            corners = places[4 * index : 4 * index + 4]
            side = round(corners[1, 0] - corners[0, 0])
            x, y = np.round(corners[0]).astype(int)
            sheet[y : y + side, x : x + side] = cv2.aruco.generateImageMarker(dictionary, number, side)
    if kind not in ("circles", "square"):
        to_sheet[:2, 2] -= 0.5  # whole pixels were filled, each of which covers half to both sides of its middle
    return sheet, to_sheet


def picture(target: Target, camera_from_target: Array, seed: int = 0, lens: Intrinsics = PINHOLE) -> NDArray[np.uint8]:
    """A grey image of the print on a grey table, with noise."""
    sheet, to_sheet = printed(target)
    to_image = lens.matrix @ camera_from_target[:3, [0, 1, 3]]
    large = np.array([[3.0, 0.0, 1.0], [0.0, 3.0, 1.0], [0.0, 0.0, 1.0]])  # three times as large, then averaged
    shown = cv2.warpPerspective(
        sheet, large @ to_image @ np.linalg.inv(to_sheet), (3 * lens.width, 3 * lens.height), flags=cv2.INTER_AREA,
        borderValue=110,
    )  # fmt: skip
    small = cv2.resize(shown, (lens.width, lens.height), interpolation=cv2.INTER_AREA).astype(np.float64)
    return np.clip(small + np.random.default_rng(seed).normal(0.0, 2.0, small.shape), 0, 255).astype(np.uint8)


def _around(corners: Array, width: float) -> Array:
    """Corners moved outwards by a width along both axes."""
    return corners + width * np.sign(corners - corners.mean(axis=0))
