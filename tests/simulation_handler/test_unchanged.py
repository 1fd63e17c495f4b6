"""What rests where it was put, among what has not moved, is not placed anew at each percept."""

from __future__ import annotations

from collections import Counter

import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.contact.placement import separate
from simulation_handler.motion import correction
from simulation_handler.scales import GAP
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import CUBE, SyntheticCamera, World, cube_at


@pytest.fixture
def placed(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often each object was placed anew."""
    counts: Counter[str] = Counter()
    place = correction.place

    def counting(percept: Solid, *args: object) -> correction.Placement:
        counts[percept.name] += 1
        return place(percept, *args)  # type: ignore[arg-type]

    monkeypatch.setattr(correction, "place", counting)
    return counts


def _deviation(world: World, name: str) -> float:
    placement = world.belief._bodies.objects[name].placement
    assert placement is not None
    return float(placement.covariance[0, 0])


def test_what_rests_is_placed_anew_seldom_and_known_ever_better(placed: Counter[str]) -> None:
    world = World({"cube_1": cube_at(0.3, 0.1), "cube_2": cube_at(0.3, -0.1)})
    world.run(4.0)
    placed.clear()
    before = _deviation(world, "cube_1")
    world.run(2.0)
    assert 1 <= placed["cube_1"] <= 8, "of twenty percepts"
    assert _deviation(world, "cube_1") < 0.8 * before


def test_how_well_a_place_is_known_follows_from_the_scatter_of_its_percepts() -> None:
    """All cameras state the same noise, so only the scatter tells that percepts err by more or by less."""
    quiet, loud = (World({"cube_1": cube_at(0.3, 0.1)}) for _ in range(2))
    for world, amplitude in ((quiet, 0.0), (loud, 1.5)):
        world.camera = _ScatteringCamera(amplitude)
        world.run(4.0)
    assert _deviation(loud, "cube_1") > 3.0 * _deviation(quiet, "cube_1")


class _ScatteringCamera(SyntheticCamera):
    """Errs by a multiple of the noise that it states."""

    def __init__(self, amplitude: float) -> None:
        super().__init__(bias=(0.0, 0.0))
        self.amplitude = amplitude

    def percept(self, name: str, truth: Pose, stamp: float) -> Pose:
        told = super().percept(name, truth, stamp)
        there = truth.translation + self.amplitude * (told.translation - truth.translation)
        return Pose(there, told.q, stamp, told.covariance)


def test_of_what_stays_percepts_have_told_that_it_rests(placed: Counter[str]) -> None:
    world = World({"cube_1": cube_at(0.3, 0.1)})
    world.run(4.0)
    placed.clear()
    item = world.belief._bodies.objects["cube_1"]
    item.is_told_to_rest = True
    world.run(0.1)
    assert not placed and not item.is_told_to_rest


def test_what_stands_on_something_is_placed_anew_when_that_has_moved(placed: Counter[str]) -> None:
    world = World({"low": cube_at(0.3, 0.0), "high": cube_at(0.3, 0.0, 0.06), "far": cube_at(0.3, 0.3)})
    world.run(4.0)
    placed.clear()
    world.truths |= {"low": cube_at(0.304, 0.0), "high": cube_at(0.304, 0.0, 0.06)}
    world.run(2.0)
    assert placed["high"] > placed["far"]
    assert world.belief.supports().keys() == {("low", "table"), ("high", "low"), ("far", "table")}
    for name in ("low", "high"):
        pose = world.belief.pose(name)
        assert pose is not None and abs(pose.t[0] - 0.304) < 0.002


def test_only_what_was_placed_and_what_it_is_pushed_into_gives_way() -> None:
    solids = [Solid(name, CUBE, (x, 0.0, 0.02)) for name, x in (("a", 0.0), ("b", 0.038), ("c", 0.079), ("d", 0.3))]
    solids.append(Solid("e", CUBE, (0.338, 0.0, 0.02)))
    weights = dict.fromkeys("abcde", 1.0)
    assert separate(solids, weights).keys() == set("abcde")
    pushed = separate(solids, weights, {"a"})
    assert pushed.keys() == set("abc")
    assert all(pushed[name] == there for name, there in separate(solids[:3], weights).items())
    assert separate(solids, weights, ()) == {}


def test_what_was_removed_is_forgotten() -> None:
    world = World({"cube_1": cube_at(0.3, 0.1), "cube_2": cube_at(0.3, -0.1)})
    world.run(2.0)
    unchanged = world.belief._correction._unchanged
    assert unchanged._counts.keys() == {"cube_1", "cube_2"}
    world.belief.remove("cube_1")
    del world.truths["cube_1"]
    world.run(0.5)
    assert unchanged._counts.keys() == {"cube_2"}


def test_what_got_into_another_is_parted_while_a_third_is_seen() -> None:
    world = World({"left": cube_at(0.1, 0.1), "right": cube_at(0.2, 0.1), "seen": cube_at(-0.3, -0.2)})
    world.run(2.0)
    del world.truths["left"], world.truths["right"]
    world.run(2.0)
    bodies = world.belief._bodies
    (x, y, z), rotation = bodies.sim.pose("left")
    bodies.put(bodies.object("right"), (x + 0.034, y, z), rotation)
    for name in ("left", "right"):
        bodies.sim.make_static(name, True)
    world.run(0.3)
    assert bodies.sim.pose("right")[0][0] - bodies.sim.pose("left")[0][0] >= CUBE[0]


def test_a_body_that_trembles_is_where_it_was_and_one_that_creeps_is_not() -> None:
    before = Solid("cube", CUBE, (0.3, 0.1, 0.02))
    creeping = [before.moved((0.3 + share * GAP, 0.1, 0.02)) for share in (0.3, 0.6, 0.9, 1.2, 1.5)]
    assert [solid.is_at(before) for solid in creeping] == [True, True, True, False, False]
    assert not before.turned(Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.002)).q).is_at(before)
    assert not Solid("other", CUBE, before.position).is_at(before)
    assert not Solid("cube", (0.04, 0.04, 0.05), before.position).is_at(before)


def test_a_pose_is_read_once_until_physics_goes_on() -> None:
    world = World({"cube_1": cube_at(0.3, 0.1)})
    world.run(2.0)
    sim = world.belief._bodies.sim
    position, rotation = before = sim.pose("cube_1")
    assert sim.pose("cube_1") is before
    sim.place("cube_1", (position[0], position[1], position[2] + 0.1), rotation)
    lifted = sim.pose("cube_1")
    assert lifted[0][2] == pytest.approx(position[2] + 0.1)
    handle = sim.snapshot()
    sim.step(10)
    assert sim.pose("cube_1")[0][2] < lifted[0][2] - 0.001
    sim.restore(handle)
    assert sim.pose("cube_1") == lifted
