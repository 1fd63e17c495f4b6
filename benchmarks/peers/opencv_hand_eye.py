"""OpenCV's hand-eye calibrations, in a process of their own: OpenCV 5.0 for Python lacks them, OpenCV 4 has them.

As a program it reads hands and targets as JSON on standard input, and writes what each method finds.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PACKAGE = "opencv-python-headless==4.14.0.94"
_METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
_WITH_BASE = ("SHAH", "LI")
_PATIENCE = 300.0
"""s for fetching OpenCV"""


class OpenCv:
    """A Python with an OpenCV that has hand-eye calibration.

    Args:
        folder: gets OpenCV 4 if it is not there, and if this Python's OpenCV has no hand-eye calibration.

    Raises:
        OSError: if OpenCV cannot be fetched.
    """

    def __init__(self, folder: Path) -> None:
        self._environment = dict(os.environ)
        if not self._has():
            self._environment["PYTHONPATH"] = str(folder)
            if not self._has():
                sys.stderr.write(f"fetching {PACKAGE} into {folder}: the OpenCV here has no hand-eye calibration\n")
                options = ["--quiet", "--no-deps", "--disable-pip-version-check", "--target", str(folder), PACKAGE]
                command = [sys.executable, "-m", "pip", "install", *options]
                done = subprocess.run(command, check=False, timeout=_PATIENCE)
                if done.returncode or not self._has():
                    raise OSError(f"{PACKAGE} cannot be fetched")

    def mounts(self, hands: Array, targets: Array) -> dict[str, tuple[Array, Array]]:
        """hand_from_camera and base_from_target (4, 4) by each method that does not fail.

        Args:
            hands: (v, 4, 4) base_from_hand.
            targets: (v, 4, 4) camera_from_target.
        """
        text = json.dumps({"hands": hands.tolist(), "targets": targets.tolist()})
        command = [sys.executable, str(Path(__file__).resolve()), "run"]
        done = subprocess.run(command, input=text, env=self._environment, stdout=subprocess.PIPE, text=True, check=True)
        found = json.loads(done.stdout.splitlines()[-1])
        return {name: (np.array(camera), np.array(target)) for name, (camera, target) in found.items()}

    def _has(self) -> bool:
        program = "import cv2, sys; sys.exit(not hasattr(cv2, 'calibrateHandEye'))"
        done = subprocess.run([sys.executable, "-c", program], env=self._environment, capture_output=True, check=False)
        return done.returncode == 0


def _main() -> None:
    import cv2

    data = json.load(sys.stdin)
    hands, targets = np.array(data["hands"]), np.array(data["targets"])
    vision: Any = cv2  # the stubs are those of another version
    found = {}
    for name in _METHODS:
        method = getattr(vision, f"CALIB_HAND_EYE_{name}")
        turn, shift = vision.calibrateHandEye(
            hands[:, :3, :3], hands[:, :3, 3], targets[:, :3, :3], targets[:, :3, 3], method=method
        )
        camera = _matrix(turn, shift)
        found[name] = (camera.tolist(), _mean(hands @ camera @ targets).tolist())
    inverse = np.linalg.inv(hands)
    for name in _WITH_BASE:
        method = getattr(vision, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
        try:
            base_turn, base_shift, turn, shift = vision.calibrateRobotWorldHandEye(
                targets[:, :3, :3], targets[:, :3, 3], inverse[:, :3, :3], inverse[:, :3, 3], method=method
            )
        except cv2.error:  # its rotations came out singular
            continue
        camera, target = (_inverse(_matrix(*pair)) for pair in ((turn, shift), (base_turn, base_shift)))
        found[name] = (camera.tolist(), target.tolist())
    sys.stdout.write(json.dumps(found) + "\n")


def _matrix(turn: Array, shift: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, np.ravel(shift)
    return np.asarray(pose, np.float64)


def _inverse(pose: Array) -> Array:
    return np.asarray(np.linalg.inv(pose), np.float64)


def _mean(poses: Array) -> Array:
    """The mean of poses (v, 4, 4): rotations by the nearest one to their sum."""
    u, _, vt = np.linalg.svd(poses[:, :3, :3].sum(axis=0))
    return _matrix(u @ np.diag((1.0, 1.0, np.linalg.det(u @ vt))) @ vt, poses[:, :3, 3].mean(axis=0))


if __name__ == "__main__":
    _main()
