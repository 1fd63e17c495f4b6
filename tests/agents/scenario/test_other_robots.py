"""Scenarios with another arm, elsewhere, or one that takes the place of the scenario's."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.run.staging import make_run, staged_system
from dsr.errors import ConfigError
from dsr.files.built_in import ETC

SCENARIO = """name = "elsewhere"
title = "An arm that stands elsewhere"
duration = 8.0
[robot]
model = "{model}"
position = [0.1, 0.2, 0.0]
yaw = 1.5707963267948966
"""
PANDA = str(ETC / "robots" / "panda.urdf")


def settings(system: object) -> tuple[dict[str, object], dict[str, object]]:
    arm, plant = (system.agent(name).config for name in ("arm_controller", "plant"))  # type: ignore[attr-defined]
    return arm, plant


@pytest.mark.parametrize("robot", ["panda", PANDA])
def test_another_arm_is_told_to_plant_and_controller(robot: str) -> None:
    arm, plant = settings(staged_system(make_run("towers", robot=robot)))
    assert arm["urdf"] == plant["robot"] == PANDA
    assert arm["observe_joints"] == () and set(arm["cameras"]) == {"camera_overhead", "camera_wrist"}  # type: ignore[call-overload]


def test_the_usual_arm_is_left_as_the_system_has_it() -> None:
    arm, plant = settings(staged_system(make_run("towers")))
    assert "urdf" not in arm and plant["robot"] == "" and len(arm["observe_joints"]) == 7  # type: ignore[arg-type]


def test_the_controller_knows_where_the_arm_stands(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.toml").write_text(SCENARIO.format(model="ur5e"))
    arm, _ = settings(staged_system(make_run(tmp_path / "elsewhere.toml")))
    assert arm["urdf"] == str(ETC / "robots" / "ur5e.urdf")
    assert arm["mount"] == {
        "translation": (0.1, 0.2, 0.0),
        "rotation": pytest.approx((0.0, 0.0, 0.70710678, 0.70710678)),
    }


def test_an_arm_beside_the_scenario_may_lack_a_camera(tmp_path: Path) -> None:
    text = (ETC / "robots" / "ur5e.urdf").read_text().replace("camera_wrist_link", "camera_link")
    (tmp_path / "mine.urdf").write_text(text)
    (tmp_path / "elsewhere.toml").write_text(SCENARIO.format(model="mine.urdf"))
    arm, _ = settings(staged_system(make_run(tmp_path / "elsewhere.toml")))
    assert arm["urdf"] == str(tmp_path / "mine.urdf") and set(arm["cameras"]) == {"camera_overhead"}  # type: ignore[call-overload]


@pytest.mark.parametrize(("robot", "reason"), [("pandra", "did you mean 'panda'"), ("gone.urdf", "cannot be read")])
def test_an_arm_that_there_is_not_is_told_before_the_run(robot: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        staged_system(make_run("towers", robot=robot))
