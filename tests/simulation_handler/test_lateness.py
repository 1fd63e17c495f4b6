"""Cameras that tell late: what they see is as fresh as it can be, and what they do not tell yet is not missing."""

from __future__ import annotations

import math

import pytest

from dsr.math3d.transforms import Pose
from dsr.perception.scales import FRAME, PRESENT, RECENT_PERCEPTS, UNSEEN_AFTER
from simulation_handler.perception.lateness import Lateness
from simulation_handler.perception.percepts import SeenObject
from tests.simulation_handler.occluded import SMALL, Occlusion, standing
from tests.simulation_handler.worlds import CAMERA, PERIOD, VIEW, World, cube_at

LATE = 1.2  # s


class LateWorld(World):
    """A world of which the camera tells what it saw `late` s ago."""

    late = LATE
    dark = False
    waiting: list[tuple[float, SeenObject]]

    def tick(self) -> None:
        self.waiting = getattr(self, "waiting", [])
        due = [sight for told_at, sight in self.waiting if told_at <= self.now + 1e-6]
        self.waiting = [one for one in self.waiting if one[1] not in due]
        for sight in due:
            self.belief.observe([sight])
        super().tick()

    def see(self, name: str, percept: object) -> None:
        if not self.dark:
            sight = SeenObject(name, percept, percept.stamp, CAMERA, VIEW.camera)  # type: ignore[attr-defined, arg-type]
            self.waiting.append((self.now + self.late, sight))


def late_world(*, rays: bool = False) -> LateWorld:
    world = LateWorld({"cube_0": cube_at(0.3, 0.1), "cube_1": cube_at(0.45, -0.1)}, rays=rays)
    world.run(4.0)
    return world


def test_what_a_late_camera_sees_is_seen() -> None:
    world = late_world()
    for _ in range(20):
        world.tick()
        assert all(world.belief.perceived(name, world.now) for name in world.truths)


def test_what_a_late_camera_shows_elsewhere_is_followed() -> None:
    world = late_world()
    world.truths["cube_0"] = cube_at(0.3, -0.15)
    world.run(LATE + 1.0)
    assert world.error("cube_0") < 0.005


def test_what_a_late_camera_does_not_tell_yet_is_not_missing() -> None:
    world = late_world(rays=True)
    for _ in range(20):
        world.tick()
        assert not world.belief._explainer.missing(world.now)
    world.truths["cube_0"] = cube_at(2.0, 2.0)
    world.seen.discard("cube_0")
    world.run(LATE + 0.5 * UNSEEN_AFTER)
    assert not world.belief.is_gone("cube_0")
    world.run(3.0)
    assert world.belief.is_gone("cube_0") and not world.belief.is_gone("cube_1")


def test_what_a_late_camera_ceases_to_show_is_unseen_in_the_end() -> None:
    world = late_world()
    world.dark = True
    world.run(2.0 * LATE + UNSEEN_AFTER)
    assert not any(world.belief.perceived(name, world.now) for name in world.truths)


class TwoCameras(World):
    """A fast camera sees all, and a slow one, once a second, what it is `shown`."""

    shown: tuple[str, ...] = ()

    def see(self, name: str, percept: Pose) -> None:
        super().see(name, percept)
        if name in self.shown and round(self.ticks * PERIOD / FRAME) % 10 == 0:
            self.belief.observe([SeenObject(name, percept, percept.stamp + 1e-3, CAMERA, "slow")])


def test_a_slow_camera_does_not_delay_what_a_fast_one_shows() -> None:
    world = TwoCameras({"cube_0": cube_at(0.3, 0.1), "cube_1": cube_at(0.45, -0.1)}, rays=True)
    world.shown = ("cube_0",)
    world.run(8.0)
    world.seen.discard("cube_0")
    world.run(1.2)
    assert world.belief.is_gone("cube_0") and not world.belief.is_gone("cube_1")


class LateOcclusion(Occlusion):
    """A thing in view of a camera with an image in so many ticks, which tells each image `late` s later."""

    late, every = 0.3, 2

    def __init__(self) -> None:
        super().__init__({"cup": standing(0.3, -0.2, SMALL)})
        self.waiting: list[tuple[float, Pose]] = []

    def tick(self) -> None:
        self.now += PERIOD
        self.ticks += 1
        if self.ticks % self.every == 1:
            self.waiting.append((self.now + self.late, self.percept("cup")))
        while self.waiting and self.waiting[0][0] <= self.now + 1e-9:
            _, percept = self.waiting.pop(0)
            self.belief.observe([SeenObject("cup", percept, percept.stamp, CAMERA, "camera")])
        self.belief.flag(self.belief.names)
        self.belief.step(self.now)


@pytest.mark.parametrize(("every", "late"), [(2, 0.1), (2, 0.3), (2, 0.45), (10, 0.5)])
def test_what_a_somewhat_late_camera_saw_move_comes_to_where_it_was_put(every: int, late: float) -> None:
    world = LateOcclusion()
    world.every, world.late = every, late
    world.run(6.0)
    for on, y in ((0.2, -0.2), (0.2, 0.2), (0.0, 0.2)):
        world.move("cup", standing(0.3, y, SMALL, on=on))
    world.run(3.0)
    assert world.error("cup") < 0.01


@pytest.mark.parametrize("period", [FRAME, 0.4])
@pytest.mark.parametrize("delay", [0.0, 0.05, 1.0])
def test_a_camera_is_late_by_what_its_newest_percept_is_older_than_the_present(period: float, delay: float) -> None:
    lateness, late = Lateness(), dict[str, float]()
    for count in range(20):
        lateness.hear("camera", count * period)
        late = lateness.update(count * period + delay)
    assert late.get("camera", 0.0) == pytest.approx(max(period + delay - PRESENT, 0.0))


def test_a_camera_that_was_covered_for_a_while_is_not_late() -> None:
    lateness = Lateness()
    for count in [*range(20), *range(100, 103), *range(200, 203)]:
        lateness.hear("camera", count * FRAME)
        assert lateness.update(count * FRAME + 0.05) == {}


def test_of_two_cameras_each_is_late_by_itself() -> None:
    lateness, late = Lateness(), dict[str, float]()
    for count in range(RECENT_PERCEPTS):
        lateness.hear("quick", count * FRAME)
        lateness.hear("slow", count * FRAME - 1.0)
        late = lateness.update(count * FRAME)
    assert late.keys() == {"slow"} and math.isclose(late["slow"], 1.0 + FRAME - PRESENT)
