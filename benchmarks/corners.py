"""How exact corners of tags are in renders, by whose word: `python -m benchmarks.perception --corners`.

The peers are OpenCV's two refinements of corners. `read` counts tags whose corners are those of their edges; those of
others are a detector's. `rms / told` is 1 where errors are as large as they are told to be. The same cubes are drawn as
for the poses of tags; `--blur` makes their pictures unsharp.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from agents.scene_estimator.detection import (
    APRILTAG_BIAS,
    APRILTAG_STD,
    SUBPIX_STD,
    Tag,
    TagDetector,
    grey_of,
    tag_corners,
)
from agents.scene_estimator.reading import READ_STD
from benchmarks.tag_camera import DICTIONARY, Camera, facing
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.tags import TAG_RATIO

_SIZE = 0.04  # m, edge of the cube
_STEEPEST = np.radians(50)
_MARKER = 5
Finder = Callable[[NDArray[np.uint8]], Tag | None]
"""The only tag in a colour image; None if it is not found"""


def corner_rows(distances: list[float], trials: int, seed: int, blur: float) -> Iterator[dict[str, Any]]:
    """A row for each distance (m) and method; pictures are blurred by a Gaussian of `blur` px."""
    camera, rng = Camera(), np.random.default_rng(seed)
    methods = {
        "ours": _ours(),
        "OpenCV, apriltag": _by_opencv(cv2.aruco.CORNER_REFINE_APRILTAG, APRILTAG_BIAS, APRILTAG_STD),
        "OpenCV, sub-pixel": _by_opencv(cv2.aruco.CORNER_REFINE_SUBPIX, 0.0, SUBPIX_STD),
    }
    for distance in distances:
        errors: dict[str, list[tuple[Array, float]]] = {name: [] for name in methods}
        sides = []
        for _ in range(trials):
            cube = facing(distance, rng.uniform(0.0, _STEEPEST), rng)
            square = (cube @ Pose((0.0, 0.0, 0.5 * _SIZE))).apply(tag_corners(TAG_RATIO * _SIZE))
            truth = camera.intrinsics.project(square)
            sides.append(np.linalg.norm(np.roll(truth, -1, axis=0) - truth, axis=1).mean())
            color = camera.frame({_MARKER: cube}, rng, size=_SIZE).arrays["color"]
            picture = np.asarray(cv2.GaussianBlur(color, (0, 0), blur) if blur else color, np.uint8)
            for name, find in methods.items():
                found = find(picture)
                if found is not None:
                    errors[name].append((found.corners - truth, found.corner_std))
        for name, apart in errors.items():
            yield _row(distance, float(np.mean(sides)), name, apart, trials)


def corner_table(rows: list[dict[str, Any]]) -> Table:
    """For people: px."""
    table = Table(title="Corners of a 32 mm tag, in a sharp lens")
    for heading in ("m", "side px", "method", "found", "read", "rms px", "worst", "rms / told"):
        table.add_column(heading, justify="right")
    for row in rows:
        measured = ("-" if row[name] is None else f"{row[name]:.2f}" for name in ("rms_px", "worst_px", "over_told"))
        counts = f"{row['found']}/{row['trials']}", str(row["read"])
        table.add_row(f"{row['distance_m']:g}", f"{row['side_px']:.0f}", row["method"], *counts, *measured)
    return table


def _row(distance: float, side: float, method: str, errors: list[tuple[Array, float]], trials: int) -> dict[str, Any]:
    apart, told = np.array([error for error, _ in errors]), np.array([std for _, std in errors])
    known = len(errors) > 0
    return {
        "distance_m": distance, "side_px": side, "method": method, "trials": trials, "found": len(errors),
        "read": int((told == READ_STD).sum()),
        "rms_px": float(np.sqrt((apart**2).mean())) if known else None,
        "worst_px": float(np.abs(apart).max()) if known else None,
        "over_told": float(np.sqrt(((apart / told[:, None, None]) ** 2).mean())) if known else None,
    }  # fmt: skip


def _ours() -> Finder:
    detector = TagDetector()

    def find(color: NDArray[np.uint8]) -> Tag | None:
        tags = detector.detect(color)
        return tags[0] if tags else None

    return find


def _by_opencv(refinement: int, bias: float, std: float) -> Finder:
    """By a refinement that adds `bias` px, with errors of `std` px."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    detector = cv2.aruco.ArucoDetector(DICTIONARY, parameters)

    def find(color: NDArray[np.uint8]) -> Tag | None:
        grey: Any = grey_of(color)
        quads, ids, _ = detector.detectMarkers(grey)
        if ids is None:
            return None
        corners = np.asarray(quads[0], np.float64).reshape(4, 2) - bias
        return Tag(int(ids.ravel()[0]), corners, std)

    return find
