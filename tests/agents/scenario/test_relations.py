"""What truly rests on what, and is in what, where containers have thin floors and stand in each other."""

from __future__ import annotations

import math
from pathlib import Path

from agents.scenario.format.model import Scenario
from agents.scenario.format.scenario import load_scenario
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
