"""What is around an arm, each thing once, and what it carries: what nobody sees any more is carried all the same."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.surroundings import ArmSurroundings
from dsr import Pose
from dsr.math3d.shapes import to_numbers
from tests.agents.arm_controller.conftest import CUBE, Table, pick
from tests.agents.arm_controller.test_hostile import CUP


def around(table: Table) -> ArmSurroundings:
    surroundings: ArmSurroundings = table.agent._actions._arm.around  # type: ignore[attr-defined]
    return surroundings


def test_what_is_held_is_a_load_also_when_it_is_believed_nowhere_any_more(table: Table) -> None:
    pick(table)
    (seen,) = around(table).load(0.04).held
    assert seen.half == pytest.approx(np.array(CUBE) / 2)
    table.memory.remove_edge("world", "cube_3", "Virtual_RT")
    table.run(0.1)
    (unseen,) = around(table).load(0.04).held
    assert unseen.half == seen.half and unseen.pose.distance(seen.pose)[0] < 1e-6


def test_what_stands_in_what_is_held_is_a_load_too_and_in_nobodys_way(table: Table) -> None:
    pick(table)
    table.memory.update_node("cube_3", shape=to_numbers(CUP))
    held = table.memory.edge("world", "cube_3", "Virtual_RT")["pose"]
    table.believe("spoon", held @ Pose((0.0, 0.0, 0.01)), (0.01, 0.01, 0.12))
    table.run(0.1)
    boxes = around(table).load(0.04).held
    assert sorted(2 * max(box.half) for box in boxes) == pytest.approx([0.04, 0.12])
    names = [thing.name for thing in around(table).things(table.clock.now())]
    assert "spoon" not in names and "cube_3" not in names and "cube_4" in names


def test_a_thing_with_a_mesh_that_is_believed_to_have_moved_is_there_once(table: Table) -> None:
    """Listed twice, with two boxes, it seemed to move at each look: the arm stopped beside it."""
    table.memory.add_node("vase", "object", size=(0.06, 0.06, 0.1), bounds=(-0.03, -0.03, 0.0, 0.03, 0.03, 0.1))
    table.memory.add_edge("world", "vase", "Virtual_RT", pose=Pose((0.5, -0.2, 0.05)))
    table.run(0.1)
    (vase,) = [thing for thing in around(table).things_and_zones() if thing.name == "vase"]
    assert vase.pose.t == pytest.approx((0.5, -0.2, 0.1)), "the middle of its bounds"
