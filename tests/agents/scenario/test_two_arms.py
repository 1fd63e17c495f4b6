"""Scenarios with several arms: the format, the controllers' configuration, and how near the arms came."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from agents.scenario.format.scenario import parse_scenario
from agents.scenario.judge.metrics import measure
from agents.scenario.judge.verdicts import judge_check
from agents.scenario.run.staging import Run, make_run, staged_system
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.relations import true_relations
from dsr.errors import ConfigError
from dsr.files.built_in import ETC
from dsr.math3d.transforms import Pose

SCENARIO = """name = "facing"
title = "Two arms"
system = "two_arms"
duration = 8.0
[[arm]]
name = "arm_2"
model = "panda"
position = [0.9, 0.1, 0.0]
yaw = 3.141592653589793
"""


def of(text: str, tmp_path: Path) -> Run:
    (tmp_path / "facing.toml").write_text(text)
    return make_run(tmp_path / "facing.toml")


def test_each_controller_knows_its_arm(tmp_path: Path) -> None:
    system = staged_system(of(SCENARIO, tmp_path))
    second, first = (system.agent(name).config for name in ("arm_2_controller", "arm_controller"))
    assert second["arm"] == "arm_2" and second["urdf"] == str(ETC / "robots" / "panda.urdf")
    assert second["mount"]["translation"] == (0.0, 0.0, 0.0), "of the robot, whose node both share"
    assert second["arm_mount"]["translation"] == pytest.approx((0.9, 0.1, 0.0))
    assert second["arm_mount"]["rotation"] == pytest.approx((0.0, 0.0, 1.0, 0.0))
    assert "urdf" not in first, "the first arm is the usual one"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (('"arm_2"', '"arm_3"'), "scenario has an arm 'arm_3', and its system has none of that name"),
        (('"two_arms"', '"tabletop"'), "scenario has an arm 'arm_2', and its system has none"),
        (('name = "arm_2"', 'name = "arm"'), "the name 'arm' is taken"),
        (('"panda"', '"pandra"'), "did you mean 'panda'"),
        (('"panda"', '"none"'), "expected an arm; leave it out"),
        (("[[arm]]", '[robot]\nmodel = "none"\n[[arm]]'), "expected a"),
        (('"panda"', '"gen3"\nstart = [0.0]'), "expected 7 joint positions"),
    ],
)
def test_arms_that_do_not_fit_are_refused(tmp_path: Path, change: tuple[str, str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        staged_system(of(SCENARIO.replace(*change), tmp_path))


def test_a_controller_without_an_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="system has an arm 'arm_2', and its scenario has none"):
        staged_system(of(SCENARIO.partition("[[arm]]")[0], tmp_path))


def test_an_agent_that_is_killed_for_good_is_not_started_again(tmp_path: Path) -> None:
    kill = '[[event]]\nat = 1.0\ndo = "kill"\nagent = "arm_2_controller"\n'
    again, never = (staged_system(of(SCENARIO + kill + more, tmp_path)) for more in ("", "restart = false\n"))
    assert again.agent("arm_2_controller").restart and not never.agent("arm_2_controller").restart
    others = [dataclasses.replace(spec, restart=True) for spec in never.agents]
    assert [spec.name for spec in others] == [spec.name for spec in again.agents]


def history(*apart: float | None) -> History:
    expect = '[[expect]]\ncheck = "arms_apart"\nafter = 1.0\n'
    found = History(parse_scenario(SCENARIO + expect))
    for number, distance in enumerate(apart):
        found.add(Sample(time=float(number), truth={}, apart=distance))
    return found


@pytest.mark.parametrize(
    ("apart", "verdict"),
    [
        ((0.01, None, 0.25), (True, "250.00 mm at 2.00 s")),
        ((None, 0.019, 0.03), (False, "19.00 mm at 1.00 s")),
        ((None, 0.1, -0.001), (False, "-1.00 mm at 2.00 s")),
        ((None, None, None), (True, "never near one another")),
    ],
)
def test_arms_must_keep_apart(apart: tuple[float | None, ...], verdict: tuple[bool, str]) -> None:
    found = history(*apart)
    judged = judge_check(found.scenario.expectations[0], found)
    assert (judged.passed, judged.actual) == verdict


def test_the_least_distance_of_a_run_is_measured() -> None:
    found = history(0.2, None, 0.05, None, None, 0.1)
    assert measure(found)[0]["arms_apart_min_m"] == 0.05
    assert "arms_apart_min_m" not in measure(history(None, None, None, None, None, None))[0]


def test_what_any_gripper_holds_rests_on_nothing() -> None:
    sample = Sample(time=0.0, truth={}, held="a", grasped={"a": "gripper", "b": "arm_2_gripper", "c": "human_hand_0"})
    assert sample.gripped == {"a", "b"}
    cubes = '[[object]]\nname = "a"\nposition = [0.3, 0.0, 0.02]\n[[object]]\nname = "b"\nposition = [0.4, 0.0, 0.02]\n'
    scenario = parse_scenario(SCENARIO + cubes)
    truth = {"a": Pose((0.3, 0.0, 0.02)), "b": Pose((0.4, 0.0, 0.02))}
    assert true_relations(scenario, truth, sample.gripped) == set()
