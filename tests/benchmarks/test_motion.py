"""Planners of motion in random scenes: scenes are problems, blocked ones are solved, and the table says how it went."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.motion.obstacles import Load
from benchmarks.motion import ROBOTS, Outcome, Problems, ours, planners, table


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_scene_has_free_ends_that_are_apart_and_is_the_same_for_the_same_seed(robot: str) -> None:
    problems = Problems(robot)
    scene = problems.scene(7)
    assert scene.free(np.array([scene.start, scene.goal])).all()
    assert np.abs(scene.goal - scene.start).max() > 1.0
    again = problems.scene(7)
    assert np.array_equal(again.start, scene.start) and again.things == scene.things


@pytest.mark.parametrize("seed", [4, 11, 13])
def test_ways_are_found_where_the_straight_one_is_blocked(seed: int) -> None:
    problems = Problems("gen3")
    scene = problems.scene(seed)
    straight = np.linspace(scene.start, scene.goal, 100)
    assert scene.obstacles.blocking(straight, Load(0.04), 1) is not None
    outcome = ours(problems, scene)
    assert outcome.found and outcome.length > np.linalg.norm(scene.goal - scene.start)


def test_every_planner_that_is_there_solves_an_easy_scene() -> None:
    problems = Problems("gen3")
    lengths = [solve(problems, problems.scene(0)).length for solve in planners()]
    assert lengths == pytest.approx([lengths[0]] * len(lengths), rel=0.01)


def test_the_table_compares_what_both_have_found() -> None:
    outcomes = [
        Outcome(0, "ours", True, 5.0, 6.0, 0.1), Outcome(0, "peer", True, 7.0, 8.0, 0.3),
        Outcome(1, "ours", True, 9.0, 9.0, 0.1), Outcome(1, "peer", False, seconds=0.3),
    ]  # fmt: skip
    cells = [list(column.cells) for column in table(outcomes).columns]
    assert cells == [["ours", "peer"], ["2/2", "1/2"], ["5.00", "7.00"], ["6.00", "8.00"], ["1.00", "3.00"]]
