"""The command `dsr robots`: it tells what a description holds, and refuses what the arm controller would refuse."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from agents.arm_controller.cli import app
from agents.arm_controller.model.model_report import report_on
from dsr.errors import ConfigError

from .conftest import GEN3

NAMES = ["gen3", "open_manipulator_p", "panda", "ur5e"]


def test_the_arms_that_come_along_are_listed_and_nothing_about_them_is_doubtful() -> None:
    listed = CliRunner().invoke(app, ["list"])
    assert listed.exit_code == 0 and listed.stdout.split() == NAMES
    assert [row["name"] for row in json.loads(CliRunner().invoke(app, ["list", "--json"]).stdout)] == NAMES
    for name in NAMES:
        assert report_on(GEN3.with_name(f"{name}.urdf")).doubts == []


def test_joints_limits_roles_and_shapes_are_told() -> None:
    found = json.loads(CliRunner().invoke(app, ["check", "open_manipulator_p", "--json"]).stdout)
    assert (found["base"], found["palm"], found["tool"]) == ("base_link", "end_effector_link", "tool_link")
    assert found["boxes"]["link3"] == 2 and found["boxes"]["tool_link"] == 0
    joints = {joint["name"]: joint for joint in found["joints"]}
    assert len(joints) == 10
    assert joints["joint5"] == {
        "name": "joint5", "kind": "revolute", "moves": "link6", "role": "arm", "mimics": "",
        "lower": pytest.approx(-1.5708, abs=1e-4), "upper": pytest.approx(1.5708, abs=1e-4),
        "velocity": 3.0, "effort": 5.1,
    }  # fmt: skip
    assert joints["finger_left_joint"]["mimics"] == "knuckle_right_joint"
    printed = CliRunner().invoke(app, ["check", "gen3"], env={"COLUMNS": "200"}).stdout
    assert "joint_1" in printed and "opening up to 85.0 mm" in printed and "finger_left_link 2" in printed


def test_what_is_doubtful_is_told(tmp_path: Path) -> None:
    text = GEN3.read_text().replace(' velocity="1.2218"', "").replace(' effort="9"', "")
    (tmp_path / "mine.urdf").write_text(text.replace('<link name="tool_link">', '<link name="tool_link"><visual/>'))
    doubts = " ".join(report_on(tmp_path / "mine.urdf").doubts)
    assert "no limit of velocity: joint_5, joint_6, joint_7" in doubts and "no limit of effort: joint_5" in doubts
    assert "no home posture" in doubts and "meets nothing with: tool_link" in doubts
    (tmp_path / "mine.srdf").write_text(GEN3.with_suffix(".srdf").read_text().replace("-2.09", "-2.5"))
    assert "at home these joints are beyond their limits: joint_6" in report_on(tmp_path / "mine.urdf").doubts


def test_a_home_posture_in_which_the_arm_would_not_move_is_told(tmp_path: Path) -> None:
    (tmp_path / "mine.urdf").write_text(GEN3.read_text())
    home = GEN3.with_suffix(".srdf").read_text()
    for joint, angle in ((2, 2.2), (3, 0), (4, 2.57), (6, 2.09)):
        before, name, after = home.partition(f'name="joint_{joint}" value="')
        home = before + name + f"{angle}" + after[after.index('"') :]
    (tmp_path / "mine.srdf").write_text(home)
    assert report_on(tmp_path / "mine.urdf").doubts == [
        "at home the boxes around its shapes meet each other: the arm would not move"
    ]


def test_a_missing_mesh_is_an_error(tmp_path: Path) -> None:
    text = GEN3.read_text().replace('<box size="0.06 0.035 0.03"/>', '<mesh filename="package://arm/camera.stl"/>')
    (tmp_path / "mine.urdf").write_text(text)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "mine.urdf")])
    assert isinstance(result.exception, ConfigError)
    assert "link 'link_7': mesh 'package://arm/camera.stl': there is no package 'arm'" in str(result.exception)
