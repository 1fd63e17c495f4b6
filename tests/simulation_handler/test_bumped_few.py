"""Few things in view: the belief is not sure of what is wrong, be the camera bumped or be they pushed."""

from __future__ import annotations

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.perception.percepts import SeenObject
from tests.simulation_handler.occluded import KINDS, NOISE, Occlusion, standing
from tests.simulation_handler.worlds import CAMERA, PERIOD

PLACES = ((0.2, -0.2), (0.55, -0.1), (0.25, 0.25))
BARE = np.diag([NOISE**2] * 3 + [10.0] * 3)
"""m^2 and rad^2 of percepts that do not tell how something is turned"""
PUSHED = 0.3
"""m/s"""


class Few(Occlusion):
    """Some things of a kind that one camera shows, and that have rested for 1.5 s."""

    def __init__(self, kind: str, count: int, seed: int, *, tagged: bool) -> None:
        truths = {f"{kind}_{k}": standing(*PLACES[k], KINDS[kind].size) for k in range(count)}
        super().__init__(truths, seed)
        self.tagged, self.bump = tagged, Pose.identity()
        self.run(1.5)
        shift = np.random.default_rng(seed).normal(size=3)
        self.shift = 0.03 * shift / np.linalg.norm(shift)

    def tick(self) -> None:
        self.now += PERIOD
        self.ticks += 1
        for name in self.truths if self.ticks % 2 else ():
            pose = self.bump @ self.percept(name)
            pose = Pose(pose.t, pose.q, self.now).with_covariance(None if self.tagged else BARE)
            self.belief.observe([SeenObject(name, pose, self.now, CAMERA, "camera")])
        self.belief.step(self.now)

    def bump_camera(self) -> None:
        turn = np.random.default_rng(self.ticks).normal(size=3)
        self.bump = Pose(CAMERA) @ Pose.from_rotvec(self.shift, 0.01 * turn) @ Pose(CAMERA).inverse()

    def push(self, seconds: float) -> None:
        """Push all of them alike on the table, until they have got 3 cm further."""
        right, back, _ = 0.03 * self.shift / np.hypot(*self.shift[:2])
        starts = dict(self.truths)
        for k in range(1, round(seconds / PERIOD) + 1):
            share = min(k * PERIOD * PUSHED / 0.03, 1.0)
            self.truths = {name: Pose((share * right, share * back, 0.0)) @ pose for name, pose in starts.items()}
            self.tick()

    def chance(self, name: str) -> float:
        """Probability that a thing is within 1 cm of where it is."""
        worlds = next(island.worlds for island in self.belief.islands() if name in island.names)
        places = ((world.weight, world.objects[name].pose) for world in worlds)
        return sum(weight for weight, pose in places if pose and pose.distance(self.truths[name])[0] < 0.01)


@pytest.mark.parametrize("tagged", [False, True])
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["cup", "cube"])
def test_what_a_bumped_camera_shows_elsewhere_may_be_where_it_was(kind: str, count: int, tagged: bool) -> None:
    few = Few(kind, count, 0, tagged=tagged)
    few.bump_camera()
    for _ in range(round(1.5 / PERIOD)):
        few.tick()
        assert min(map(few.chance, few.truths)) > 0.3


@pytest.mark.parametrize("tagged", [False, True])
@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("kind", ["cup", "cube"])
def test_what_was_pushed_alike_may_be_where_it_is_seen(kind: str, count: int, tagged: bool) -> None:
    few = Few(kind, count, 0, tagged=tagged)
    few.push(0.3)
    for _ in range(round(1.5 / PERIOD)):
        few.tick()
        assert min(map(few.chance, few.truths)) > 0.1


@pytest.mark.parametrize("seed", range(2))
def test_two_cups_are_not_driven_where_a_bumped_camera_shows_them(seed: int) -> None:
    few = Few("cup", 2, seed, tagged=True)
    few.bump_camera()
    for _ in range(round(0.7 / PERIOD)):
        few.tick()
        assert max(map(few.error, few.truths)) < 0.01
