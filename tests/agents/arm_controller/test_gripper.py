"""Fingers that slide, mimic one another, or hang from a linkage: where they are, and how far apart."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import trimesh

from agents.arm_controller.model.arm_model import arm_model, load_arm
from agents.arm_controller.model.gripper import GripperModel
from agents.arm_controller.model.shapes import bounds
from agents.arm_controller.model.urdf import parse_robot
from dsr.errors import ConfigError
from dsr.math3d.transforms import Pose

from .conftest import GEN3

ROBOTS = sorted(GEN3.parent.glob("*.urdf"))
JAWS = """<robot name="jaws">
  <link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="palm"/><link name="left">{pad}</link><link name="right">{pad}</link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="palm"/><axis xyz="0 0 1"/></joint>
  <joint name="open_left" type="prismatic"><parent link="palm"/><child link="left"/><origin xyz="0.005 0 0.1"/>
    <axis xyz="{axis}"/><limit lower="0" upper="0.03"/></joint>
  <joint name="open_right" type="prismatic"><parent link="palm"/><child link="right"/><origin xyz="-0.005 0 0.1"/>
    <axis xyz="{axis}"/><limit lower="-0.03" upper="0"/><mimic joint="{master}" multiplier="-1"/></joint>
  <joint name="tool_joint" type="fixed"><parent link="palm"/><child link="tool0"/><origin xyz="0 0 0.1"/></joint>
  <link name="tool0"/></robot>"""
PAD = '<collision><geometry><box size="0.01 0.02 0.03"/></geometry></collision>'


def jaws(axis: str = "1 0 0", master: str = "open_left", pad: str = PAD) -> GripperModel:
    return arm_model(parse_robot(JAWS.format(axis=axis, master=master, pad=pad).encode())).gripper


def test_jaws_of_the_gen3_share_the_opening_evenly() -> None:
    gripper = load_arm(GEN3).gripper
    assert gripper.widest == pytest.approx(0.085)
    assert gripper.positions(0.04) == pytest.approx({"finger_left_joint": 0.02, "finger_right_joint": 0.02})
    assert gripper.opening({"finger_left_joint": 0.01, "finger_right_joint": 0.03}) == pytest.approx(0.04)
    assert bounds(gripper.boxes(0.04)) == pytest.approx((-0.036, -0.011, 0.08, 0.036, 0.011, 0.135))


def test_a_finger_that_mimics_another_is_not_driven() -> None:
    gripper = jaws()
    assert [joint.name for joint in gripper.driven] == ["open_left"]
    assert gripper.widest == pytest.approx(0.06)
    assert gripper.positions(0.02) == pytest.approx({"open_left": 0.01, "open_right": -0.01})
    assert gripper.sides() == (frozenset({"right"}), frozenset({"left"}))


@pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.stem)
def test_pads_are_as_far_apart_as_the_opening_says_and_stay_upright(file: Path) -> None:
    model = load_arm(file)
    narrowest = model.gripper.opening(model.gripper.positions(0.0))
    assert narrowest < 0.0025
    for opening in np.linspace(narrowest, model.gripper.widest, 7):
        positions = model.gripper.positions(opening)
        assert model.gripper.opening(positions) == pytest.approx(opening, abs=1e-6)
        boxes = [box.seen_from(model.palm_from_tool.inverse()) for box in model.gripper.boxes(opening)]
        beside = [box for box in boxes if box.corners[:, 2].min() <= 0.0 <= box.corners[:, 2].max()]
        right = min(box.corners[:, 0].min() for box in beside if box.pose.t[0] > 0)
        left = max(box.corners[:, 0].max() for box in beside if box.pose.t[0] < 0)
        assert right - left == pytest.approx(opening, abs=5e-5)
        pads = [box for box in beside if box.size[2] < 0.045]
        assert all(abs(box.pose.rotation_matrix[2, 2]) == pytest.approx(1.0, abs=1e-9) for box in pads)


def test_fingers_that_also_move_along_the_tool_have_other_parts_beside_the_tool_point_on_the_way() -> None:
    """As the tips of a real Robotiq 2F-85, whose meshes are several boxes each."""
    parts = "".join(PAD.replace("<geometry>", f'<origin xyz="0 0 {z}"/><geometry>') for z in (-0.03, 0.0, 0.03))
    gripper = jaws(axis="1 0 0.8", pad=parts)
    assert gripper.widest == pytest.approx(0.06 / math.hypot(1.0, 0.8))
    assert gripper.opening({"open_left": 0.015}) == pytest.approx(gripper.widest / 2)


def test_a_finger_tip_whose_mesh_is_slanted_behind_is_as_wide_as_its_pad_is_flat(tmp_path: Path) -> None:
    """The smallest box around such a wedge lies along its back, and stands out between the pads."""
    inner, back, low, high = -0.005, 0.005, -0.03, 0.03
    corners = [(inner, y, z) for y in (-0.01, 0.01) for z in (low, high)] + [(back, y, low) for y in (-0.01, 0.01)]
    parts = {}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        wedge = trimesh.convex.convex_hull(np.array(corners) * (sign, 1.0, 1.0))
        wedge.export(tmp_path / f"{side}.stl")
        parts[side] = f'<collision><geometry><mesh filename="{side}.stl"/></geometry></collision>'
    text = JAWS.format(axis="1 0 0", master="open_left", pad="{}").replace(
        '<link name="left">{}</link><link name="right">{}</link>',
        f'<link name="left">{parts["left"]}</link><link name="right">{parts["right"]}</link>',
    )
    gripper = arm_model(parse_robot(text.encode(), str(tmp_path / "jaws.urdf"))).gripper
    assert gripper.widest == pytest.approx(0.06, abs=1e-6)
    assert gripper.opening(gripper.positions(0.03)) == pytest.approx(0.03, abs=1e-6)
    right = np.add(corners, (0.02, 0.0, 0.1))
    points = np.vstack([right, right * (-1.0, 1.0, 1.0)])
    free = np.ones(len(points), dtype=bool)
    for box in gripper.boxes(0.03):
        free &= ~(np.abs(box.pose.inverse().apply(points)) <= np.array(box.half) + 1e-6).all(axis=1)
    assert not free.any(), "all of the mesh is within the boxes"


def test_knuckles_of_the_open_manipulator_turn_as_its_maker_says() -> None:
    """The gap between the pads follows 2 (0.008 + 0.0494 cos q - 0.0285 sin q), less the pads' depth of 4 mm each."""
    gripper = load_arm(GEN3.with_name("open_manipulator_p.urdf")).gripper
    assert gripper.widest == pytest.approx(0.106, abs=0.001)
    for angle in (0.0, 0.3, 0.7, 1.0):
        gap = 2 * (0.008 + 0.0494 * math.cos(angle) - 0.0285 * math.sin(angle) - 0.004)
        assert gripper.opening({"knuckle_right_joint": angle}) == pytest.approx(gap, abs=5e-5)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"axis": "0 1 0"}, "the fingers close along the y axis of the tool; its x axis must point from finger"),
        ({"axis": "0 0 1"}, "no finger has a collision shape beside the tool point at all openings"),
        ({"pad": ""}, "no finger has a collision shape beside the tool point"),
        ({"master": "turn"}, "finger joint 'open_right' mimics 'turn', which is none below 'palm'"),
    ],
)
def test_fingers_that_could_not_grasp_are_refused(changes: dict[str, str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        jaws(**changes)


def test_an_arm_without_fingers_has_no_opening() -> None:
    text = JAWS.format(axis="1 0 0", master="open_left", pad=PAD)
    text = text.replace('"prismatic"', '"fixed"').replace('<mimic joint="open_left" multiplier="-1"/>', "")
    gripper = arm_model(parse_robot(text.encode())).gripper
    assert gripper.widest == 0.0 and gripper.driven == () and gripper.boxes(0.0) == ()


def test_roles_of_links_are_found_in_a_strange_description() -> None:
    """The Panda of pybullet has meshes, and fingers that close along y: its tool point must be told."""
    package = find_spec("pybullet_data")
    assert package is not None and package.origin is not None
    panda = Path(package.origin).parent / "franka_panda" / "panda.urdf"
    mount = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    with pytest.raises(ConfigError, match="close along the y axis"):
        load_arm(panda, tool="panda_grasptarget")
    model = load_arm(panda, tool="panda_grasptarget", tool_mount=mount)
    assert (model.base, model.palm, len(model.chain)) == ("panda_link0", "panda_hand", 7)
    assert [joint.name for joint in model.gripper.driven] == ["panda_finger_joint1"]
    assert model.gripper.widest == pytest.approx(0.08, abs=0.003)  # its tips are rounded: their boxes are wider
    assert len(model.robot.boxes["panda_link4"]) > 1


@pytest.mark.parametrize(
    ("names", "reason"),
    [
        ({"palm": "plam"}, "no link 'plam'; did you mean 'palm'"),
        ({"fingers": ["open"]}, "no finger joint 'open'; "),
        ({"tool": "left"}, "joint 'open_left' moves tool 'left' against 'palm'"),
        ({"base": "palm"}, "no joint moves 'tool0' against 'palm'"),
        ({"home": {"trun": 0.0}}, "its home posture does not say where joint 'turn' is"),
    ],
)
def test_wrong_names_are_refused(names: dict[str, object], reason: str) -> None:
    robot = parse_robot(JAWS.format(axis="1 0 0", master="open_left", pad=PAD).encode())
    with pytest.raises(ConfigError, match=reason):
        arm_model(robot, **names)  # type: ignore[arg-type]


def test_an_srdf_file_beside_the_description_names_roles_and_home(tmp_path: Path) -> None:
    (tmp_path / "jaws.urdf").write_text(JAWS.format(axis="1 0 0", master="open_left", pad=PAD))
    (tmp_path / "jaws.srdf").write_text(
        """<robot name="jaws"><group name="arm"><chain base_link="base" tip_link="tool0"/></group>
        <group name="hand"><joint name="open_left"/></group>
        <end_effector name="hand" parent_link="palm" group="hand"/>
        <group_state name="ready" group="arm"><joint name="turn" value="1"/></group_state>
        <group_state name="home" group="arm"><joint name="turn" value="0.5"/></group_state></robot>"""
    )
    model = load_arm(tmp_path / "jaws.urdf")
    assert (model.base, model.palm, model.tool, model.home) == ("base", "palm", "tool0", (0.5,))
    with pytest.raises(ConfigError, match="no link 'hand'"):
        load_arm(tmp_path / "jaws.urdf", palm="hand")
