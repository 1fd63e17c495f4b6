"""`dsr calibrate hand-eye`: from a folder of images to a file with the mount; and what it says of wrong input."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from agents.calibrator.cli import app
from agents.calibrator.hand_eye.reading import intrinsics_for, read_hands
from agents.calibrator.hand_eye.targets import read_target
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose
from tests.agents.calibrator.hand_eye_pictures import PINHOLE, picture
from tests.agents.calibrator.hand_eye_views import HELD, MOUNT, looks

NAME = "circles:7x5:0.03"
COUNT = 7


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder `images`, `poses.csv`, `poses.json` and `lens.toml`; camera in hand."""
    place = tmp_path_factory.mktemp("hand_eye")
    (place / "images").mkdir()
    target = read_target(NAME)
    rows, table = [], ["image,x,y,z,qx,qy,qz,qw"]
    for row, pose in enumerate(looks(COUNT, 11, target)):
        cv2.imwrite(str(place / f"images/{row}.png"), picture(target, pose, row))
        hand = Pose.from_matrix(np.linalg.inv(MOUNT @ pose @ np.linalg.inv(HELD)))
        rows.append({"image": f"{row}.png", "position": list(hand.t), "rotation": list(hand.q)})
        table.append(",".join([f"{row}.png", *map(repr, (*hand.t, *hand.q))]))
    (place / "poses.json").write_text(json.dumps(rows), encoding="utf-8")
    (place / "poses.csv").write_text("\n".join(table) + "\n", encoding="utf-8")
    lens = "".join(f"{name} = {getattr(PINHOLE, name)}\n" for name in ("fx", "fy", "cx", "cy", "width", "height"))
    (place / "lens.toml").write_text(lens, encoding="utf-8")
    return place


def run(folder: Path, *options: str, poses: str = "poses.csv", target: str = NAME, images: str = "images") -> Result:
    paths = ["--images", str(folder / images), "--poses", str(folder / poses), "--target", target]
    return CliRunner().invoke(app, ["hand-eye", *paths, *options])


def said(result: Result) -> str:
    """The error by which a command ends."""
    assert isinstance(result.exception, ConfigError), result.output
    return str(result.exception)


def test_the_mount_is_told_and_written(folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "wrist.toml"
    result = run(folder, "--intrinsics", str(folder / "lens.toml"), "-o", str(file))
    assert result.exit_code == 0, result.output
    assert "hand -> camera:" in result.output and "mount = { translation = [" in result.output
    written = tomllib.loads(file.read_text(encoding="utf-8"))
    mount = Pose(written["mount"]["translation"], written["mount"]["rotation"])
    apart = mount.distance(Pose.from_matrix(MOUNT))
    assert apart[0] < 0.003 and apart[1] < 0.006
    assert len(written["covariance"]) == 36
    again = run(folder, "--intrinsics", str(file), "--json", poses="poses.json")  # the result tells intrinsics, too
    assert json.loads(again.stdout)["std_mm"][0] < 3.0


def test_intrinsics_are_fitted(folder: Path) -> None:
    result = run(folder, "--fit-intrinsics", "--lens", "pinhole", "--json")
    report = json.loads(result.stdout)
    assert report["intrinsics"]["fx"] == pytest.approx(PINHOLE.fx, rel=0.02)


def test_images_are_counted_and_compared(folder: Path, tmp_path: Path) -> None:
    lens = ("--intrinsics", str(folder / "lens.toml"))
    table = (folder / "poses.csv").read_text(encoding="utf-8").splitlines()
    unnamed = [",".join(line.split(",")[1:]) for line in table]
    (folder / "short.csv").write_text("\n".join(unnamed[:-1]), encoding="utf-8")
    assert "6 poses, but 7 images" in said(run(folder, *lens, poses="short.csv"))
    (folder / "unknown.csv").write_text("\n".join(table).replace("3.png", "x.png"), encoding="utf-8")
    assert "no image x.png" in said(run(folder, *lens, poses="unknown.csv"))
    (folder / "twice.csv").write_text("\n".join(table).replace("3.png", "2.png"), encoding="utf-8")
    assert "an image of its own" in said(run(folder, *lens, poses="twice.csv"))
    other = tmp_path / "images"
    other.mkdir()
    for image in (folder / "images").iterdir():
        (other / image.name).write_bytes(image.read_bytes())
    cv2.imwrite(str(other / "5.png"), np.zeros((100, 100), np.uint8))
    assert "one size; 0.png and 5.png have 640x480 and 100x100" in said(run(folder, *lens, images=str(other)))
    (other / "5.png").write_bytes(b"no image")
    assert "no image that can be read" in said(run(folder, *lens, images=str(other)))


def test_a_target_that_does_not_show_is_named(folder: Path) -> None:
    lens = ("--intrinsics", str(folder / "lens.toml"))
    assert "found in none of 7 images" in said(run(folder, *lens, target="tag36h11:3:0.05"))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ((), "tell --intrinsics FILE"),
        (("--fit-intrinsics", "--lens", "round"), "--lens round"),
        (("--fit-intrinsics", "--fit-joints"), "go with --urdf only"),
        (("--fit-intrinsics", "-o", "mount.yaml"), ".toml or .json"),
        (("--fit-intrinsics", "--urdf", "etc/robots/gen3.urdf", "--position-std", "0.1"), "tell --joint-std"),
    ],
)
def test_options_that_do_not_fit_are_refused(folder: Path, options: tuple[str, ...], expected: str) -> None:
    assert expected in said(run(folder, *options))


@pytest.mark.parametrize(("option", "value"), [("--position-std", "inf"), ("--rotation-std", "57.3")])
def test_errors_of_a_hand_that_is_nowhere_are_refused(folder: Path, option: str, value: str) -> None:
    result = run(folder, "--fit-intrinsics", option, value)
    assert result.exit_code == 2 and option in result.output


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("a.csv", "x,y,z\n1,2,3\n", "qx, qy, qz, qw missing"),
        ("a.csv", "x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0\n", "line 2|:2"),
        ("a.csv", "x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,9\n", "pose 1"),
        ("a.json", "{", "not valid JSON"),
        ("a.json", '[{"joints": [1, 2]}]', "joints need --urdf"),
        ("a.json", '[{"positon": [1, 2, 3]}]', "positon"),
        ("a.json", "[]", "0 poses"),
    ],
)
def test_files_of_poses_are_checked(folder: Path, tmp_path: Path, name: str, text: str, expected: str) -> None:
    images = tmp_path / "images"
    images.mkdir()
    (images / "0.png").write_bytes((folder / "images/0.png").read_bytes())
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=expected):
        read_hands(images, tmp_path / name, None)


def test_images_come_in_the_order_in_which_people_count(folder: Path, tmp_path: Path) -> None:
    for number in (1, 2, 10):
        (tmp_path / f"{number}.png").write_bytes((folder / "images/0.png").read_bytes())
    rows = [{"position": [0, 0, 0], "rotation": [0, 0, 0, 1]}] * 3
    (tmp_path / "poses.json").write_text(json.dumps(rows), encoding="utf-8")
    hands = read_hands(tmp_path, tmp_path / "poses.json", None)
    assert [image.name for image in hands.images] == ["1.png", "2.png", "10.png"]


def test_intrinsics_of_another_size_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "lens.json"
    file.write_text(json.dumps(msgspec.to_builtins(PINHOLE) | {"distortion": []}), encoding="utf-8")
    assert intrinsics_for(file, (640, 480)) == PINHOLE
    with pytest.raises(ConfigError, match="640x480"):
        intrinsics_for(file, (1280, 720))
