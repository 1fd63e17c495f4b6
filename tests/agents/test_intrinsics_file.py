"""Files of intrinsics: ours, those of ROS and OpenCV, and files that are none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from agents.intrinsics_file import read_intrinsics_file
from dsr.errors import ConfigError
from dsr.vocabulary.distortion import Distortion
from dsr.vocabulary.intrinsics import Intrinsics

EXPECTED = Intrinsics(500.5, 501.5, 320.25, 240.75, 640, 480, Distortion("plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.03)))
TOML = """fx = 500.5
fy = 501.5
cx = 320.25
cy = 240.75
width = 640
height = 480
distortion_model = "plumb_bob"
distortion = [0.1, -0.2, 0.001, 0.002, 0.03]
"""
ROS = """image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [500.5, 0., 320.25, 0., 501.5, 240.75, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.2, 0.001, 0.002, 0.03]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1., 0., 0., 0., 1., 0., 0., 0., 1.]
"""


JSON = """{"fx": 500.5, "fy": 501.5, "cx": 320.25, "cy": 240.75, "width": 640, "height": 480,
"distortion_model": "plumb_bob", "distortion": [0.1, -0.2, 0.001, 0.002, 0.03]}"""
RESULT = f"mount = {{ translation = [0.0, 0.0, 0.1] }}\n\n[intrinsics]\n{TOML}"
"""As a calibration writes it, with more beside"""


@pytest.mark.parametrize(
    ("name", "text"),
    [("camera.toml", TOML), ("ost.yaml", ROS), ("camera.json", JSON), ("hand_eye.toml", RESULT)],
)
def test_files_of_ours_and_one_of_ros_tell_the_same(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    assert read_intrinsics_file(tmp_path / name) == EXPECTED


def test_a_file_that_opencv_wrote(tmp_path: Path) -> None:
    path = tmp_path / "camera.yml"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("image_width", 640)
    file.write("image_height", 480)
    file.write("camera_matrix", EXPECTED.matrix)
    assert EXPECTED.distortion is not None
    file.write("distortion_coefficients", np.array([EXPECTED.distortion.coefficients]).T)
    file.release()
    assert read_intrinsics_file(path) == EXPECTED


def test_coefficients_that_are_all_zero_are_no_distortion(tmp_path: Path) -> None:
    (tmp_path / "ost.yaml").write_text(ROS.replace("0.1, -0.2, 0.001, 0.002, 0.03", "0., 0., 0., 0., 0."))
    assert read_intrinsics_file(tmp_path / "ost.yaml").distortion is None


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.toml", TOML.replace("fx = 500.5", ""), "'fx' is missing"),
        ("a.toml", TOML.replace("500.5", "0.0"), "expected fx, fy >= 1 px"),
        ("a.toml", TOML.replace("500.5", "nan"), "expected fx, fy >= 1 px"),
        ("a.toml", TOML.replace("width = 640", "width = 0"), "images of 0 x 480 px"),
        ("a.toml", TOML.replace("500.5", "true"), "fx missing"),
        ("a.toml", TOML.replace("width = 640", "width = inf"), "expected a whole number of px"),
        ("a.toml", TOML.replace("width = 640", "width = 640.5"), "expected a whole number of px"),
        ("a.toml", TOML.replace("width = 640", 'width = "640"'), "expected a whole number of px"),
        ("a.toml", TOML.replace("width = 640", "width = true"), "expected a whole number of px"),
        ("a.toml", TOML.replace("width = 640", "width = 1e12"), "none is larger"),
        ("a.toml", TOML.replace("distortion_model", "a").replace("0.1, ", "0.1, 0.3, "), "of which distortion_model"),
        ("a.yaml", ROS.replace("image_width: 640", "image_width: .inf"), "expected a whole number of px"),
        ("a.yaml", "- a\n- b\n", "expected a map"),
        ("a.toml", TOML.replace("plumb_bob", "gold"), "distortion 'gold'"),
        ("a.toml", TOML.replace("0.1, -0.2, ", ""), "3 coefficients"),
        ("a.json", "[1, 2]", "expected a table"),
        ("a.json", "{", "no intrinsics"),
        ("a.toml", "fx", "no intrinsics"),
        ("a.yaml", ROS.replace("camera_matrix", "matrix"), "camera_matrix has 0 numbers"),
        ("a.yaml", ROS.replace("image_width", "width"), "'image_width' is missing"),
        ("a.yaml", "]{\n", "no intrinsics"),
        ("a.yaml", "", "no intrinsics"),
    ],
)
def test_a_file_that_is_none_says_what_is_wrong(tmp_path: Path, name: str, text: str, said: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=said):
        read_intrinsics_file(tmp_path / name)
