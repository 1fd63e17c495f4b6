"""Two arms in one world: each obeys its own commands, holds its own object, and collides with the other."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from agents.plant.messages import Follow, MoveGripper
from agents.plant.reality import Reality
from agents.plant.world import STEP
from agents.scenario.format.scenario import ArmSpec, ObjectSpec

MakeReality = Callable[..., Reality]
FACING = ArmSpec(name="arm_2", position=(0.95, 0.0, 0.0), yaw=3.14159265)
HANGING = (0.0, 0.0, 3.14159, -0.96, 0.0, -2.09, 1.5708)
STRETCHED = (0.0, 0.9, 3.14159, -1.3, 0.0, -0.8, 1.5708)


def run(reality: Reality, seconds: float) -> None:
    for _ in range(round(seconds / STEP)):
        reality.step(None)


@pytest.fixture
def two(make_reality: MakeReality) -> Reality:
    return make_reality(more_arms=[FACING], config={"deadman": 0.0})


def test_each_arm_obeys_its_own_commands(two: Reality) -> None:
    before = two.arms["arm"].positions
    two.obey(Follow((0.8,), ((0.3, *HANGING[1:]),)), "arm_2")
    run(two, 1.0)
    first, second = two.arm_state(0.0), two.arm_state(0.0, "arm_2")
    assert first is not None and second is not None and two.arm_state(0.0, "arm_3") is None
    assert first.positions == pytest.approx(before, abs=1e-3)
    assert second.positions[0] == pytest.approx(0.3, abs=1e-3)
    two.obey(Follow((0.8,), ((0.3, *HANGING[1:]),)), "nobody")
    assert not two.is_moving() and not two.is_moving("nobody")


def test_a_halt_of_one_leaves_the_other_alone(two: Reality) -> None:
    for arm in ("arm", "arm_2"):
        two.obey(Follow((1.0,), ((1.0, *HANGING[1:]),)), arm)
    run(two, 0.2)
    two.forbid("halted by anna", "arm_2")
    run(two, 1.5)
    first, second = two.arm_state(0.0), two.arm_state(0.0, "arm_2")
    assert first is not None and second is not None
    assert (first.fault, second.fault) == ("", "halted by anna")
    assert first.positions[0] == pytest.approx(1.0, abs=1e-3) and second.positions[0] < 0.9


def test_the_truth_tells_of_both_arms_and_how_near_they_come(two: Reality) -> None:
    run(two, 0.1)
    truth = two.truth(0.1)
    assert truth.robot == two.arms["arm"].positions and set(truth.arms) == {"arm_2"}
    assert truth.arms["arm_2"].positions == two.arms["arm_2"].positions
    assert truth.apart == pytest.approx(0.95 - 2 * 0.334, abs=0.02), "as far as both reach forward"
    assert two.truth(0.1).apart is None, "nothing has happened since"


def test_arms_that_run_into_each_other_touch_and_do_not_pass(two: Reality) -> None:
    for arm in ("arm", "arm_2"):
        two.obey(Follow((1.5,), (STRETCHED,)), arm)
    run(two, 3.0)
    apart = two.truth(3.0).apart
    assert apart is not None and -0.01 < apart < 0.001
    ends = [two.arms[arm].positions for arm in ("arm", "arm_2")]
    assert all(abs(end[1] - STRETCHED[1]) > 0.05 for end in ends), "neither got where it was sent"


def test_each_gripper_holds_its_own_object(
    make_reality: MakeReality, cube: Callable[..., ObjectSpec], play: Callable[..., None]
) -> None:
    two = make_reality(cube(3, 0.4, 0.1), cube(4, 0.5, -0.1), more_arms=[FACING], config={"deadman": 0.0})
    for arm, name in (("arm", "cube_3"), ("arm_2", "cube_4")):
        two.world.put(name, two.arms[arm].link_pose("tool_link"))
        two.obey(MoveGripper(0.0), arm)
        two.experimenter._stage.take(name, contents=False)
    play(two, 1.0)
    for name in ("cube_3", "cube_4"):
        two.experimenter._stage.release(name)
    truth = two.truth(1.0)
    assert (truth.held, truth.arms["arm_2"].held) == ("cube_3", "cube_4")
    assert truth.grasped == {"cube_3": "gripper", "cube_4": "arm_2_gripper"}
    two._stage.free("cube_4")
    assert two.truth(1.0).grasped == {"cube_3": "gripper"}
