"""URDF reading: what it means, and what it says about files that mean nothing."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
import trimesh

from agents.arm_controller.model.arm_model import arm_model
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.shapes import bounds
from agents.arm_controller.model.urdf import load_robot, parse_robot
from dsr.errors import ConfigError

from .conftest import GEN3

SLIDER = b"""<robot name="slider">
  <link name="rail"/><link name="sled"/><link name="hand"/>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="sled"/>
    <origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><axis xyz="2 0 0"/><limit lower="0" upper="0.5"/></joint>
  <joint name="turn" type="revolute"><parent link="sled"/><child link="hand"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="2"/></joint>
</robot>"""


def test_joint_moves_its_child_along_its_axis_in_the_child_frame() -> None:
    slide = parse_robot(SLIDER).parents["sled"]
    assert slide.pose(0.3).t == pytest.approx((0.0, 0.3, 1.0))
    assert (slide.lower, slide.upper, slide.velocity) == (0.0, 0.5, math.inf)


def test_revolute_joint_turns_about_its_axis() -> None:
    turn = parse_robot(SLIDER).parents["hand"]
    assert turn.pose(0.4).rotvec == pytest.approx((0.0, 0.0, 0.4))


def test_roll_pitch_yaw_turn_about_fixed_axes_in_that_order() -> None:
    text = SLIDER.replace(b'rpy="0 0 1.5707963267948966"', b'rpy="1.5707963267948966 1.5707963267948966 0"')
    y_axis = parse_robot(text).parents["sled"].origin.rotation_matrix @ (0, 1, 0)
    assert y_axis == pytest.approx((1, 0, 0))


def test_between_gives_the_joints_from_base_to_tip_and_names_what_is_wrong() -> None:
    robot = parse_robot(SLIDER)
    assert [joint.name for joint in robot.between("rail", "hand")] == ["slide", "turn"]
    with pytest.raises(ConfigError, match="no link 'hand2'; did you mean 'hand'"):
        robot.between("hand2", "hand")
    with pytest.raises(ConfigError, match="'rail' does not hang below link 'sled'"):
        robot.between("sled", "rail")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"</robot>", b"", "not valid XML"),
        (b"robot", b"sdf", "expected <robot>"),
        (b'xyz="2 0 0"', b'xyz="0 0 0"', "'slide': its axis has no length"),
        (b'xyz="0 0 1" rpy', b'xyz="0 nan 1" rpy', "expected 3 finite numbers"),
        (b'xyz="0 0 1" rpy', b'xyz="0 1" rpy', "expected 3 finite numbers"),
        (b'xyz="0 0 1" rpy', b'xyz="0 0 1e300" rpy', "<origin>: a length of 1e\\+300 m"),
        (b'type="revolute"', b'type="revolut"', "did you mean 'revolute'"),
        (b'lower="0"', b'lower="1"', "lower limit 1.0 is above"),
        (b'<parent link="rail"/>', b"", "'slide' has no <parent>"),
        (b'<parent link="sled"/>', b'<parent link="sledge"/>', "'sledge', which there is not; did you mean 'sled'"),
        (b'<parent link="rail"/>', b'<parent link="hand"/>', "the links are no tree: 'sled' is in a loop"),
        (b'<link name="hand"/>', b'<link name="hand"/><link name="lost"/>', "2 have no parent"),
        (b'<link name="rail"/>', b'<link name="rail"/><link name="rail"/>', "several links are called 'rail'"),
        (b"<robot", b'<!DOCTYPE r [<!ENTITY a "b">]><robot', "without DOCTYPE"),
    ],
)
def test_wrong_file_is_refused_with_its_reason(old: bytes, new: bytes, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as error:
        parse_robot(SLIDER.replace(old, new), "arm.urdf")
    assert str(error.value).startswith("arm.urdf:")


def test_missing_file_is_a_configuration_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_robot(tmp_path / "none.urdf")


def test_boxes_around_collision_shapes_and_what_is_fixed_to_them() -> None:
    robot = load_robot(GEN3)
    base, palm = robot.boxes["base_link"], robot.boxes["end_effector_link"]
    assert base[0].half == (0.05, 0.05, 0.075) and base[0].pose.t == (0.0, 0.0, 0.075)
    assert [box.half for box in palm] == [(0.0375, 0.0375, 0.03), (0.0625, 0.015, 0.01)]
    assert len(robot.rigid("link_7")) == len(robot.boxes["link_7"]) + len(palm)
    assert len(robot.rigid("link_7", without="end_effector_link")) == len(robot.boxes["link_7"])
    assert bounds(()) is None


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (b"", "link 'hand': expected one <geometry> of one shape, got 0"),
        (b"<geometry/>", "link 'hand': expected one <geometry> of one shape, got 0"),
        (b'<geometry><box size="1 1 1"/><sphere radius="2"/></geometry>', "of one shape, got 2"),
        (b'<geometry><box size="1 2"/></geometry>', "expected 3 finite numbers"),
        (b"<geometry><box/></geometry>", "link 'hand': its collision <box> has no volume"),
        (b'<geometry><cylinder radius="0.1"/></geometry>', "link 'hand': its collision <cylinder> has no volume"),
        (b'<geometry><sphere radius="-1"/></geometry>', "link 'hand': its collision <sphere> has no volume"),
        (
            b'<geometry><mesh filename="package://arm/hand.stl"/></geometry>',
            "link 'hand': mesh 'package://arm/hand.stl': there is no package 'arm'; expected a folder",
        ),
        (b'<geometry><mesh filename="hand.stl"/></geometry>', "link 'hand': mesh 'hand.stl': there is no file"),
        (b"<geometry><mesh/></geometry>", "link 'hand': a <mesh> has no 'filename'"),
        (b'<geometry><capsule radius="0.1" length="1"/></geometry>', "<capsule> is not supported here"),
        (b'<geometry><plane normal="0 0 1"/></geometry>', "<plane> is not supported here"),
    ],
)
def test_a_shape_that_would_be_left_out_is_refused_with_link_and_file(shape: bytes, reason: str) -> None:
    text = SLIDER.replace(b'<link name="hand"/>', b'<link name="hand"><collision>' + shape + b"</collision></link>")
    with pytest.raises(ConfigError, match=re.escape(reason)) as error:
        parse_robot(text, "arm.urdf")
    assert str(error.value).startswith("arm.urdf:")


def test_links_that_are_drawn_and_collide_with_nothing_are_named() -> None:
    drawn = b'<link name="hand"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
    assert parse_robot(SLIDER.replace(b'<link name="hand"/>', drawn)).drawn_only == ("hand",)
    assert load_robot(GEN3).drawn_only == ()


def test_macros_are_not_passed_over() -> None:
    text = SLIDER.replace(b'<robot name="slider">', b'<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:hand/>')
    with pytest.raises(ConfigError, match=r"arm\.urdf: it has xacro macros"):
        parse_robot(text, "arm.urdf")


MACROS = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="beside.xacro"/><xacro:include filename="$(find parts)/links.xacro"/>
  <xacro:arg name="length" default="0.2"/><link name="base"/>
  <xacro:bar name="bar" parent="base" length="${2 * $(arg length)}"/>{}</robot>"""
BAR = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="bar" params="name parent length">
  <link name="${name}"><collision><geometry><mesh filename="package://parts/bar.stl" scale="${length} 1 1"/></geometry>
  </collision></link><joint name="${name}_joint" type="continuous"><parent link="${parent}"/><child link="${name}"/>
  </joint></xacro:macro></robot>"""


@pytest.fixture
def macros(tmp_path: Path) -> Path:
    """A description that includes a file beside it, and one of a package with a mesh."""
    (tmp_path / "arm" / "urdf").mkdir(parents=True)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "links.xacro").write_text(BAR)
    trimesh.creation.box((1.0, 0.1, 0.1)).export(tmp_path / "parts" / "bar.stl")
    (tmp_path / "arm" / "urdf" / "beside.xacro").write_text("<robot/>")
    file = tmp_path / "arm" / "urdf" / "arm.urdf.xacro"
    file.write_text(MACROS.replace("{}", ""))
    return file


def test_macros_are_expanded_with_their_packages(macros: Path) -> None:
    robot = load_robot(macros)
    assert [joint.name for joint in robot.joints] == ["bar_joint"]
    assert sorted(robot.boxes["bar"][0].size) == pytest.approx((0.1, 0.1, 0.4))


def test_arguments_of_macros_are_passed_on(macros: Path) -> None:
    for value in (0.5, "0.5"):
        boxes = load_robot(macros, {"length": value}).boxes["bar"]
        assert sorted(boxes[0].size) == pytest.approx((0.1, 0.1, 1.0))
    weld = '<link name="more"/><joint name="weld" type="fixed"><parent link="bar"/><child link="more"/></joint>'
    switch = f'<xacro:arg name="two" default="false"/><xacro:if value="$(arg two)">{weld}</xacro:if>'
    macros.write_text(MACROS.replace("{}", switch))
    assert "more" in load_robot(macros, {"two": True}).boxes
    assert "more" not in load_robot(macros, {"two": False}).boxes


@pytest.mark.parametrize(
    ("args", "reason"),
    [
        ({"lenght": 0.5}, "it has no argument 'lenght'; did you mean 'length'"),
        ({"length": "long"}, "its macros cannot be expanded"),
        ({"a:=b": 1}, "'a:=b' is no name of an argument"),
        ({"": 1}, "'' is no name of an argument"),
    ],
)
def test_wrong_arguments_of_macros_are_an_error(args: dict[str, str | float], reason: str, macros: Path) -> None:
    with pytest.raises(ConfigError, match=reason) as error:
        load_robot(macros, args)
    assert str(error.value).startswith(str(macros))


def test_an_argument_that_macros_need_and_nobody_gives_is_named(macros: Path) -> None:
    macros.write_text(macros.read_text().replace('<xacro:arg name="length" default="0.2"/>', ""))
    with pytest.raises(ConfigError, match="it needs the argument 'length': give it in `urdf_args`"):
        load_robot(macros)
    assert load_robot(macros, {"length": 0.2}).boxes["bar"]


def test_a_file_without_macros_takes_no_arguments() -> None:
    with pytest.raises(ConfigError, match="it has no macros, so it takes no arguments: length"):
        load_robot(GEN3, {"length": 0.2})


@pytest.mark.parametrize(
    ("macro", "reason"),
    [
        ('<xacro:include filename="$(find gone)/a.xacro"/>', "cannot be expanded: there is no package 'gone'"),
        ("<xacro:gone/>", "its macros cannot be expanded: .*gone"),
        ('<link name="${1 / 0}"/>', "its macros cannot be expanded: .*division by zero"),
    ],
)
def test_macros_that_cannot_be_expanded_are_an_error(macro: str, reason: str, macros: Path) -> None:
    macros.write_text(MACROS.replace("{}", macro))
    with pytest.raises(ConfigError, match=reason) as error:
        load_robot(macros)
    assert str(error.value).startswith(str(macros))


def test_a_shape_that_hangs_beside_the_arm_is_refused() -> None:
    """Such as a second arm: the planner would not know where it is."""
    added = b"""<link name="knuckle"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
      <joint name="bend" type="revolute"><parent link="link_3"/><child link="knuckle"/>
      <axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="1"/></joint></robot>"""
    robot = parse_robot(GEN3.read_bytes().replace(b"</robot>", added))
    with pytest.raises(ConfigError, match="link 'knuckle' has a collision shape, but is neither a part of the arm"):
        Figure(arm_model(robot, palm="end_effector_link"))


def test_endless_rows_of_links_are_refused() -> None:
    count = 30_000
    links = "".join(f'<link name="l{number}"/>' for number in range(count + 1))
    joint = '<joint name="j{0}" type="fixed"><parent link="l{0}"/><child link="l{1}"/></joint>'
    joints = "".join(joint.format(number, number + 1) for number in range(count))
    with pytest.raises(ConfigError, match="at most 300"):
        parse_robot(f'<robot name="r">{links}{joints}</robot>'.encode())
