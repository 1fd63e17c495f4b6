"""Fingertips push what nobody sees, and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.physics.simulator import FINGER_RADIUS, Simulator
from tests.simulation_handler.occluded import BOX, KINDS, SMALL, Occlusion, standing
from tests.simulation_handler.worlds import CUBE, PERIOD, WALL

FINGERTIP = 0.008
"""m, its radius"""
BEGIN = 0.06
"""m from the object at which a hand begins"""
MIDDLE = 0.02
"""m, height of fingertips that push a cube"""


def with_hand(world: Occlusion, x: float, y: float = 0.0, z: float = MIDDLE, tips: tuple[float, ...] = (0.0,)) -> None:
    """Let there be a hand with fingertips beside each other at `tips` (m along y)."""
    world.hand_from_object = Pose((0.1, 0.0, -0.05))
    world.tips_from_object = {f"hand_finger_{k}": (0.0, across, 0.0) for k, across in enumerate(tips)}
    reach(world, x, y, z)


def reach(world: Occlusion, x: float, y: float = 0.0, z: float = MIDDLE) -> None:
    world.palm = Pose((x, y, z)) @ world.hand_from_object.inverse()


def pushed(world: Occlusion, name: str, by: float, *, hidden: bool, speed: float = 0.1) -> Pose:
    """Push an object at (0.3, 0) along x by `by` m and stop; where it truly gets, unseen from contact on, or before."""
    half = 0.5 * KINDS[name].size[0]
    begin, end = (0.3 + x - half - FINGERTIP for x in (-BEGIN, by))
    reach(world, begin)
    world.run(0.5)
    if hidden:
        world.seen.discard(name)
    for k in range(round((end - begin) / speed / PERIOD) + 1):
        x = min(begin + k * speed * PERIOD, end)
        reach(world, x)
        if x > 0.3 - half - FINGERTIP:
            world.seen.discard(name)
        world.tick()
    world.run(0.6)
    truth = world.truths[name]
    return Pose((end + half + FINGERTIP, truth.t[1], truth.t[2]), truth.q)


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("seed", range(2))
def test_an_unseen_cube_goes_along_before_a_fingertip(seed: int, hidden: bool) -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)}, seed)
    world.run(2.0)
    with_hand(world, 0.2)
    world.truths["cube"] = pushed(world, "cube", 0.08, hidden=hidden)
    assert world.error("cube") < 0.02
    assert world.texts() == []
    world.seen.add("cube")
    world.run(1.0)
    assert world.error("cube") < 0.005


@pytest.mark.parametrize("speed", [0.05, 0.25])
def test_two_fingertips_push_far_slowly_and_fast(speed: float) -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)})
    world.run(2.0)
    with_hand(world, 0.2, tips=(-0.011, 0.011))
    world.truths["cube"] = pushed(world, "cube", 0.15, hidden=True, speed=speed)
    assert world.error("cube") < 0.02
    assert world.texts() == []


@pytest.mark.parametrize("by", [0.06, 0.12])
def test_what_was_pushed_before_it_is_known_to_be_unseen_goes_before_the_fingertips_all_the_way(by: float) -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)})
    world.run(2.0)
    with_hand(world, 0.2, tips=(-0.011, 0.011))
    world.truths["cube"] = pushed(world, "cube", by, hidden=False)
    assert world.error("cube") < 0.015


def test_an_unseen_cup_is_pushed_off_the_table() -> None:
    world = Occlusion({"cup": standing(0.3, 0.0, SMALL)})
    world.run(2.0)
    with_hand(world, 0.2, tips=(-0.02, 0.02))
    pushed(world, "cup", 0.75, hidden=True, speed=0.2)
    world.run(1.0)
    assert world.pose("cup").t[2] < -0.3


def test_what_is_seen_goes_by_its_percepts() -> None:
    """Bit for bit, beside the same world without a hand: a stack under fingertips with 5 mm of noise."""
    poses = []
    for has_hand in (True, False):
        world = Occlusion({f"cube_{k}": standing(0.3, 0.0, CUBE, on=0.04 * k) for k in range(3)})
        world.run(3.0)
        if has_hand:
            with_hand(world, 0.3 - 0.5 * CUBE[0] - FINGERTIP, z=0.06, tips=(-0.011, 0.011))
            world.hand_noise = 0.005
        for k in range(40):
            world.rng = np.random.default_rng(k)
            world.tick()
        poses.append([(world.pose(name).t, world.pose(name).q) for name in world.truths])
    assert poses[0] == poses[1]


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_of_a_hand_at_rest_moves_no_unseen_stack(seed: int) -> None:
    cubes = {f"cube_{k}": standing(0.3, 0.0, CUBE, on=0.04 * k) for k in range(3)}
    world = Occlusion(cubes, seed)
    world.run(2.0)
    world.seen = set()
    world.run(1.0)
    before = {name: world.pose(name) for name in cubes}
    with_hand(world, 0.3 - 0.5 * CUBE[0] - FINGERTIP - 0.005, z=0.06, tips=(-0.011, 0.011))
    world.hand_noise = 0.005
    world.run(5.0)
    assert all(world.pose(name).distance(before[name])[0] < 0.0005 for name in cubes)


@pytest.mark.parametrize("seen", [True, False])
def test_a_hand_that_passes_above_changes_nothing(seen: bool) -> None:
    """Bit for bit, beside the same world without a hand."""
    poses = []
    for has_hand in (True, False):
        world = Occlusion({f"cube_{k}": standing(0.3, 0.0, CUBE, on=0.04 * k) for k in range(2)})
        world.run(2.0)
        if not seen:
            world.seen = set()
        if has_hand:
            with_hand(world, 0.1)
        for k in range(40):
            if has_hand:
                reach(world, 0.1 + 0.01 * k, z=0.08 + FINGERTIP + 0.02)
            world.rng = np.random.default_rng(k)
            world.tick()
        poses.append([(world.pose(name).t, world.pose(name).q) for name in world.truths])
    assert poses[0] == poses[1]


@pytest.mark.parametrize("goes", [False, True])
def test_a_hand_that_vanishes_while_it_pushes_leaves_nothing_behind(goes: bool) -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)})
    world.run(2.0)
    with_hand(world, 0.2)
    pushed(world, "cube", 0.05, hidden=True)
    assert len(world.belief._bodies.sim.fingers.bodies) == 1
    world.hand_seen = False
    if goes:
        world.palm = None
        world.belief.touch({})
    world.run(0.1)
    there = world.pose("cube")
    world.run(2.0)
    assert world.belief._bodies.sim.fingers.bodies == []
    assert world.pose("cube").distance(there)[0] < 0.0005


def test_a_frozen_scene_and_contacts_know_no_fingers() -> None:
    world = Occlusion({"cube": standing(0.3, 0.0, CUBE)})
    world.run(2.0)
    with_hand(world, 0.2)
    pushed(world, "cube", 0.05, hidden=True)
    sim = world.belief._bodies.sim
    assert len(sim.fingers.bodies) == 1
    assert set(sim.names) == {"_floor", "table", "cube"}
    assert {body.name for body in world.belief.scene().bodies} == {"table", "_floor", "cube"}
    assert {name for contact in sim.contacts(0.01) for name in contact[:2]} <= {"table", "cube"}


def test_what_is_in_a_box_that_is_seen_is_not_pushed_from_outside() -> None:
    inside = 0.3 - 0.5 * BOX[0] + WALL + 0.5 * CUBE[0]
    world = Occlusion({"box": standing(0.3, 0.0, BOX), "cube": standing(inside, 0.0, CUBE, on=WALL)})
    world.run(2.0)
    world.seen = {"box"}
    world.run(1.0)
    before = world.pose("cube")
    with_hand(world, 0.3 - 0.5 * BOX[0] + 0.002, z=0.03)
    world.run(2.0)
    assert world.pose("cube").distance(before)[0] < 0.001


def test_pushes_are_repeatable_bit_for_bit() -> None:
    ends = []
    for _ in range(2):
        world = Occlusion({"cube_0": standing(0.3, 0.0, CUBE), "cube_1": standing(0.36, 0.0, CUBE)}, seed=1)
        world.run(1.0)
        world.seen = set()
        with_hand(world, 0.2, tips=(-0.01, 0.0, 0.01))
        for k in range(40):
            reach(world, 0.2 + 0.004 * k)
            world.tick()
        ends.append([(world.pose(name).t, world.pose(name).q) for name in world.truths])
    assert ends[0] == ends[1]
    assert ends[0][1][0][0] > 0.37


class TestFingerBodies:
    """Spheres in the simulator."""

    def world(self) -> Simulator:
        sim = Simulator()
        sim.add_box("table", (1.0, 1.0, 0.04), (0.0, 0.0, -0.02))
        sim.add_box("cube", CUBE, (0.0, 0.0, 0.02), mass=0.05)
        sim.fingers.add("tip", (-0.05, 0.0, 0.02))
        return sim

    def test_they_go_through_what_they_are_not_told_to_meet(self) -> None:
        with self.world() as sim:
            sim.fingers.move("tip", (0.05, 0.0, 0.02), 240)
            sim.step(240)
            assert sim.fingers.position("tip") == pytest.approx((0.05, 0.0, 0.02), abs=0.003)
            assert sim.position("cube") == pytest.approx((0.0, 0.0, 0.02), abs=1e-4)

    def test_they_push_what_they_meet(self) -> None:
        with self.world() as sim:
            sim.step(240)
            sim.fingers.meet("tip", {"cube"})
            sim.fingers.move("tip", (0.05, 0.0, 0.02), 240)
            sim.step(300)
            assert sim.position("cube")[0] == pytest.approx(0.05 + FINGER_RADIUS + 0.5 * CUBE[0], abs=0.002)
            assert sim.fingers.position("tip") == pytest.approx((0.05, 0.0, 0.02), abs=0.002)

    def test_their_force_is_limited(self) -> None:
        with self.world() as sim:
            sim.add_box("block", (0.2, 0.2, 0.2), (0.13, 0.0, 0.1), mass=20.0)
            sim.fingers.meet("tip", {"block", "cube"})
            sim.fingers.move("tip", (0.08, 0.0, 0.02), 240)
            sim.step(480)
            assert math.dist(sim.position("block"), (0.13, 0.0, 0.1)) < 0.002

    def test_a_body_that_comes_after_one_that_was_met_is_not_met(self) -> None:
        with self.world() as sim:
            sim.fingers.meet("tip", {"cube"})
            sim.remove("cube")
            sim.add_box("other", CUBE, (0.0, 0.0, 0.02), mass=0.05)
            sim.fingers.move("tip", (0.05, 0.0, 0.02), 240)
            sim.step(240)
            assert sim.position("other") == pytest.approx((0.0, 0.0, 0.02), abs=1e-4)

    def test_one_that_was_removed_comes_back_and_meets_nothing(self) -> None:
        with self.world() as sim:
            sim.fingers.meet("tip", {"cube"})
            sim.fingers.remove("tip")
            sim.fingers.remove("tip")
            assert "tip" not in sim.fingers
            sim.fingers.add("thumb", (0.0, 0.0, 0.02))
            sim.step(240)
            assert sim.position("cube") == pytest.approx((0.0, 0.0, 0.02), abs=1e-4)
            assert sim.fingers.position("thumb") == pytest.approx((0.0, 0.0, 0.02), abs=1e-4)
