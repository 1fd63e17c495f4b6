"""Collision meshes of a robot: found, and wholly within the boxes that stand for them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh

from agents.arm_controller.model.mesh_boxes import boxes_around
from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.model.urdf import load_robot
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose

ARM = """<robot name="arm"><link name="base"><collision><origin xyz="0 0 1"/>
  <geometry><mesh filename="{file}" scale="{scale}"/></geometry></collision></link></robot>"""


TURN = Pose.from_rotvec((0.0, 0.0, 0.0), (0.2, 0.4, 0.5))
LEVEL = Pose.from_rotvec((0.1, 0.0, 0.15), (0.0, math.pi / 2, 0.0))


def elbow() -> trimesh.Trimesh:
    """A bent tube, askew: 0.3 m up, then 0.2 m along x."""
    upright, level = trimesh.creation.cylinder(0.03, 0.3), trimesh.creation.cylinder(0.03, 0.2)
    level.apply_transform(LEVEL.matrix)
    both = trimesh.util.concatenate([upright, level])
    assert isinstance(both, trimesh.Trimesh)
    both.apply_transform(TURN.matrix)
    return both


def enclosed() -> np.ndarray:
    """Points (n, 3) within the elbow."""
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 3))
    points = points[np.hypot(points[:, 0], points[:, 1]) < 0.99] * (0.03, 0.03, 0.1)
    both = np.vstack([points * (1, 1, 1.5), LEVEL.apply(points)])
    return TURN.apply(both)


def inside(boxes: tuple[LinkBox, ...], points: np.ndarray) -> np.ndarray:
    found = np.zeros(len(points), dtype=bool)
    for box in boxes:
        found |= (np.abs(box.pose.inverse().apply(points)) <= np.array(box.half) + 1e-6).all(axis=1)
    return found


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".dae", ".glb"])
def test_all_that_a_mesh_encloses_is_within_its_boxes(suffix: str, tmp_path: Path) -> None:
    elbow().export(tmp_path / f"elbow{suffix}")
    boxes = boxes_around(tmp_path / f"elbow{suffix}", (1.0, 1.0, 1.0))
    assert inside(boxes, enclosed()).all() and inside(boxes, elbow().vertices).all()


def test_slices_fit_a_bent_link_and_a_straight_one_has_one_box(tmp_path: Path) -> None:
    elbow().export(tmp_path / "elbow.stl")
    trimesh.creation.box((0.1, 0.1, 0.5)).export(tmp_path / "beam.stl")
    whole = math.prod(elbow().bounding_box_oriented.primitive.extents)
    bent = boxes_around(tmp_path / "elbow.stl", (1.0, 1.0, 1.0))
    assert 2 <= len(bent) <= 4
    assert sum(math.prod(box.size) for box in bent) < 0.7 * whole
    (beam,) = boxes_around(tmp_path / "beam.stl", (1.0, 1.0, 1.0))
    assert sorted(beam.size) == pytest.approx((0.1, 0.1, 0.5))


def test_scale_stretches_and_mirrors(tmp_path: Path) -> None:
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    box.apply_translation((0.5, 0.0, 0.0))
    box.export(tmp_path / "box.stl")
    (found,) = boxes_around(tmp_path / "box.stl", (-0.001, 0.001, 0.002))
    assert sorted(found.size) == pytest.approx((0.001, 0.001, 0.002))
    assert found.pose.t == pytest.approx((-0.0005, 0.0, 0.0), abs=1e-9)


def test_a_flat_mesh_has_a_box_with_volume(tmp_path: Path) -> None:
    corners = [(0, 0, 0), (0.1, 0, 0), (0.1, 0.2, 0), (0, 0.2, 0)]
    trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)]).export(tmp_path / "plate.stl")
    (box,) = boxes_around(tmp_path / "plate.stl", (1.0, 1.0, 1.0))
    assert sorted(box.size) == pytest.approx((0.001, 0.1, 0.2))


def test_a_mesh_that_is_smaller_than_any_edge_has_a_box_too(tmp_path: Path) -> None:
    """Such a shape vanished: a mesh in the wrong unit let the arm through."""
    corners = 1e-20 * np.random.default_rng(0).normal(size=(30, 3))
    trimesh.Trimesh(corners, np.arange(30).reshape(10, 3), process=False).export(tmp_path / "dust.stl")
    (box,) = boxes_around(tmp_path / "dust.stl", (1.0, 1.0, 1.0))
    assert box.size == pytest.approx((0.001, 0.001, 0.001))


@pytest.mark.parametrize("form", ["flat", "solid"])
def test_a_mesh_of_many_triangles_is_within_its_boxes_and_takes_no_square_of_memory(tmp_path: Path, form: str) -> None:
    count = 50_000  # a square of that are 20 GB
    rng = np.random.default_rng(0)
    soup = rng.random((count, 1, 3)) * (1.0, 0.2, 0.3) + 0.01 * rng.normal(size=(count, 3, 3))
    soup = (soup * (1.0, 1.0, 0.0 if form == "flat" else 1.0)).reshape(-1, 3)
    trimesh.Trimesh(soup, np.arange(3 * count).reshape(-1, 3), process=False).export(tmp_path / "soup.stl")
    within = np.zeros(len(soup), dtype=bool)
    for box in boxes_around(tmp_path / "soup.stl", (1.0, 1.0, 1.0)):
        away = np.abs(box.pose.inverse().apply(soup.astype(np.float32).astype(np.float64)))
        within |= (away <= np.array(box.half) + 1e-9).all(axis=1)
    assert within.all()


@pytest.mark.parametrize("name", ["meshes/box.stl", "package://my_arm/meshes/box.stl", "file://{folder}/meshes/box.stl"])
def test_meshes_are_found_by_path_and_by_package(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "my_arm"
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    trimesh.creation.box((0.1, 0.2, 0.3)).export(folder / "meshes" / "box.stl")
    description = folder / ("urdf" if name.startswith("package") else ".") / "arm.urdf"
    description.write_text(ARM.format(file=name.format(folder=folder), scale="1 1 1"))
    (box,) = load_robot(description).boxes["base"]
    assert sorted(box.size) == pytest.approx((0.1, 0.2, 0.3)) and box.pose.t == pytest.approx((0.0, 0.0, 1.0))


@pytest.mark.parametrize(("variable", "place"), [("AMENT_PREFIX_PATH", "share/arm"), ("ROS_PACKAGE_PATH", "arm")])
def test_packages_of_ros_are_found(
    variable: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ros" / place).mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "ros" / place / "box.stl")
    monkeypatch.setenv(variable, str(tmp_path / "ros"))
    (tmp_path / "arm.urdf").write_text(ARM.format(file="package://arm/box.stl", scale="1 1 1"))
    assert len(load_robot(tmp_path / "arm.urdf").boxes["base"]) == 1


@pytest.mark.parametrize(
    ("content", "scale", "reason"),
    [
        (None, "1 1 1", "link 'base': mesh 'box.stl': there is no file"),
        (b"", "1 1 1", r"link 'base': .*box\.stl: is empty"),
        (b"solid nothing\nendsolid", "1 1 1", r"link 'base': .*box\.stl: "),
        (b"never read", "1 0 1", "expected no zero"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_an_error_with_link_and_file(
    content: bytes | None, scale: str, reason: str, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "box.stl").write_bytes(content)
    (tmp_path / "arm.urdf").write_text(ARM.format(file="box.stl", scale=scale))
    with pytest.raises(ConfigError, match=reason) as error:
        load_robot(tmp_path / "arm.urdf")
    assert str(error.value).startswith(f"{tmp_path}/arm.urdf:")
