"""The belief against synthetic worlds: closer to the truth than the percepts, resting, steady, right after changes."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.belief import Belief
from simulation_handler.config import BeliefConfig
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.physics.simulator import SimulationError
from simulation_handler.scales import TURN_FLOOR
from tests.simulation_handler.worlds import CUBE, PERIOD, TABLE, World, cube_at


def grid(count: int, seed: int) -> dict[str, Pose]:
    """Cubes some 90 mm apart, turned anyhow."""
    rng = np.random.default_rng(seed)
    side = math.ceil(math.sqrt(count))
    return {
        f"cube_{i}": cube_at(
            0.35 + 0.09 * (i % side - (side - 1) / 2),
            0.09 * (i // side - (side - 1) / 2),
            yaw=rng.uniform(-math.pi, math.pi),
        )
        for i in range(count)
    }


def block(columns: int, rows: int) -> dict[str, Pose]:
    """Cubes with gaps of 2 mm."""
    return {
        f"cube_{x}_{y}": cube_at(0.35 + 0.042 * (x - (columns - 1) / 2), 0.042 * (y - (rows - 1) / 2))
        for x in range(columns)
        for y in range(rows)
    }


def penetration(world: World) -> float:
    """Deepest interpenetration in the belief, m."""
    return max((-contact.distance for contact in world.belief._bodies.sim.contacts()), default=0.0)


def until_close(world: World, name: str, limit: float = 0.005, most: float = 3.0) -> float:
    """Seconds until the belief of an object is within `limit` m of the truth."""
    start = world.now
    while world.error(name) > limit:
        assert world.now - start < most, f"{name} is off by {world.error(name)} m"
        world.tick()
    return world.now - start


def likeliest(belief: Belief, name: str) -> Pose:
    """Where an object most probably is by the weighted worlds."""
    (island,) = [island for island in belief.islands() if name in island.names]
    pose = max(island.worlds, key=lambda world: world.weight).objects[name].pose
    assert pose is not None
    return pose


@pytest.mark.parametrize("truths", [grid(1, 0), grid(4, 1), grid(8, 2), block(2, 2), block(4, 1)])
def test_a_noisy_scene_is_believed_better_than_perceived_and_stays_still(truths: dict[str, Pose]) -> None:
    world = World(truths, seed=len(truths))
    world.run(5.0)
    settled = {name: world.pose(name) for name in truths}
    percept_errors: dict[str, list[float]] = {name: [] for name in truths}
    for _ in range(200):
        world.tick()
        assert penetration(world) < 0.0005
        for name in truths:
            assert world.pose(name).t[2] == pytest.approx(0.02, abs=0.0005)
            assert math.dist(world.pose(name).t, settled[name].t) < 0.001
            percept_errors[name].append(world.percept_error(name))
    for name in truths:
        assert world.error(name) < 0.0008
        assert world.error(name) < min(percept_errors[name])
        assert world.pose(name).distance(truths[name])[1] < math.radians(0.6)
        assert world.belief.plausible(name)
    assert world.belief.supports().keys() == {(name, "table") for name in truths}


def test_nothing_interpenetrates_while_a_tight_block_of_twenty_appears() -> None:
    world = World(block(5, 4), seed=3)
    for _ in range(60):
        world.tick()
        assert penetration(world) < 0.0005
    assert all(world.error(name) < 0.0015 for name in world.truths)


def test_the_same_inputs_give_bit_identical_beliefs() -> None:
    results = []
    for _ in range(2):
        world = World(grid(6, 4) | {"top": cube_at(0.35, -0.045, 0.06)}, seed=5)
        world.run(2.0)
        world.truths["cube_0"] = cube_at(0.5, 0.2)
        world.run(1.0)
        results.append([world.pose(name) for name in world.truths] + [world.belief.supports()])
    assert results[0] == results[1]


def test_one_wrong_frame_does_not_change_the_belief() -> None:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.4, -0.1)})
    world.run(3.0)
    for wrong in (cube_at(0.3, 0.2, 0.05), cube_at(0.4, -0.1, 0.06), cube_at(0.4, 0.1, yaw=0.8)):
        before = {name: world.pose(name) for name in world.truths}
        world.now += PERIOD
        world.see("a", wrong.with_stamp(world.now))
        world.belief.step(world.now)
        assert all(world.pose(name).distance(before[name])[0] < 1e-5 for name in before)
        world.run(0.1)


@pytest.mark.parametrize("there", [cube_at(0.415, 0.1), cube_at(0.2, -0.1), cube_at(0.4, 0.1, yaw=0.785)])
def test_a_move_is_followed_within_half_a_second(there: Pose) -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(3.0)
    world.truths["a"] = there
    world.run(0.45)
    metres, radians = world.pose("a").distance(there)
    assert metres < 0.004
    assert radians < math.radians(2.0)


def test_a_stack_of_three_built_in_view_stands_and_what_it_hides_persists() -> None:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.4, -0.1), "c": cube_at(0.3, 0.0)})
    world.run(3.0)
    world.truths["a"], world.seen = cube_at(0.402, -0.099, 0.06, 0.3), {"a", "c"}
    assert until_close(world, "a") <= 0.5
    world.run(1.5)
    world.truths["c"], world.seen = cube_at(0.404, -0.098, 0.10, 0.1), {"c"}
    assert until_close(world, "c") <= 0.5
    world.run(10.0)
    assert all(world.error(name) < 0.003 for name in world.truths)
    assert world.pose("c").t[2] == pytest.approx(0.10, abs=0.0005)
    assert world.belief.supports().keys() == {("a", "b"), ("b", "table"), ("c", "a")}
    assert world.belief.perceived("c", world.now)
    assert not world.belief.perceived("a", world.now)
    assert penetration(world) < 0.0005


def test_bodies_stay_where_the_mean_of_noisy_percepts_has_them() -> None:
    world = World(grid(4, 0))
    world.camera.lateral_noise = 0.005  # m, of a camera that is far away
    world.run(2.0)
    for _ in range(100):
        world.run(0.1)
        for name in world.truths:
            estimate = world.belief._bodies.object(name).track.estimate
            assert estimate is not None
            apart = math.dist(world.belief._bodies.sim.position(name)[:2], estimate.position[:2].tolist())
            across, bias = estimate.standard_deviations()[0], 0.002  # m, by which depth errors shift it at most
            assert apart < 1.5 * across + bias


def test_what_rests_is_known_as_well_as_the_noise_of_percepts_allows() -> None:
    distances = []
    for seed in range(6):
        world = World(grid(4, seed), seed)
        world.camera.lateral_noise = world.camera.depth_noise = 0.005  # m
        world.run(1.5)
        for _ in range(20):
            world.run(0.5)
            for name, thing in world.belief.evidence().objects.items():
                estimate = world.belief._bodies.object(name).track.estimate
                assert thing.believed is not None and estimate is not None
                off = np.subtract(world.truths[name].t, thing.believed.t)[:2]
                place = thing.believed.parent_covariances()[0][:2, :2]
                distances.append(float(off @ np.linalg.solve(place, off)))
                across = math.sqrt(0.5 * float(np.trace(place)))
                assert across < 1.6 * estimate.standard_deviations()[0], "noise of long ago counts no more"
        world.belief.close()
    within = np.array(distances) <= -2.0 * math.log(1.0 - 0.9)  # of a Gaussian in two directions
    assert 0.8 <= within.mean() <= 0.97


def test_a_glance_tells_a_rotation_no_better_than_bodies_in_contact_are_known() -> None:
    world = World({"cube": cube_at(0.3, 0.1)})
    world.run(2.0)
    world.seen = set()
    world.run(2.0)
    world.now += PERIOD
    world.see("cube", cube_at(0.4, -0.1).with_stamp(world.now).with_covariance(np.diag([1e-6] * 6)))
    world.belief.step(world.now)
    seen = world.belief.evidence().objects["cube"].seen
    assert seen is not None and seen.t[0] == pytest.approx(0.4, abs=0.005)
    assert np.linalg.eigvalsh(seen.parent_covariances()[1])[0] > TURN_FLOOR**2


def test_what_is_taken_off_a_stack_ends_its_relation() -> None:
    world = World({"a": cube_at(0.4, 0.1, 0.06), "b": cube_at(0.4, 0.1)})
    world.run(2.0)
    assert ("a", "b") in world.belief.supports()
    since = world.belief.supports()["a", "b"]
    world.truths["a"] = cube_at(0.3, -0.1)
    world.run(1.0)
    assert world.belief.supports().keys() == {("a", "table"), ("b", "table")}
    assert world.belief.supports()["a", "table"] > since


def test_lifted_carried_and_put_down_again() -> None:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.4, -0.1)})
    world.run(3.0)
    for step in range(20):
        world.truths["a"] = cube_at(0.4, 0.1, 0.02 + 0.01 * step)
        world.run(0.1)
    assert not world.belief.plausible("a")
    assert world.error("a") < 0.012
    world.run(1.5)
    assert world.error("a") < 0.004, "the depth error was learned while it rested"
    for step in range(20):
        world.truths["a"] = cube_at(0.4, 0.1 - 0.01 * step, 0.21)
        world.run(0.1)
    world.seen = {"a"}
    for step in range(15):
        world.truths["a"] = cube_at(0.4, -0.1, 0.2 - 0.01 * step)
        world.run(0.1)
    world.run(2.0)
    assert world.belief.plausible("a")
    assert world.belief.supports().keys() == {("a", "b"), ("b", "table")}
    assert all(world.error(name) < 0.001 for name in world.truths)


def test_an_unseen_object_obeys_physics() -> None:
    world = World({"a": cube_at(0.4, 0.1, 0.06), "b": cube_at(0.4, 0.1)})
    world.run(2.0)
    world.seen = {"b"}
    world.run(1.0)
    assert world.error("a") < 0.001
    world.truths |= {"a": cube_at(0.4, 0.1), "b": cube_at(0.3, -0.1)}
    world.run(1.5)
    assert world.error("a") < 0.003, "it fell when its support was taken away"
    assert world.error("b") < 0.002


@pytest.mark.parametrize(("steadily", "height"), [(0.0, 0.02), (2.0, 0.10)])
def test_what_is_lost_from_sight_on_its_way_falls_unless_it_was_held_steadily(steadily: float, height: float) -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(2.0)
    for step in range(8):
        world.truths["a"] = cube_at(0.4, 0.1, 0.03 + 0.01 * step)
        world.run(0.1)
    world.run(steadily)
    world.seen = set()
    world.run(2.0)
    assert world.pose("a").t[2] == pytest.approx(height, abs=0.008)
    assert world.belief.plausible("a") is (steadily == 0.0)


def test_objects_that_were_never_seen_are_found_beneath_a_hovering_one() -> None:
    world = World({f"cube_{level}": cube_at(0.45, 0.1, 0.02 + 0.04 * level) for level in range(3)})
    world.seen = {"cube_2"}
    world.run(0.5)
    assert not world.belief.plausible("cube_2")
    assert world.belief.pose("cube_0") is None
    world.run(2.0)
    assert all(world.error(name) < 0.002 for name in world.truths)
    assert world.belief.plausible("cube_2")
    assert ("cube_2", "cube_1") in world.belief.supports()


def test_what_hovered_stands_on_what_is_found_beneath_it_at_once() -> None:
    world = World({f"cube_{level}": cube_at(0.45, 0.1, 0.02 + 0.04 * level) for level in range(3)})
    world.seen = {"cube_2"}
    while world.belief.pose("cube_0") is None:
        world.tick()
    assert world.error("cube_2") < 0.002
    assert world.belief.plausible("cube_2")


def test_a_belief_that_nobody_told_what_cameras_see_follows_percepts() -> None:
    belief = Belief(BeliefConfig())
    belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
    belief.add_object("a", CUBE, mass=0.05)
    for tick in range(1, 41):
        belief.observe([SeenObject("a", cube_at(0.4, 0.1 if tick < 20 else 0.2), PERIOD * tick)])
        belief.flag(["a"])
        belief.step(PERIOD * tick)
    pose = belief.pose("a")
    assert pose is not None and pose.t == pytest.approx((0.4, 0.2, 0.02), abs=0.002)


def test_what_nothing_known_carries_is_held_and_does_not_fall_again_and_again() -> None:
    world = World({"a": cube_at(0.45, 0.1, 0.10)})
    world.run(0.3)
    heights = []
    for _ in range(100):
        world.tick()
        heights.append(world.pose("a").t[2])
    assert max(heights) - min(heights) < 0.02
    assert world.error("a") < 0.001
    assert not world.belief.plausible("a")
    assert world.belief.supports() == {}
    world.truths["a"] = cube_at(0.45, 0.1)
    assert until_close(world, "a") <= 0.5
    assert world.belief.plausible("a")


def test_a_wrong_guess_of_what_is_beneath_gives_way_to_perception() -> None:
    world = World({"top": cube_at(0.45, 0.1, 0.06), "other": cube_at(0.3, -0.1)})
    world.seen = {"top"}
    world.run(3.0)
    assert ("top", "other") in world.belief.supports()
    world.seen = {"top", "other"}
    world.run(3.0)
    assert world.error("other") < 0.001
    assert world.error("top") < 0.002, "held again"


def test_a_right_guess_of_what_is_beneath_is_right_from_the_first_percept_on() -> None:
    world = World({"top": cube_at(0.45, 0.1, 0.06), "other": cube_at(0.45, 0.1)})
    world.seen = {"top"}
    world.run(3.0)
    world.see("other", world.camera.percept("other", world.truths["other"], world.now + PERIOD))
    world.tick()
    assert world.belief.perceived("other", world.now)


def test_a_cube_that_stays_tilted_is_held_as_it_is_seen() -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(1.0)
    world.truths["a"] = Pose.from_rotvec((0.4, 0.1, 0.028), (0.0, math.radians(40.0), 0.0))
    world.run(2.0)
    assert world.pose("a").distance(world.truths["a"])[1] < math.radians(3.0)
    assert not world.belief.plausible("a")


def test_physics_that_keeps_disagreeing_with_perception_gives_in() -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(2.0)
    body = world.belief._bodies.object("a")
    for _ in range(3):
        world.belief._bodies.sim.place("a", (0.4, 0.13, 0.02), world.pose("a").q)
        world.run(4 * PERIOD)
        assert world.error("a") < 0.001
    assert body.static
    assert not world.belief.plausible("a")


def test_what_was_pushed_aside_in_the_belief_returns_when_the_way_is_free() -> None:
    world = World({"seen": cube_at(0.35, 0.0)})
    world.run(2.0)
    world.belief._bodies.put(world.belief._bodies.object("seen"), (0.343, 0.0, 0.02), (0.0, 0.0, 0.0, 1.0))
    assert world.error("seen") > 0.005
    world.run(0.2)
    assert world.error("seen") < 0.001


def test_what_percepts_hold_in_its_place_against_physics_still_rests_there() -> None:
    world = World({"struck": cube_at(0.35, 0.0)})
    world.run(1.0)
    item = world.belief._bodies.object("struck")
    for _ in range(20):
        if not item.static:
            world.belief._bodies.sim.set_velocity("struck", (0.5, 0.0, 0.0), (0.0, 0.0, 0.0))
        world.tick()
    world.belief._bodies.sim.make_static("struck", True)  # as percepts do last: then physics tells of no contact
    world.seen = set()
    world.run(2.0)
    assert item.static
    assert ("struck", "table") in world.belief.supports()
    world.belief.set_fixture("table", TABLE, Pose((3.0, 0.0, -0.5)))
    world.run(1.0)
    assert world.belief.supports() == {}


def test_an_object_off_the_table_falls_to_the_floor() -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(1.0)
    world.seen = set()
    world.belief.set_fixture("table", (0.3, 0.3, 0.04), Pose((0.0, 0.0, -0.02)))
    world.run(1.5)
    assert world.pose("a").t[2] == pytest.approx(0.02 - world.belief.config.floor_below_table, abs=0.002)
    assert world.belief.supports() == {}


def test_a_table_that_is_moved_down_takes_what_is_seen_on_it_along() -> None:
    world = World({"a": cube_at(0.4, 0.1)})
    world.run(1.0)
    world.belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.12)))
    world.truths["a"] = cube_at(0.4, 0.1, -0.08)
    world.run(1.0)
    assert world.error("a") < 0.002
    assert ("a", "table") in world.belief.supports()


def test_what_was_believed_before_is_recalled() -> None:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.4, 0.1, 0.3)})
    world.belief.recall("a", world.truths["a"])
    world.belief.recall("b", world.truths["b"], held=True)
    world.seen = set()
    world.run(1.0)
    assert all(world.error(name) < 0.001 for name in world.truths)
    assert world.belief.plausible("a") and not world.belief.plausible("b")


@pytest.mark.parametrize("tilt", [0.05, 0.1, 0.2, 0.3])
def test_one_tilted_frame_does_not_upset_what_was_believed_before(tilt: float) -> None:
    world = World({"below": cube_at(0.35, 0.0), "top": cube_at(0.35, 0.0, 0.06)})
    for name, truth in world.truths.items():
        world.belief.recall(name, truth)
    world.seen = set()
    world.run(0.3)
    covariance = np.diag([3e-3**2] * 3 + [3e-4] * 3)
    tilted = Pose.from_rotvec((0.35, 0.0, 0.02), (0.0, tilt, 0.0)).with_covariance(covariance)
    world.see("below", tilted.with_stamp(world.now))
    world.run(0.5)
    assert all(world.error(name) < 0.001 for name in world.truths)


def test_what_cameras_see_flatly_tells_nothing_for_sure_of_what_is_seen_from_above() -> None:
    """All are seen 10 mm too near. Steep rays tell that; flat ones do not, and do not claim that there is no error."""
    sure = {}
    for eye in ((0.6, 0.3, 0.6), (1.6, 0.3, 0.15)):
        belief = Belief(BeliefConfig())
        belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
        for number, now in itertools.product(range(4), np.arange(0.1, 2.0, 0.1)):
            if now == 0.1:
                belief.add_object(f"cube_{number}", CUBE, mass=0.05)
            truth = cube_at(0.1 + 0.15 * number, 0.2)
            ray = np.subtract(truth.t, eye) / np.linalg.norm(np.subtract(truth.t, eye))
            seen = Pose(np.add(truth.t, -0.01 * ray), truth.q, now, np.diag([1e-3**2] * 3 + [1e-2**2] * 3))
            belief.observe([SeenObject(f"cube_{number}", seen, now, eye)])
        for now in np.arange(0.1, 2.0, 0.1):
            belief.step(float(now) + 2.0 - 1.9)
        known = [item.known_error() for item in belief._bodies.objects.values()]
        sure[eye] = [error.metres for error in known if error is not None]
        belief.close()
    steep, flat = sure.values()
    assert steep == [pytest.approx(-0.01, abs=0.002)] * 4 and flat == []


def test_what_is_seen_again_elsewhere_is_likeliest_there_from_the_first_percept_on() -> None:
    world = World({"a": cube_at(0.4, 0.1), "b": cube_at(0.3, -0.1)})
    world.run(2.0)
    world.seen = set()
    world.run(3.0)
    world.truths["a"], world.seen = cube_at(0.5, 0.2), {"a", "b"}
    for _ in range(3):
        world.run(2.0 * PERIOD)
        assert math.dist(likeliest(world.belief, "a").t, world.truths["a"].t) < 0.02
        assert math.dist(likeliest(world.belief, "b").t, world.truths["b"].t) < 0.005


def test_what_rests_elsewhere_is_likeliest_there_before_it_is_explained() -> None:
    belief = Belief(BeliefConfig())
    belief.set_fixture("table", TABLE, Pose((0.35, 0.0, -0.02)))
    belief.add_object("a", CUBE, mass=0.05)
    explained = []
    for tick in range(1, 40):
        there = cube_at(0.4, 0.1 if tick < 20 else 0.2)
        belief.observe([SeenObject("a", there, PERIOD * tick)])
        belief.step(PERIOD * tick)
        explained += belief.explanations()
        if tick > 25 and not explained:
            assert math.dist(likeliest(belief, "a").t, there.t) < 0.01
            pose = belief.pose("a")
            assert pose is not None and math.dist(pose.t, there.t) > 0.05
    assert explained


def test_removed_objects_are_gone_and_unknown_ones_an_error() -> None:
    belief = Belief()
    belief.add_object("cube_1", CUBE)
    with pytest.raises(SimulationError, match="'cube_1' is already"):
        belief.add_object("cube_1", CUBE)
    assert "cube_1" in belief and belief.pose("cube_1") is None
    belief.remove("cube_1")
    assert belief.names == ()
    problems = belief.observe([SeenObject("cube_1", cube_at(0.4, 0.1), 1.0)])
    assert problems == {"cube_1": "no object 'cube_1' in the belief"}
    belief.close()


def test_the_believed_pose_has_a_covariance_that_covers_its_error() -> None:
    world = World(grid(4, 6), seed=6)
    world.run(3.0)
    for name, truth in world.truths.items():
        pose = world.pose(name)
        error = pose.rotation_matrix.T @ (pose.translation - truth.translation)
        assert pose.covariance is not None
        assert error @ np.linalg.solve(pose.covariance[:3, :3], error) < 16.0
        assert np.sqrt(np.trace(pose.covariance[:3, :3])) < 0.003, "where the newest percept is off, it may be wider"
