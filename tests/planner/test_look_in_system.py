"""In a whole system: what a wall hides is looked at before it is picked, and what a cup covers is uncovered."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.scenario.run.runner import play
from agents.scenario.run.staging import make_run, staged_system
from dsr import Memory
from dsr.timeline import Entry, query
from planner.assurance import LOOKED

BEHIND_A_WALL = """
name = "behind_a_wall"
title = "A wall comes between a cube and the overhead camera"
duration = 70.0
linger = 2.0

[mission]
goal = "on(cube_5, cube_4) & on(cube_3, cube_5)"

[[object]]
name = "cube_3"
marker_id = 3
position = [0.40, 0.27, 0.02]

[[object]]
name = "cube_4"
marker_id = 4
position = [0.30, -0.12, 0.02]

[[object]]
name = "cube_5"
marker_id = 5
position = [0.42, -0.12, 0.02]

[[object]]
name = "wall"
type = "box"
size = [0.2, 0.05, 0.2]
marker_id = 9
mass = 0.3
known = true
position = [0.62, 0.18, 0.1]

[[event]]
at = 2.0
do = "slide"
object = "wall"
by = [-0.22, 0.0]

[[expect]]
check = "mission"

[[expect]]
check = "true_relations"
present = [["cube_3", "cube_5"], ["cube_5", "cube_4"]]
"""


UNDER_A_CUP = """
name = "under_a_cup"
title = "A cup is put over a cube that the arm is to stack"
duration = 60.0
linger = 2.0

[mission]
goal = "on(cube_5, cube_4) & on(cube_3, cube_5)"

[[object]]
name = "cube_3"
marker_id = 3
position = [0.42, 0.12, 0.02]

[[object]]
name = "cube_4"
marker_id = 4
position = [0.30, -0.12, 0.02]

[[object]]
name = "cube_5"
marker_id = 5
position = [0.42, -0.12, 0.02]

[[object]]
name = "cup"
type = "container"
marker_id = 9
mass = 0.05
known = true
position = [0.28, 0.16, 0.035]
shape = [
    ["box", [0.074, 0.074, 0.004], [0.0, 0.0, 0.033]],
    ["box", [0.004, 0.074, 0.066], [0.035, 0.0, -0.002]], ["box", [0.004, 0.074, 0.066], [-0.035, 0.0, -0.002]],
    ["box", [0.066, 0.004, 0.066], [0.0, 0.035, -0.002]], ["box", [0.066, 0.004, 0.066], [0.0, -0.035, -0.002]],
]

[[event]]
at = 2.0
do = "carry"
object = "cup"
to = [0.42, 0.12, 0.036]

[[expect]]
check = "mission"

[[expect]]
check = "true_relations"
present = [["cube_3", "cube_5"], ["cube_5", "cube_4"]]
"""


def play_text(text: str, folder: Path, **planner: float) -> list[Entry]:
    """Play a scenario with a camera at the wrist, which must pass; returns the looks that the timeline tells."""
    file = folder / "scene.toml"
    file.write_text(text)
    run = make_run(file, sensor="poses")
    system = staged_system(run).with_config("plant", more_cameras=("wrist",)).with_config("planner", **planner)
    told: list[Entry] = []

    def look(_time: float, memory: Memory, _history: object) -> None:
        told[:] = query(memory, kind=LOOKED)

    judge = play(run, system, onlooker=look)
    assert judge.result(0, "lockstep", "poses", None, None).passed
    return told


@pytest.mark.timeout(600)  # a whole system on a busy machine
def test_what_is_hidden_is_looked_at_before_it_is_picked(tmp_path: Path) -> None:
    """It must be surer here than it is by default: the cube has only been out of sight for some seconds."""
    [why] = play_text(BEHIND_A_WALL, tmp_path, sure=0.99)
    assert why.participants == ("cube_3",) and "before pick cube_3: cube_3 is where it is believed to be" in why.text
    assert why.text.startswith("look from above x 0.40 m, y 0.27 m") and why.text.endswith("nats are expected")


@pytest.mark.timeout(600)
def test_what_is_under_a_cup_is_uncovered_before_it_is_picked(tmp_path: Path) -> None:
    [why] = play_text(UNDER_A_CUP, tmp_path)
    assert why.text == "lift cup before pick cube_3: cube_3 cannot be reached under it"
