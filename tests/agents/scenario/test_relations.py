"""What truly rests on what, and is in what, where containers have thin floors and stand in each other."""

from __future__ import annotations

import math
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from agents.scenario.format.model import Scenario
from agents.scenario.format.scenario import load_scenario
from agents.scenario.truth import relations
from agents.scenario.truth.relations import true_contents, true_relations
from dsr.math3d.transforms import Pose

BIN = Path(__file__).parents[3] / "etc" / "scenarios" / "bin.urdf"
FILE = """
name = "thin"
title = "A cube in a bin with a floor of 3 mm, a cup, and a crate around them"
duration = 5.0

[[object]]
name = "cube"
position = [0.3, 0.2, 0.02]

[[object]]
name = "bin"
model = "bin.urdf"
known = true
position = [0.3, 0.0, 0.07]

[[object]]
name = "cup"
model = "cup"
known = true
position = [0.6, 0.0, 0.05]

[[expect]]
check = "relations_right"
"""


def scenario_in(folder: Path) -> Scenario:
    (folder / "bin.urdf").write_bytes(BIN.read_bytes())
    (folder / "thin.toml").write_text(FILE)
    return load_scenario(folder / "thin.toml")


def test_what_lies_in_a_bin_with_a_thin_floor_is_not_on_the_table(tmp_path: Path) -> None:
    scenario = scenario_in(tmp_path)
    height = scenario.object("bin").size[2]
    truth = {"bin": Pose((0.3, 0.0, height / 2)), "cube": Pose((0.3, 0.0, 0.003 + 0.02 - 1e-5))}
    assert true_relations(scenario, truth) == {("cube", "bin"), ("bin", "table")}


def test_a_tower_is_still_told_floor_by_floor(tmp_path: Path) -> None:
    scenario = scenario_in(tmp_path)
    size = scenario.object("bin").size
    truth = {"cube": Pose((0.3, 0.0, 0.02)), "bin": Pose((0.3, 0.0, 0.04 + size[2] / 2))}
    assert true_relations(scenario, truth) == {("bin", "cube"), ("cube", "table")}


def test_the_larger_of_two_that_stand_in_each_other_is_around_the_smaller(tmp_path: Path) -> None:
    scenario = scenario_in(tmp_path)
    bin, cup = scenario.object("bin").size, scenario.object("cup").size
    truth = {"bin": Pose((0.3, 0.0, bin[2] / 2)), "cup": Pose((0.3, 0.0, cup[2] / 2))}
    assert math.prod(cup) < math.prod(bin)
    assert true_contents(scenario, truth) == {("cup", "bin")}


def heaps(seed: int) -> dict[str, Pose]:
    """A hundred cubes at random places, many of them in towers."""
    rng = np.random.default_rng(seed)
    poses: dict[str, Pose] = {}
    for number in range(100):
        x, y, floor = *rng.uniform(0.0, 0.5, 2).tolist(), int(rng.integers(0, 3))
        if number and rng.random() < 0.5:
            x, y, _ = poses[f"thing_{rng.integers(number)}"].t
            floor = 1 + number % 2
        yaw = rng.uniform(0.0, math.pi)
        z = 0.02 + 0.04 * floor + rng.uniform(-0.004, 0.004)
        poses[f"thing_{number}"] = Pose((x, y, z), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
    return poses


def many_things(folder: Path) -> Scenario:
    lines = ['name = "many"', 'title = "A hundred things"', "duration = 5.0"]
    for number in range(100):
        x, y = 0.05 * (number % 10), 0.05 * (number // 10) - 0.25
        lines += ["[[object]]", f'name = "thing_{number}"', f"marker_id = {number}", f"position = [{x}, {y}, 0.02]"]
    (folder / "many.toml").write_text("\n".join([*lines, "[[expect]]", 'check = "relations_right"']))
    return load_scenario(folder / "many.toml")


def test_of_many_things_only_those_that_are_near_are_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario, compared, rests = many_things(tmp_path), [], relations._rests
    monkeypatch.setattr(relations, "_rests", lambda *pair: (compared.append(pair), rests(*pair))[1])
    grid = {f"thing_{k}": Pose((0.06 * (k % 10), 0.06 * (k // 10), 0.02)) for k in range(100)}
    assert true_relations(scenario, grid) == {(name, "table") for name in grid}
    assert len(compared) == len(grid)


@pytest.mark.parametrize("seed", [0, 1])
def test_what_is_left_out_rests_on_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    scenario, poses = many_things(tmp_path), heaps(seed)
    held = {"thing_5", "thing_7"}
    found = true_relations(scenario, poses, held)
    monkeypatch.setattr(
        relations, "_near", lambda pieces: [pair for pair in permutations(pieces, 2) if pair[0][0] != pair[1][0]]
    )
    assert found == true_relations(scenario, poses, held) and len(found) > 50
