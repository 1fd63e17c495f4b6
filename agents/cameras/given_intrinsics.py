"""Intrinsics of a camera that tells none: from a file of its calibration, or from its stated field of view."""

from __future__ import annotations

import math
from pathlib import Path

from agents.intrinsics_file import read_intrinsics_file
from dsr.errors import ConfigError, DsrError
from dsr.vocabulary.intrinsics import Intrinsics


class SizeError(DsrError):
    """Pictures are of another size than those for which the camera was calibrated."""


class GivenIntrinsics:
    """Intrinsics for pictures of any size, or of the size of a calibration.

    Args:
        calibration: path of a file, see `read_intrinsics_file`; empty for none.
        fov: deg, horizontal field of view of an ideal pinhole camera with its axis through the middle; 0 for unknown.

    Raises:
        ConfigError: for both, a field of view that no pinhole camera has, or a file that cannot be used.
    """

    def __init__(self, calibration: str = "", fov: float = 0.0) -> None:
        if calibration and fov:
            raise ConfigError("give `calibration` or `fov`, not both")
        if not 0.0 <= fov < 180.0:
            raise ConfigError(f"fov {fov}: expected degrees, more than 0 and less than 180")
        self._calibrated = read_intrinsics_file(Path(calibration)) if calibration else None
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
