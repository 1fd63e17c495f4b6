"""The grasping edge: there while the gripper holds something that the belief has between its pads."""

from __future__ import annotations

import pytest

from agents.arm_controller.grasping.holding import LOST_AFTER
from agents.arm_controller.model.kinematics import JointChain
from dsr import Pose

from .conftest import HOME, PERIOD, Bench

CUBE = (0.04, 0.04, 0.04)


@pytest.fixture
def world_from_tool(tool: JointChain) -> Pose:
    return tool.forward(HOME)


def believe(bench: Bench, name: str, pose: Pose) -> None:
    bench.memory.add_node("world", "world")
    bench.memory.add_node(name, "cube", size=CUBE)
    bench.memory.add_edge("world", name, "Virtual_RT", pose=pose)


def close(bench: Bench, width: float = 0.04) -> None:
    bench.arm.obstacle = width
    bench.arm.move_gripper(0.0)


def grasped(bench: Bench) -> list[str]:
    return [edge.dst for edge in bench.memory.edges("grasping", src="gripper")]


def test_what_is_believed_between_the_pads_is_grasped_until_contact_ends(bench: Bench, world_from_tool: Pose) -> None:
    believe(bench, "cube_3", world_from_tool @ Pose((0.004, 0.003, 0.005)))
    believe(bench, "cube_4", world_from_tool @ Pose((0.0, 0.05, 0.0)))
    bench.run(0.1)
    assert grasped(bench) == []
    close(bench)
    began = bench.clock.now()
    bench.run(0.5)
    assert grasped(bench) == ["cube_3"]
    edge = bench.memory.edge("gripper", "cube_3", "grasping")
    assert edge["source"] == "gripper" and edge["since"] == pytest.approx(began, abs=2 * PERIOD)
    bench.arm.opening = 0.06
    bench.run(LOST_AFTER / 2)
    assert grasped(bench) == ["cube_3"]
    bench.run(LOST_AFTER)
    assert grasped(bench) == []


@pytest.mark.parametrize(("offset", "width"), [((0.0, 0.06, 0.0), 0.04), ((0.03, 0.0, 0.0), 0.04), ((0, 0, 0), 0.06)])
def test_what_does_not_fit_is_not_grasped(
    bench: Bench, world_from_tool: Pose, offset: tuple[float, float, float], width: float
) -> None:
    believe(bench, "cube_3", world_from_tool @ Pose(offset))
    close(bench, width)
    bench.run(0.5)
    assert grasped(bench) == []


def test_what_is_believed_gone_is_not_grasped(bench: Bench, world_from_tool: Pose) -> None:
    believe(bench, "cube_3", world_from_tool)
    bench.memory.update_node("cube_3", present=False)
    close(bench)
    bench.run(0.3)
    assert grasped(bench) == []


def test_the_object_is_known_as_soon_as_the_belief_has_it(bench: Bench, world_from_tool: Pose) -> None:
    close(bench)
    bench.run(0.3)
    believe(bench, "cube_3", world_from_tool)
    bench.run(0.3)
    assert grasped(bench) == ["cube_3"]


def test_after_a_restart_the_edge_tells_what_is_held(bench: Bench, world_from_tool: Pose) -> None:
    believe(bench, "cube_3", world_from_tool)
    close(bench)
    bench.run(0.3)
    since = bench.memory.edge("gripper", "cube_3", "grasping")["since"]
    believe(bench, "cube_4", world_from_tool)
    bench.own.close()
    bench.start()
    bench.run(0.3)
    assert grasped(bench) == ["cube_3"]
    assert bench.memory.edge("gripper", "cube_3", "grasping")["since"] == since


def restart_with_an_old_belief(bench: Bench, world_from_tool: Pose) -> None:
    """While the arm controller was away, the arm went on, and the belief stayed where the gripper had been."""
    believe(bench, "cube_3", world_from_tool)
    close(bench)
    bench.run(0.3)
    bench.own.close()
    believe(bench, "cube_3", world_from_tool @ Pose((0.1, 0.0, 0.06)))
    bench.start()
    bench.run(0.3)


def held_at(bench: Bench) -> Pose | None:
    pose: Pose | None = bench.agent._holding.tool_from_object  # type: ignore[attr-defined]
    return pose


def test_after_a_restart_the_belief_may_catch_up_with_the_gripper(bench: Bench, world_from_tool: Pose) -> None:
    restart_with_an_old_belief(bench, world_from_tool)
    believe(bench, "cube_3", world_from_tool)
    bench.run(0.3)
    held = held_at(bench)
    assert held is not None and held.t == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert grasped(bench) == ["cube_3"]


def test_a_belief_that_does_not_catch_up_is_taken_as_it_is(bench: Bench, world_from_tool: Pose) -> None:
    restart_with_an_old_belief(bench, world_from_tool)
    assert held_at(bench) is None
    bench.run(1.2)
    assert held_at(bench) is not None
    assert grasped(bench) == ["cube_3"]


def test_after_a_restart_an_edge_without_contact_goes(bench: Bench, world_from_tool: Pose) -> None:
    believe(bench, "cube_3", world_from_tool)
    bench.memory.add_node("gripper", "gripper")
    bench.memory.add_edge("gripper", "cube_3", "grasping")
    bench.run(0.3)
    assert grasped(bench) == []


def test_an_edge_that_somebody_removed_comes_back(bench: Bench, world_from_tool: Pose) -> None:
    believe(bench, "cube_3", world_from_tool)
    close(bench)
    bench.run(0.3)
    bench.memory.remove_edge("gripper", "cube_3", "grasping")
    bench.run(0.3)
    assert grasped(bench) == ["cube_3"]
