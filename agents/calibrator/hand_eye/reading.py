"""Reads what a calibration needs from files: images, the hand's pose or joints at each, and intrinsics."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from agents.intrinsics_file import read_intrinsics_file
from dsr.config.toml import convert
from dsr.errors import ConfigError
from dsr.files.data_files import read_file, read_text
from dsr.math3d.transforms import Array, Pose
from dsr.vocabulary.intrinsics import Intrinsics

_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_MOST_BYTES = 100_000_000
"""Of one image"""
_MOST_IMAGES = 1000
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Columns of a table of poses, m and a quaternion"""


class HandRow(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the hand was at one image: a pose, or joint positions."""

    image: str = ""
    """Name of the file in the folder; empty to go by the order"""
    position: tuple[float, float, float] | None = None
    """m, of the hand in the frame of the base"""
    rotation: tuple[float, float, float, float] | None = None
    """Quaternion (x, y, z, w): base_from_hand"""
    joints: tuple[float, ...] | None = None
    """rad or m, from the base to the hand"""


class ToldHands(NamedTuple):
    """The hand at each image."""

    images: tuple[Path, ...]
    poses: Array
    """(v, 4, 4) base_from_hand"""
    joint_effects: Array | None
    """(v, 6, k) twist of the hand, in its own frame, by each joint; None if poses were told"""
    joint_names: tuple[str, ...] = ()


def read_hands(folder: Path, file: Path, chain: JointChain | None) -> ToldHands:
    """The images of a folder, and where the hand was at each.

    Args:
        folder: with the images.
        file: a table (CSV) or list (JSON) of poses or joints, see docs/how-to/hand_eye.md.
        chain: from base to hand; None if the file tells poses.

    Raises:
        ConfigError: for what cannot be read, or if the file and the folder do not fit each other.
    """
    rows = read_rows(file, () if chain is None else chain.names)
    images = _images(folder, rows, file)
    if chain is None:
        return ToldHands(
            images, np.array([_pose(row, number, file).matrix for number, row in enumerate(rows, 1)]), None
        )
    joints = np.array([_joints(row, number, file, chain) for number, row in enumerate(rows, 1)])
    return ToldHands(images, *joint_poses(chain, joints), chain.names)


def joint_poses(chain: JointChain, joints: Array) -> tuple[Array, Array]:
    """base_from_hand (v, 4, 4) at joints (v, k), and the twists (v, 6, k) of the hand, in its frame, by each joint."""
    poses, effects = [], []
    for positions in joints:
        pose = chain.forward(positions)
        turned = np.kron(np.eye(2), pose.rotation_matrix.T)
        poses.append(pose.matrix)
        effects.append(turned @ chain.jacobian(positions))
    return np.array(poses), np.array(effects)


def read_chain(urdf: Path, base: str, hand: str) -> JointChain:
    """The joints from link `base` (empty: the root) to link `hand`. Raises `ConfigError`."""
    robot = load_robot(urdf)
    chain = JointChain(robot.between(base or robot.root, hand))
    if not len(chain):
        raise ConfigError(f"no joint moves {hand!r} against {base or robot.root!r}", file=str(urdf))
    return chain


def read_rows(file: Path, joints: Sequence[str] = ()) -> list[HandRow]:
    """The rows of a file. Raises `ConfigError` for what is none. `joints` are names of columns of a table."""
    text = read_text(file)
    if file.suffix.lower() == ".json":
        try:
            data = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"not valid JSON: {error}", file=str(file)) from error
        return convert(data, list[HandRow], str(file))
    return _table(text, file, joints)


def read_images(images: Sequence[Path]) -> list[NDArray[np.uint8]]:
    """Grey images, all of one size. Raises `ConfigError` that names those that are not."""
    found: list[NDArray[np.uint8]] = []
    for image in images:
        data = np.frombuffer(read_file(image, _MOST_BYTES), np.uint8)
        try:
            grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
        except cv2.error:
            grey = None
        if grey is None:
            raise ConfigError("is no image that can be read", file=str(image))
        if found and grey.shape != found[0].shape:
            sizes = " and ".join(f"{shape[1]}x{shape[0]}" for shape in (found[0].shape, grey.shape))
            raise ConfigError(f"images of one camera have one size; {images[0].name} and {image.name} have {sizes}")
        found.append(np.asarray(grey, np.uint8))
    return found


def intrinsics_for(file: Path, size: tuple[int, int]) -> Intrinsics:
    """Intrinsics of a file (`agents/intrinsics_file.py`), or of a result of this calibration, for images of a size.

    Args:
        file: TOML, JSON or YAML.
        size: width and height, px.

    Raises:
        ConfigError: for what is none, or belongs to images of another size.
    """
    found = read_intrinsics_file(file)
    if (found.width, found.height) != size:
        raise ConfigError(
            f"is for images of {found.width}x{found.height}; these have {size[0]}x{size[1]}", file=str(file)
        )
    return found


def _table(text: str, file: Path, joints: Sequence[str]) -> list[HandRow]:
    lines = csv.reader(io.StringIO(text))
    header = [name.strip() for name in next(lines, [])]
    wanted = list(joints) if joints else list(_POSE)
    lacking = [name for name in wanted if name not in header]
    if lacking:
        raise ConfigError(
            f"the first line names columns; {', '.join(lacking)} missing of image (optional), {', '.join(wanted)}",
            file=str(file),
        )
    rows = []
    for number, line in enumerate(lines, 2):
        if not line:
            continue
        cells = dict(zip(header, line, strict=False))
        try:
            values = tuple(float(cells[name]) for name in wanted)
        except (KeyError, ValueError) as error:
            raise ConfigError(f"expected {len(header)} cells with numbers", file=str(file), line=number) from error
        image = cells.get("image", "").strip()
        if joints:
            rows.append(HandRow(image, joints=values))
        else:
            rows.append(HandRow(image, values[:3], values[3:]))  # type: ignore[arg-type]
    return rows


def _images(folder: Path, rows: Sequence[HandRow], file: Path) -> tuple[Path, ...]:
    if not folder.is_dir():
        raise ConfigError("is no folder with images", file=str(folder))
    there = sorted((one for one in folder.iterdir() if one.suffix.lower() in _SUFFIXES), key=_natural)
    named = [row.image for row in rows if row.image]
    if not there:
        raise ConfigError(f"there are no images ({', '.join(_SUFFIXES)})", file=str(folder))
    if not rows or len(rows) > _MOST_IMAGES:
        raise ConfigError(f"{len(rows)} poses: expected 1 to {_MOST_IMAGES}", file=str(file))
    if not named:
        if len(there) != len(rows):
            raise ConfigError(f"{len(rows)} poses, but {len(there)} images in {folder}; name the image of each pose")
        return tuple(there)
    if len(named) != len(rows) or len(set(named)) != len(named):
        raise ConfigError("each pose names an image of its own, or none does", file=str(file))
    by_name = {one.name: one for one in there}
    lacking = [name for name in named if name not in by_name]
    if lacking:
        raise ConfigError(f"no image {', '.join(lacking[:5])} in {folder}", file=str(file))
    return tuple(by_name[name] for name in named)


def _natural(file: Path) -> tuple[list[tuple[int, str]], str]:
    """The order in which people count: 2.png before 10.png."""
    parts = re.findall(r"\d{1,18}|\D+", file.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts], file.name


def _pose(row: HandRow, number: int, file: Path) -> Pose:
    if row.position is None or row.rotation is None:
        hint = "; joints need --urdf" if row.joints is not None else ""
        raise ConfigError(f"pose {number}: expected position and rotation{hint}", file=str(file))
    try:
        return Pose(row.position, row.rotation)
    except ValueError as error:
        raise ConfigError(f"pose {number}: {error}", file=str(file)) from error


def _joints(row: HandRow, number: int, file: Path, chain: JointChain) -> tuple[float, ...]:
    if row.joints is None:
        raise ConfigError(f"pose {number}: with --urdf, expected joints", file=str(file))
    if len(row.joints) != len(chain) or not all(map(math.isfinite, row.joints)):
        names = ", ".join(chain.names)
        raise ConfigError(f"pose {number}: {len(row.joints)} joints; expected finite {names}", file=str(file))
    return row.joints
