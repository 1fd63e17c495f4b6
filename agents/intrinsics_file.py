"""Files that tell the intrinsics of a camera: ours, those of ROS and those of OpenCV."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from dsr.config.extras import check_installed
from dsr.errors import ConfigError
from dsr.files.data_files import read_text
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import INTRINSICS, Intrinsics

_YAML_HEADER = "%YAML"
_BY_COUNT = dict.fromkeys((4, 5), "plumb_bob") | dict.fromkeys((8, 12, 14), "rational_polynomial")
"""What OpenCV means by so many coefficients"""
_TABLE = "intrinsics"
"""Table of a file that tells more, such as the result of a calibration"""


def read_intrinsics_file(path: Path) -> Intrinsics:
    """The intrinsics in a file.

    `.toml` and `.json` have the attributes of a camera's node: fx, fy, cx, cy, width, height, distortion_model and
    distortion, also in a table `intrinsics` of a file that tells more. `.yaml` or `.yml` is that of ROS
    (camera_calibration, camera_info_manager), or one that OpenCV wrote with camera_matrix, distortion_coefficients,
    image_width and image_height.

    Raises:
        ConfigError: if it cannot be read, or lacks something.
    """
    text, kind = read_text(path), path.suffix.lower()
    try:
        return _intrinsics(_from_yaml(text) if kind in (".yaml", ".yml") else _from_ours(text, kind))
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        missing = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ConfigError(f"no intrinsics of a camera: {missing}", file=str(path)) from error


def _intrinsics(told: dict[str, Any]) -> Intrinsics:
    size = _pixels(told["height"]), _pixels(told["width"])
    if min(size) < 1:
        raise ValueError(f"images of {size[1]} x {size[0]} px")
    found = Intrinsics.from_meta({name: told[name] for name in INTRINSICS[:4]}, size)
    coefficients = list(told.get("distortion") or ())
    if not any(coefficients):
        return found
    model = told.get("distortion_model") or _BY_COUNT.get(len(coefficients))
    if model is None:
        raise ValueError(f"{len(coefficients)} coefficients of distortion: of which distortion_model?")
    return replace(found, distortion=Distortion.of(model, coefficients))


def _pixels(told: Any) -> int:
    """A width or height. Raises `ValueError` for what is no whole number."""
    if isinstance(told, bool) or not isinstance(told, (int, float)) or not float(told).is_integer():
        raise ValueError(f"width or height {str(told)[:20]!r}: expected a whole number of px")
    return int(told)


def _from_ours(text: str, kind: str) -> dict[str, Any]:
    data = json.loads(text) if kind == ".json" else tomllib.loads(text)
    told = data.get(_TABLE, data) if isinstance(data, dict) else data
    if not isinstance(told, dict):
        raise ValueError("expected a table")
    return told


def _from_yaml(text: str) -> dict[str, Any]:
    """A file of ROS lacks only the header by which OpenCV knows YAML."""
    check_installed(["cv2"], "calibrations in YAML")
    import cv2

    if not text.startswith(_YAML_HEADER):
        text = f"{_YAML_HEADER}:1.0\n---\n{text}"
    try:
        file = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise ValueError("no YAML") from error
    if not file.root().isMap():
        raise ValueError("expected a map with camera_matrix")
    matrix = _numbers(file, "camera_matrix")
    if len(matrix) != 9:
        raise ValueError(f"camera_matrix has {len(matrix)} numbers; expected 9")
    return {
        "fx": matrix[0], "fy": matrix[4], "cx": matrix[2], "cy": matrix[5],
        "width": _number(file, "image_width"), "height": _number(file, "image_height"),
        "distortion_model": file.getNode("distortion_model").string(),
        "distortion": _numbers(file, "distortion_coefficients"),
    }  # fmt: skip


def _number(file: Any, name: str) -> float:
    node = file.getNode(name)
    if not (node.isInt() or node.isReal()):
        raise KeyError(name)
    return float(node.real())


def _numbers(file: Any, name: str) -> Sequence[float]:
    """The numbers of a matrix, as a map with `data`, or as OpenCV writes it; none if it is not there."""
    node = file.getNode(name)
    data = node.getNode("data") if node.isMap() else node
    return [data.at(index).real() for index in range(data.size())] if data.isSeq() else []
