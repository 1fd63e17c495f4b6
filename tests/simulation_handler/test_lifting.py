"""When the belief says that something which is held was taken up from where it lay, and when it does not."""

from __future__ import annotations

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.motion.holding import GripperGrasp
from tests.simulation_handler.occluded import BOX, SMALL, Occlusion, standing


def grasped(seed: int = 0, tips: str = "pinch") -> Occlusion:
    """A cup on the table in a hand that has not moved it yet."""
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)}, seed)
    world.run(2.0)
    world.hand("cup", tips=tips)
    world.run(0.8)
    assert world.belief.lifted() == {}
    return world


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_takes_up_has_left_when_it_did(seed: int, seen: bool) -> None:
    world = grasped(seed)
    if not seen:
        world.seen.discard("cup")
        world.run(0.5)
    began = world.now
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.run(0.3)
    assert world.belief.lifted()["cup"] == pytest.approx(began, abs=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_hand_pushes_or_lets_lie_is_not_taken_up(seed: int) -> None:
    world = grasped(seed, "touch")
    world.move("cup", standing(0.3, 0.15, SMALL))
    world.run(3.0)
    assert world.belief.lifted() == {}


def test_what_is_in_what_a_hand_takes_up_is_not_taken_up_itself() -> None:
    world = Occlusion({"box": standing(0.3, 0.0, BOX), "ball": Pose((0.3, 0.0, 0.03))})
    world.run(2.0)
    world.hand("box")
    world.run(0.8)
    world.seen.discard("ball")
    world.move("box", standing(0.3, 0.0, BOX, on=0.15))
    world.run(0.3)
    assert world.belief.lifted().keys() == {"box"}


def test_it_is_taken_up_again_only_after_it_has_lain_again() -> None:
    world = grasped()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    first = world.belief.lifted()["cup"]
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.05))
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    assert world.belief.lifted()["cup"] == first
    world.move("cup", standing(0.3, 0.0, SMALL))
    world.run(0.5)
    world.held, world.palm = "", Pose((0.5, 0.3, 0.3))
    world.run(1.0)
    world.hand("cup")
    world.run(0.8)
    assert world.belief.lifted()["cup"] == first
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    assert world.belief.lifted()["cup"] > first


def test_what_is_no_more_was_not_taken_up() -> None:
    world = grasped()
    world.move("cup", standing(0.3, 0.0, SMALL, on=0.15))
    world.belief.remove("cup")
    assert world.belief.lifted() == {}


def test_what_a_gripper_takes_up_has_left_when_it_did() -> None:
    world = Occlusion({"cube": Pose((0.3, 0.0, 0.02))})
    world.run(2.0)
    began = world.now
    for k in range(1, 21):
        gripper = Pose((0.3, 0.0, 0.1 + 0.01 * k))
        world.belief.hold({"cube": GripperGrasp("gripper", gripper, Pose((0.0, 0.0, -0.08)))})
        world.truths["cube"] = Pose((0.3, 0.0, 0.02 + 0.01 * k))
        world.tick()
    assert world.belief.lifted()["cube"] == pytest.approx(began, abs=0.15)
