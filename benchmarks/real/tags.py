"""Normals of a tag in colour and depth of a Kinect, beside those of a chessboard on the same board."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from agents.scene_estimator.depth_plane import DepthPlanes, fit_depth_planes
from agents.scene_estimator.detection import Tag, TagDetector, tag_corners
from agents.scene_estimator.pose import NoiseModel, estimate_tag_pose
from benchmarks.real.drawing import closeup, draw_tag
from benchmarks.real.recordings import DataError, Outcome, RealBenchmark, needed, quantiles
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.intrinsics import Intrinsics

LENS = Intrinsics(529.297, 528.735, 466.960, 273.219, 960, 540)
"""As published; no distortion"""
SIDE = 0.048
"""m, of the tag, as published"""
_BOARDS = ((5, 4), (7, 5), (6, 4), (4, 3), (5, 3))
"""Inner corners of the chessboard of which some part is seen whole"""
_FLIPPED = 10.0
"""deg off from which a normal is called wrong"""


class _Shot(NamedTuple):
    """One pair of images with one tag, and what the chessboard says."""

    tag: Tag
    depth: NDArray[np.float32]
    """(h, w) m"""
    normal: Array
    """(3,) of the board in the camera frame, towards the camera"""


def run(folder: Path) -> Outcome:
    """Compare normals by three methods with those of the chessboard."""
    pairs, different = picture_pairs(folder)
    shots = [shot for path in different for shot in _shots(path)]
    noise = NoiseModel()
    rows = {
        "ours": [_ours(shot, noise, depth=True) for shot in shots],
        "ours, no depth": [_ours(shot, noise, depth=False) for shot in shots],
        "depth alone": [_plane(shot, noise) for shot in shots],
        "OpenCV, IPPE": [_ippe(shot) for shot in shots],
    }
    table = Table(
        "method", "found", "median deg", "95 % deg", "worst deg", "over 10", "within 1 sigma", "within 2 sigma"
    )
    figures = {}
    for name, poses in rows.items():
        found = [(pose, shot) for pose, shot in zip(poses, shots, strict=True) if pose is not None]
        errors = [_angle(pose, shot.normal) for pose, shot in found]
        nees = [_nees(pose, shot.normal) for pose, shot in found if pose.covariance is not None]
        median, most, worst = quantiles(errors, 0.5, 0.95, 1.0)
        wrong = sum(error > _FLIPPED for error in errors)
        honest = [float(np.mean([value < bound for value in nees])) if nees else None for bound in (1.0, 4.0)]
        figures[name] = {
            "found": len(found), "median_deg": median, "p95_deg": most, "worst_deg": worst, "over_10_deg": wrong,
            "within_1_sigma": honest[0], "within_2_sigma": honest[1],
        }  # fmt: skip
        shown = ["-" if share is None else f"{share:.0%}" for share in honest]
        table.add_row(name, str(len(found)), f"{median:.2f}", f"{most:.2f}", f"{worst:.2f}", str(wrong), *shown)
    farther = np.array([off for shot in shots if (off := _farther(shot, noise)) is not None])
    remarks = [
        f"{pairs} pairs of images, {len(different)} different; {len(shots)} tags beside a chessboard are found.",
        "Right standard deviations hold 39 % in one sigma, 86 % in two: a normal has two degrees of freedom.",
        f"Depth tells {1e3 * farther.mean():.0f} mm more than the tag's size, from {1e3 * farther.min():.0f} to "
        f"{1e3 * farther.max():.0f}, standard deviation {1e3 * farther.std():.0f}."
        if len(farther)
        else "No depth.",
    ]
    told = {"pairs": pairs, "different": len(different), "used": len(shots), "methods": figures}
    return Outcome(table, remarks, told | {"depth_beyond_size_m": farther.tolist()})


def draw(folder: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """A close-up of each tag: the corners that were found, outline and axes of the pose that we estimate."""
    noise = NoiseModel()
    for path in _paths(folder):
        rgb, depth = read_pair(path)
        color = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), np.uint8)
        for tag in TagDetector().detect(rgb):
            pose = _ours(_Shot(tag, depth, np.zeros(3)), noise, depth=True)
            picture, enlarged, lens = closeup(color, tag, LENS)
            draw_tag(picture, enlarged, pose, SIDE, lens)
            yield f"{'-'.join(path.relative_to(folder).with_suffix('').parts)}-{tag.marker_id}.png", picture


def _paths(folder: Path) -> list[Path]:
    """All pictures in a folder, and in those below it. Raises `DataError` without any."""
    needed(folder)
    paths = sorted(folder.rglob("rgb_*.png"))
    if not paths:
        raise DataError(f"no rgb_*.png in {folder} or its folders")
    return paths


def picture_pairs(folder: Path) -> tuple[int, list[Path]]:
    """How many pairs of images a folder and its folders hold, and the pictures of those that differ, sorted.

    Raises:
        DataError: if there is none.
    """
    paths = _paths(folder)
    different = {hashlib.sha256(path.read_bytes()).digest(): path for path in reversed(paths)}
    return len(paths), sorted(different.values())


def read_pair(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """The picture (h, w, 3), RGB, and the depth (h, w), m, of a pair. Raises `DataError` for images that are none."""
    color = cv2.imread(str(path))
    depth = cv2.imread(str(path.with_name(path.name.replace("rgb_", "depth_"))), cv2.IMREAD_UNCHANGED)
    if color is None or depth is None or depth.dtype != np.uint16 or color.shape[:2] != depth.shape:
        raise DataError(f"{path}: expected a picture, and beside it depth_*.png of 16 bit and the same size")
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_BGR2RGB), np.uint8), (depth / 1000.0).astype(np.float32)


def _shots(path: Path) -> Iterator[_Shot]:
    """The tags of a pair of images."""
    rgb, depth = read_pair(path)
    normal = board_normal(rgb)
    if normal is not None:
        for tag in TagDetector().detect(rgb):
            yield _Shot(tag, depth, normal)


def board_normal(picture: NDArray[np.uint8]) -> Array | None:
    """(3,) in the camera frame, normal of the chessboard, towards the camera; None if no part of it is seen whole."""
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    for columns, rows in _BOARDS:
        found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), flags=flags)
        if found:
            grid = np.zeros((columns * rows, 3))
            grid[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
            rays = LENS.rays(corners.reshape(-1, 2).astype(np.float64))
            _, turns, moves, _ = cv2.solvePnPGeneric(grid, rays[:, :2].copy(), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
            normal = np.asarray(cv2.Rodrigues(turns[0])[0], np.float64)[:, 2]
            return normal if normal @ moves[0].ravel() < 0.0 else -normal
    return None


def _ours(shot: _Shot, noise: NoiseModel, *, depth: bool) -> Pose | None:
    tag = replace(shot.tag, corner_std=math.hypot(shot.tag.corner_std, noise.corner_std))
    return estimate_tag_pose(tag, shot.depth if depth else None, LENS, SIDE, noise)


def _plane(shot: _Shot, noise: NoiseModel) -> Pose | None:
    """A pose with the normal of the plane of the depth within the tag."""
    plane = _plane_of(shot, noise)
    if plane is None:
        return None
    (normal,) = plane.normals
    turn = np.cross((0.0, 0.0, 1.0), normal)
    angle = math.acos(float(np.clip(normal[2], -1.0, 1.0)))
    return Pose.from_rotvec((0.0, 0.0, 1.0), turn / max(float(np.linalg.norm(turn)), 1e-12) * angle)


def _farther(shot: _Shot, noise: NoiseModel) -> float | None:
    """How much farther (m) depth puts the tag than its size does, along the optical axis; None without depth there."""
    plane, sized = _plane_of(shot, noise), _ours(shot, noise, depth=False)
    if plane is None or sized is None:
        return None
    return float(plane.points(LENS.rays(shot.tag.corners)[None])[..., 2].mean() - sized.translation[2])


def _plane_of(shot: _Shot, noise: NoiseModel) -> DepthPlanes | None:
    """One plane; None without depth there."""
    floor, correlation = noise.inverse_depth_floor, noise.depth_correlation
    corners = shot.tag.corners[None]
    planes = fit_depth_planes(corners, shot.depth, LENS, noise_floor=floor, correlation=correlation)
    return planes if planes.exist.all() else None


def _ippe(shot: _Shot) -> Pose | None:
    rays = LENS.rays(shot.tag.corners)[:, :2].copy()
    found, turn, move = cv2.solvePnP(tag_corners(SIDE), rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    return Pose.from_rotvec(move.ravel(), turn.ravel()) if found else None


def _angle(pose: Pose, normal: Array) -> float:
    """Between the tag's normal and the board's, deg."""
    return math.degrees(math.acos(float(np.clip(pose.rotation_matrix[:, 2] @ normal, -1.0, 1.0))))


def _nees(pose: Pose, normal: Array) -> float:
    """The squared error of the normal over what the covariance says; two degrees of freedom."""
    assert pose.covariance is not None
    seen = pose.rotation_matrix.T @ normal
    turn = np.array([-seen[1], seen[0]])  # about x and y of the tag
    turn *= math.atan2(float(np.hypot(*turn)), float(seen[2])) / max(float(np.hypot(*turn)), 1e-12)
    return float(turn @ np.linalg.solve(pose.covariance[3:5, 3:5], turn))


BENCHMARK = RealBenchmark(
    "tags",
    "Normals of an AprilTag in colour and depth of a Kinect v2, against those of a chessboard on the same board.\n"
    "Aims: median at most 1.5 deg, 95 % at most 4, none over 10; 30-50 % within one sigma, 80-95 % within two.",
    "Published with a paper of IROS 2017, without a licence: GitHub pengjujin/apriltags_rgbd (a8586fe).\n"
    "Needed: rgb_*.png beside depth_*.png (mm, 16 bit, 960 x 540), in the folder or below.",
    run,
    draw,
)
