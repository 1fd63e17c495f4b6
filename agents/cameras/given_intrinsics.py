"""Intrinsics of a camera that tells none: from a file of its calibration, or from its stated field of view."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from dsr.config.extras import check_installed
from dsr.errors import ConfigError, DsrError
from dsr.files.data_files import read_text
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import INTRINSICS, Intrinsics

_YAML_HEADER = "%YAML"
_BY_COUNT = dict.fromkeys((4, 5), "plumb_bob") | dict.fromkeys((8, 12, 14), "rational_polynomial")
"""What OpenCV means by so many coefficients"""


class SizeError(DsrError):
    """Pictures are of another size than those for which the camera was calibrated."""


class GivenIntrinsics:
    """Intrinsics for pictures of any size, or of the size of a calibration.

    Args:
        calibration: path of a file, see `read_calibration`; empty for none.
        fov: deg, horizontal field of view of an ideal pinhole camera with its axis through the middle; 0 for unknown.

    Raises:
        ConfigError: for both, a field of view that no pinhole camera has, or a file that cannot be used.
    """

    def __init__(self, calibration: str = "", fov: float = 0.0) -> None:
        if calibration and fov:
            raise ConfigError("give `calibration` or `fov`, not both")
        if not 0.0 <= fov < 180.0:
            raise ConfigError(f"fov {fov}: expected degrees, more than 0 and less than 180")
        self._calibrated = read_calibration(Path(calibration)) if calibration else None
        self._fov = math.radians(fov)

    def __bool__(self) -> bool:
        return self._calibrated is not None or self._fov > 0.0

    def meta(self, shape: tuple[int, ...]) -> dict[str, float | int | str]:
        """What a frame with images of `shape` (height, width, ...) tells: see `Intrinsics.meta`; empty if unknown.

        Raises `SizeError` if the calibration is about images of another size.
        """
        known = self._calibrated
        if known is None:
            return Intrinsics.from_fov(shape[1], shape[0], self._fov).meta() if self._fov else {}
        if (known.height, known.width) != shape[:2]:
            raise SizeError(
                f"its pictures have {shape[1]} x {shape[0]} px, and its calibration is about {known.width} x "
                f"{known.height}: they go on without intrinsics; set `width` and `height`, or calibrate at this size"
            )
        return known.meta()


def read_calibration(path: Path) -> Intrinsics:
    """The intrinsics in a file.

    `.toml` has the attributes of a camera's node: fx, fy, cx, cy, width, height, distortion_model, distortion. `.yaml`
    or `.yml` is that of ROS (camera_calibration, camera_info_manager), or one that OpenCV wrote with camera_matrix,
    distortion_coefficients, image_width and image_height.

    Raises:
        ConfigError: if it cannot be read, or lacks something.
    """
    text = read_text(path)
    try:
        told = _from_toml(text) if path.suffix == ".toml" else _from_yaml(text)
        return _intrinsics(told)
    except (ValueError, TypeError, KeyError) as error:
        missing = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ConfigError(f"{path}: no calibration of a camera: {missing}") from error


def _intrinsics(told: dict[str, Any]) -> Intrinsics:
    size = int(told["height"]), int(told["width"])
    if min(size) < 1:
        raise ValueError(f"images of {size[1]} x {size[0]} px")
    found = Intrinsics.from_meta({name: told[name] for name in INTRINSICS[:4]}, size)
    coefficients = list(told.get("distortion") or ())
    if not any(coefficients):
        return found
    model = told.get("distortion_model") or _BY_COUNT.get(len(coefficients), "")
    return replace(found, distortion=Distortion.of(model, coefficients))


def _from_toml(text: str) -> dict[str, Any]:
    return tomllib.loads(text)


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
