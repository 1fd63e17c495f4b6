"""Hands that cover what they take, of which no fingertip is seen: what goes with them, and what stays."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.perception.visibility import ExpectedVisibility
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.occluded import Occlusion, standing
from tests.simulation_handler.worlds import CUBE

HELD = ("hand", "cube")
AT_FINGERS = Pose((0.1, 0.0, -0.05), (0.0, 0.0, 0.0, 1.0))
"""Hand_from_object of what a hand has between its fingers."""
AWAY = Pose((-0.3, 0.3, 0.2), (0.0, 0.0, 0.0, 1.0))
_HIDES = 0.2  # m about the palm


class Covered(Occlusion):
    """A cube, another one that is always seen, and a hand without visible fingertips that hides what is near it."""

    def __init__(self, seed: int = 0, noise: float = 0.008) -> None:
        super().__init__({"cube": standing(0.3, 0.0, CUBE), "cube_2": standing(0.3, 0.35, CUBE)}, seed)
        self.hand_noise = noise
        self.visibility = self.visibilities
        self.run(2.0)

    def visibilities(self, solids: Sequence[Solid], _: Sequence[Solid]) -> list[dict[str, ExpectedVisibility]]:
        covered, free = ExpectedVisibility(0.0, "hand"), ExpectedVisibility(1.0, "")
        return [{"camera": covered if self.hides(solid.position) else free} for solid in solids]

    def hides(self, place: Sequence[float]) -> bool:
        return self.palm is not None and self.hand_seen and math.dist(self.palm.t, place) < _HIDES

    def tick(self) -> None:
        self.seen = {name for name, pose in self.truths.items() if not self.hides(pose.t)}
        super().tick()

    def go(self, to: Pose, speed: float = 0.15) -> None:
        """Let the hand go somewhere, by itself."""
        begin = self.palm or to
        steps = max(1, round(math.dist(begin.t, to.t) / (speed * 0.05)))
        for k in range(1, steps + 1):
            x, y, z = (a + k / steps * (b - a) for a, b in zip(begin.t, to.t, strict=True))
            self.palm = Pose((x, y, z), to.q)
            self.tick()

    def cover(self, seconds: float) -> None:
        """Let the hand come to the cube and stay there."""
        at_cube = self.truths["cube"] @ AT_FINGERS.inverse()
        self.go(AWAY @ at_cube)
        self.go(at_cube)
        self.run(seconds)

    def carry(self, to: Pose) -> None:
        """Let the hand take the cube somewhere."""
        self.held, self.hand_from_object = "cube", AT_FINGERS
        self.move("cube", to)
        self.held = ""


@pytest.mark.parametrize("seed", range(3))
def test_what_a_resting_hand_covers_goes_along_with_it_and_stays_where_it_is_seen_again(seed: int) -> None:
    world = Covered(seed)
    world.cover(1.5)
    assert world.belief.grasps().keys() == {HELD}
    assert world.error("cube") < 0.005
    world.carry(standing(0.3, -0.3, CUBE, on=0.1))
    assert world.belief.grasps().keys() == {HELD}
    assert world.error("cube") < 0.04
    world.carry(standing(0.1, -0.3, CUBE))
    world.go(AWAY)
    world.run(1.0)
    assert world.belief.grasps() == {}
    assert world.error("cube") < 0.005


@pytest.mark.parametrize("seed", range(3))
def test_what_a_resting_hand_leaves_behind_is_there(seed: int) -> None:
    world = Covered(seed)
    world.cover(1.5)
    world.go(AWAY, 0.3)
    world.run(0.6)
    assert world.belief.grasps() == {}
    assert world.error("cube") < 0.005


@pytest.mark.parametrize("seed", range(3))
def test_a_hand_that_passes_takes_nothing(seed: int) -> None:
    world = Covered(seed)
    world.go(Pose((0.2, 0.4, 0.07)))
    for _ in range(round(0.8 / 0.15 / 0.05)):
        x, y, z = world.palm.t if world.palm else (0.0, 0.0, 0.0)
        world.palm = Pose((x, y - 0.15 * 0.05, z))
        world.tick()
        assert world.belief.grasps() == {}
        assert world.error("cube") < 0.005
    assert not world.texts()


def test_a_hand_that_hovers_high_above_an_object_does_not_touch_it() -> None:
    world = Covered()
    x, y, z = (world.truths["cube"] @ AT_FINGERS.inverse()).t
    world.go(Pose((x, y, z + 0.08)))
    world.run(2.0)
    assert not {"cube"} & world.seen
    assert world.belief.grasps() == {}


def test_what_is_missing_where_a_hand_has_passed_is_in_that_hand() -> None:
    world = Covered()
    world.cover(0.0)
    world.carry(standing(0.1, -0.4, CUBE, on=0.1))
    world.run(1.0)
    assert any(text == "taken_along(cube; hand)" for text in world.texts()) or world.belief.grasps().keys() == {HELD}
    assert not world.belief.is_gone("cube")
    assert world.error("cube") < 0.08


def test_what_is_missing_where_no_hand_was_is_removed() -> None:
    world = Covered()
    world.go(AWAY)
    world.run(1.0)
    world.truths["cube"] = standing(5.0, 0.0, CUBE)
    world.visibility = lambda solids, _: [{"camera": ExpectedVisibility(1.0, "")} for _ in solids]
    del world.truths["cube"]
    world.run(2.0)
    assert world.belief.is_gone("cube")


@pytest.mark.parametrize("seed", range(3))
def test_what_is_missing_where_fingertips_touch_it_is_in_that_hand(seed: int) -> None:
    """The hand hides it, though by its palm and the fingertips in sight it should be seen."""
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE), "cube_2": standing(0.3, 0.35, CUBE)}, seed)
    world.visibility = lambda solids, _: [{"camera": ExpectedVisibility(1.0, "")} for _ in solids]
    world.run(2.0)
    world.hand("cube", tips="touch")
    world.seen = {"cube_2"}
    world.run(3.0)
    assert any("taken_along" in text for text in world.texts())
    world.move("cube", standing(0.3, 0.0, CUBE, on=0.2))
    world.move("cube", standing(0.1, -0.2, CUBE, on=0.2))
    world.run(1.0)
    assert world.error("cube") < 0.02
    assert not world.belief.is_gone("cube")
