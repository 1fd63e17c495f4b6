"""The planner with two arms: whichever reaches does it, and one that dies or is halted leaves the work to the other."""

from __future__ import annotations

import pytest

from dsr import Pose
from dsr.believing.distribution import ATTRIBUTE, Alternative
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.arms import MOST_ARMS, arms_beyond
from dsr.vocabulary.halting import HaltOrder, write_order
from planner.arms import Arms, PlannedArm, chosen
from planner.config import PlannerConfig
from planner.outlook import DOWN
from tests.planner.table import FakeArm, Run, add_camera, believe, move, supports

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


def test_however_many_arms_somebody_makes_up_few_are_looked_at_and_those_of_others_stay() -> None:
    """Of 5000, each look of the planner cost 0.1 s."""
    with TwoArms() as run:
        liar = run.lockstep._join("liar", "liar-1", None)
        for number in range(2 * MOST_ARMS):
            liar.add_node(f"a_{number}", "arm", controller="arm_controller")
        liar.flush()
        run.go(0.2)
        names = [arm.name for arm in Arms(run.memory, CONFIG).all()]
        assert len(names) == MOST_ARMS and names[0] == "arm" and "arm_2" in names
        assert len(arms_beyond(run.memory)) == MOST_ARMS + 2 and not set(names).intersection(arms_beyond(run.memory))
        told = run.lockstep.runner("planner").agent.degraded
        assert told == f"{MOST_ARMS + 2} arms are passed over: {MOST_ARMS} others are looked at"


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


def with_cameras(run: TwoArms, *arms: str) -> None:
    for arm in arms:
        gripper = "gripper" if arm == "arm" else f"{arm}_gripper"
        add_camera(run.memory, f"camera_{arm}", gripper, Pose((0.0, 0.05, 0.0)))


def doubt(run: TwoArms, cube: str, weight: float = 0.6) -> None:
    """The cube may be gone."""
    pose = run.memory.transform("world", cube, types=("Virtual_RT",))
    believe(run.memory, cube, Alternative(weight=weight, pose=pose), Alternative(weight=1.0 - weight, pose=None))


@pytest.mark.parametrize(("cameras", "looks"), [(("arm_2",), (0, 1)), (("arm",), (1, 0)), (("arm", "arm_2"), (1, 1))])
def test_each_arm_looks_only_where_it_gets(cameras: tuple[str, ...], looks: tuple[int, int]) -> None:
    with TwoArms() as run:
        with_cameras(run, *cameras)
        for arm, cube in ((run.arm, "cube_3"), (run.second, "cube_5")):
            doubt(run, cube)
            arm.on_look = lambda cube=cube: run.memory.update_node(cube, **{ATTRIBUTE: ""})
        run.want(GOAL)
        run.until("reached", 90.0)
        assert (len(run.arm.looks), len(run.second.looks)) == looks


def test_the_arm_that_has_looked_goes_away_before_the_other_one_takes_the_thing() -> None:
    with TwoArms() as run:
        with_cameras(run, "arm_2")
        move(run.memory, "cube_3", "table", (0.40, 0.14))
        doubt(run, "cube_3")
        run.second.on_look = lambda: run.memory.update_node("cube_3", **{ATTRIBUTE: ""})
        run.want("on(cube_3, cube_4)")
        run.until_running("pick", "cube_3")
        assert run.second.done == ["look camera_arm_2 done"] and run.arm.done == []
        [leaving] = [node for node in run.memory.nodes("action") if node.get("arm") == "arm_2"]
        assert (leaving["skill"], leaving["request"]) == ("observe", "run")
        run.until("reached")
        assert run.second.done == ["look camera_arm_2 done", "observe done"]


def test_an_arm_looks_though_the_other_one_holds_something_or_is_halted() -> None:
    with TwoArms() as run:
        with_cameras(run, "arm", "arm_2")
        run.memory.add_edge("gripper", "cube_4", "grasping", source="gripper")
        run.memory.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
        run.second.hidden["cube_9"] = (0.8, -0.2)
        run.want("on(cube_9, cube_6)")
        run.until(lambda: run.second.looks)
        assert run.arm.looks == []
    with TwoArms() as run:
        with_cameras(run, "arm", "arm_2")
        write_order(run.memory, HaltOrder("1", True, "anna", "", 1.0, "arm"))
        run.memory.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
        run.second.on_look = lambda: run.second.show("cube_9", (0.6, 0.2))
        run.want("on(cube_9, cube_6)")
        run.until("reached", 90.0)
        assert run.arm.done == [] and len(run.second.looks) == 1


def test_the_arm_that_reaches_a_cover_lifts_it() -> None:
    with TwoArms() as run:
        with_cameras(run, "arm")
        run.memory.add_node("cup", "cup", size=(0.07, 0.07, 0.08))
        run.memory.add_edge("world", "cup", "Virtual_RT", pose=Pose((0.65, -0.14, 0.04)))
        run.memory.add_edge("cup", "table", "on", source="contact")
        pose = run.memory.transform("world", "cube_5", types=("Virtual_RT",))
        gone = Alternative(weight=0.4, pose=None)
        believe(run.memory, "cube_5", Alternative(weight=0.6, pose=pose, containers=("cup",)), gone)
        add_camera(run.memory, "camera_overhead", "world", Pose((0.6, 0.0, 0.8), DOWN))
        run.want("on(cube_5, cube_6)")
        run.until(lambda: "place cup table done" in run.second.done)
        assert run.arm.done == []
