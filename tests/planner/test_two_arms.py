"""The planner with two arms: whichever reaches does it, and one that dies or is halted leaves the work to the other."""

from __future__ import annotations

import pytest

from dsr import Pose
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.halting import HaltOrder, write_order
from planner.arms import Arms, PlannedArm, chosen
from planner.config import PlannerConfig
from tests.planner.table import FakeArm, Run, move, supports

PLACES = {"cube_3": (0.30, 0.14), "cube_4": (0.46, 0.12), "cube_5": (0.65, -0.14), "cube_6": (0.49, -0.12)}
GOAL = "on(cube_3, cube_4) & on(cube_5, cube_6)"
BUILT = {"cube_3": "cube_4", "cube_5": "cube_6", "cube_4": "table", "cube_6": "table"}
CONFIG = PlannerConfig()


class SecondArm(FakeArm):
    name = "arm_2_controller"
    arm = "arm_2"


class TwoArms(Run):
    def __init__(self, **config: object) -> None:
        super().__init__(PLACES, [AgentSpec("arm_2_controller", SecondArm)], **config)
        for name, agent, x in (("arm", "arm_controller", 0.0), ("arm_2", "arm_2_controller", 0.95)):
            gripper = "gripper" if name == "arm" else "arm_2_gripper"
            self.memory.add_node(name, "arm", controller=agent, gripper=gripper)
            self.memory.add_edge("world", name, "RT", pose=Pose((x, 0.0, 0.0)))
            self.memory.add_node(gripper, "gripper")
        self.go(0.1)

    @property
    def second(self) -> FakeArm:
        agent = self.lockstep.runner("arm_2_controller").agent
        assert isinstance(agent, FakeArm)
        return agent


def test_the_nearest_arm_that_reaches_is_chosen() -> None:
    arms = [PlannedArm("arm", "a", "gripper"), PlannedArm("arm_2", "b", "arm_2_gripper", (0.95, 0.0))]
    names = {place: chosen(arms, [place], CONFIG) for place in ((0.3, 0.0), (0.45, 0.0), (0.5, 0.0), (0.475, 0.0))}
    assert [arm.name if arm else None for arm in names.values()] == ["arm", "arm", "arm_2", "arm"]
    assert chosen(arms, [(0.3, 0.0), (0.5, 0.0)], CONFIG) == arms[0], "the other one does not reach the first place"
    assert chosen(arms, [(0.3, 0.0), (0.65, 0.0)], CONFIG) is None
    assert chosen(arms, [(1.8, 0.0)], CONFIG) is None


def test_each_arm_does_what_it_reaches_and_rests_then() -> None:
    with TwoArms() as run:
        run.want(GOAL)
        run.until("reached")
        assert supports(run.memory) == BUILT
        assert run.arm.done == ["pick cube_3 done", "place cube_3 cube_4 done", "observe done"]
        assert run.second.done == ["pick cube_5 done", "place cube_5 cube_6 done", "observe done"]
        run.go(6.0)
        assert not run.memory.nodes("action")


def test_what_no_arm_reaches_is_told() -> None:
    with TwoArms() as run:
        move(run.memory, "cube_4", "table", (0.66, 0.12))
        run.want("on(cube_3, cube_4)")
        run.until("failed")
        assert run.explanation == "no arm that works reaches cube_3 and cube_4"


def test_a_dead_arm_leaves_its_work_to_the_other_where_that_reaches() -> None:
    with TwoArms() as run:
        move(run.memory, "cube_5", "table", (0.55, -0.14))
        run.want(GOAL)
        run.until_running("pick", "cube_5", 0.2)
        run.lockstep.kill("arm_2_controller")
        run.until("reached", 90.0)
        assert supports(run.memory) == BUILT
        assert "pick cube_5 done" in run.arm.done


def test_what_only_a_dead_arm_reaches_is_told() -> None:
    with TwoArms() as run:
        run.want(GOAL)
        run.until_running("pick", "cube_5", 0.2)
        run.lockstep.kill("arm_2_controller")
        run.until("failed", 90.0)
        assert "no arm that works reaches cube_5" in run.explanation
        assert "arm_2: agent 'arm_2_controller' does not run" in run.explanation


def test_what_a_dead_gripper_holds_is_not_believed_placed_nor_at_hand() -> None:
    with TwoArms() as run:
        run.want(GOAL)
        run.until_running("place", "cube_5", 0.1)
        run.lockstep.kill("arm_2_controller")
        run.until(lambda: run.status in ("failed", "unsolvable"), 90.0)
        relations = Arms(run.memory, CONFIG).relations()
        assert "cube_5" in relations.taken and not relations.held
        assert ("cube_5", "cube_6") not in relations.on
        assert run.status == "unsolvable" and "cube_5" in run.explanation


def test_a_controller_that_is_started_again_goes_on() -> None:
    with TwoArms() as run:
        run.want(GOAL)
        run.until_running("pick", "cube_5", 0.2)
        run.lockstep.kill("arm_2_controller")
        run.go(1.0)
        run.lockstep.restart("arm_2_controller")
        run.until("reached", 90.0)
        assert supports(run.memory) == BUILT and "pick cube_5 done" in run.second.done


@pytest.mark.parametrize("arms", [("arm",), ("arm", "arm_2")])
def test_a_halted_arm_is_left_out_and_all_of_them_end_the_mission(arms: tuple[str, ...]) -> None:
    with TwoArms() as run:
        for place in ("cube_3", "cube_5"):
            move(run.memory, place, "table", (0.5, 0.2 if place == "cube_3" else -0.24))
        for number, arm in enumerate(arms):
            write_order(run.memory, HaltOrder(str(number), True, "anna", "", float(number), arm))
        run.want(GOAL)
        run.until("reached" if len(arms) == 1 else "failed", 90.0)
        assert run.arm.done == []
        if len(arms) == 1:
            assert supports(run.memory) == BUILT
        else:
            assert run.explanation == "halted by anna" and run.second.done == []
