"""Scenarios without tags: what loses its tag, who is told, how found blocks are judged, who gives the mission."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from agents.scenario.format.scenario import find_scenario, load_scenario, parse_scenario
from agents.scenario.format.untagged import untagged
from agents.scenario.judge.found_forms import alike
from agents.scenario.judge.found_names import FoundNames
from agents.scenario.run.mission_giver import MissionGiver
from agents.scenario.run.staging import make_run, staged_system
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.errors import ConfigError
from dsr.vocabulary.perceived import BY_DEPTH

SCENARIO = parse_scenario("""
name = "mixed"
title = "A cube, a known cube, a box and a ball"
duration = 9.0

[mission]
goal = "on(cube_3, cube_4) & ontable(cube_4)"

[[object]]
name = "cube_3"
marker_id = 3
position = [0.3, 0.1, 0.02]

[[object]]
name = "cube_4"
marker_id = 4
known = true
position = [0.3, -0.1, 0.02]

[[object]]
name = "ball"
model = "ball"
known = true
color = [0.9, 0.1, 0.9]
position = [0.45, 0.0, 0.03]
""")
CUBE, BOX = SCENARIO.objects[0], load_scenario("untagged_blocks").object("red")
CAN = load_scenario("untagged_blocks").object("can")


def test_blocks_lose_their_tags_and_nobody_is_told_of_them() -> None:
    variant = untagged(SCENARIO)
    cube, known, ball = variant.objects
    assert (cube.marker_id, known.marker_id, known.known) == (None, None, False)
    assert cube.by_depth and known.by_depth and cube.color != known.color
    assert ball == SCENARIO.objects[2]
    assert variant.name == "mixed-untagged"
    assert variant.events == SCENARIO.events


def test_a_scenario_without_tags_has_no_such_variant() -> None:
    with pytest.raises(ConfigError, match="no untagged variant"):
        untagged(load_scenario("untagged_blocks"))


def test_the_agents_are_told_and_the_mission_waits_for_names() -> None:
    system = staged_system(make_run("full_tower", untagged=True))
    assert system.agent("plant").config["untagged"] is True
    assert system.agent("scene_setup").config["untagged"] is True
    assert system.agent("scene_estimator").config["blocks"] is True
    assert "mission" not in {agent.name for agent in system.agents}


def test_where_nothing_would_be_found_the_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="`pixels`"):
        staged_system(make_run("cube_removed", untagged=True, sensor="poses"))
    with pytest.raises(ConfigError, match=r"'untagged_blocks': without tags, red, .* expected the sensor `pixels`"):
        staged_system(make_run("untagged_blocks", sensor="poses"))
    staged_system(make_run("untagged_blocks"))
    file = tmp_path / "blind.toml"
    text = find_scenario("cube_removed").read_text()
    file.write_text(text.replace("duration", 'system = "bare.toml"\nduration', 1))
    (tmp_path / "bare.toml").write_text('graph = "bare"\n[[agent]]\nname = "plant"\nclass = "agents.plant:Plant"\n')
    with pytest.raises(ConfigError, match="no agent 'scene_estimator'"):
        staged_system(make_run(file, untagged=True))


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.5 * math.pi), (math.pi, 0.0, 0.0), (0.0, 0.5 * math.pi, 0.0)])
def test_the_axes_of_a_found_box_are_named_as_those_of_the_true_one(turn: tuple[float, float, float]) -> None:
    true = Pose.from_rotvec((0.3, 0.1, 0.02), (0.0, 0.0, 0.3))
    swapped = abs(Pose.from_rotvec((0.0, 0.0, 0.0), turn).rotation_matrix.T).round() @ BOX.size
    found, size = alike(BOX, tuple(swapped.tolist()), true @ Pose.from_rotvec((0.0, 0.0, 0.0), turn), true)
    assert found.distance(true) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert size == pytest.approx(BOX.size)


def test_a_box_that_is_turned_wrongly_is_seen_to_be() -> None:
    true = Pose((0.3, 0.1, 0.02))
    wrong = Pose.from_rotvec(true.t, (0.0, 0.0, 0.5 * math.pi))
    assert alike(BOX, BOX.size, wrong, true)[0].distance(true)[1] == pytest.approx(0.5 * math.pi)
    assert alike(CUBE, CUBE.size, wrong, true)[0].distance(true)[1] == pytest.approx(0.0, abs=1e-6)


def test_how_a_cylinder_is_turned_about_its_axis_does_not_count_but_how_it_leans() -> None:
    true = Pose((0.3, 0.1, 0.04))
    assert alike(CAN, CAN.size, Pose.from_rotvec(true.t, (0.0, 0.0, 1.1)), true)[0].distance(true)[1] < 1e-6
    assert alike(CAN, CAN.size, Pose.from_rotvec(true.t, (math.pi, 0.0, 0.0)), true)[0].distance(true)[1] < 1e-6
    leaning = Pose.from_rotvec(true.t, (0.2, 0.0, 0.0)) @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.7))
    assert alike(CAN, CAN.size, leaning, true)[0].distance(true)[1] == pytest.approx(0.2)


@pytest.fixture
def memory() -> Iterator[Memory]:
    clock = ManualClock()
    with Memory("test", "estimator", transport=LocalNetwork(clock).connect("estimator"), clock=clock) as memory:
        memory.add_node("world", "world")
        yield memory


def test_the_mission_is_given_once_when_all_that_it_is_about_was_found(memory: Memory) -> None:
    scenario = untagged(SCENARIO)
    assert scenario.mission is not None
    names = FoundNames(scenario, memory)
    giver = MissionGiver(scenario.mission, memory, names)
    giver.ask()
    assert memory.nodes("intention") == []
    truth = {spec.name: Pose(spec.position) for spec in scenario.objects}
    for node, name in (("plain_cube_1", "cube_4"), ("plain_cube_2", "cube_3")):
        memory.add_node(node, "cube", source=BY_DEPTH)
        memory.add_edge("world", node, "RT", pose=truth[name])
    names.update(truth)
    giver.ask()
    giver.ask()
    (intention,) = memory.nodes("intention")
    assert intention["goal"] == "on(plain_cube_2,plain_cube_1) & ontable(plain_cube_1)"
