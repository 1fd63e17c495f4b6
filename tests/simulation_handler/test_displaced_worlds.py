"""Weighted worlds of things that are seen displaced: in some their camera moved, in others they did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from dsr.math3d.transforms import Pose
from simulation_handler.belief import Belief
from simulation_handler.perception.bumped import MovedThing
from simulation_handler.perception.percepts import SeenObject
from simulation_handler.shapes.geometry import Solid
from simulation_handler.worlds.circumstances import DOUBTED, MOVES, RESTLESS
from simulation_handler.worlds.displaced import staying
from simulation_handler.worlds.evidence import Evidence, ObjectEvidence
from simulation_handler.worlds.followed import PERCEIVED
from simulation_handler.worlds.model import WeightedWorld
from simulation_handler.worlds.parameters import learned_parameters
from simulation_handler.worlds.weighted import WeightedWorlds

CAMERA, EYE = "camera", (0.3, -1.0, 0.8)
PLACES = {"box": (0.2, -0.2, 0.02), "can": (0.55, -0.1, 0.02), "cup": (0.25, 0.25, 0.02), "jug": (0.5, 0.3, 0.02)}
BUMP = Pose(EYE) @ Pose.from_rotvec((0.01, -0.015, 0.012), (0.02, -0.03, 0.025)) @ Pose(EYE).inverse()
SHOVE = Pose((0.05, 0.03, 0.0))
NOISE = np.diag([0.003**2] * 3 + [0.02**2] * 3)
STEP = 0.1
MOVED = MovedThing(0.16, 0.002)


def thing(name: str, believed: Pose, percept: Pose) -> ObjectEvidence:
    """A thing that one camera sees."""
    seen = percept.with_covariance(NOISE)
    return ObjectEvidence(
        solid=Solid(name, (0.04, 0.04, 0.04), believed.t, believed.q),
        believed=believed.with_covariance(0.1 * NOISE),
        velocity=(0.0, 0.0, 0.0),
        percept=seen,
        is_recognised=True,
        agreeing=10,
        is_moving=believed.distance(percept)[0] > 0.01,
        seen=seen,
        seen_by=frozenset({CAMERA}),
        seen_from=EYE,
    )


class Table:
    """Four things that rest until 1 s."""

    def __init__(self) -> None:
        self.worlds = WeightedWorlds(learned_parameters())
        self.now = 0.0
        self.believed = {name: Pose(place) for name, place in PLACES.items()}
        self.percepts = dict(self.believed)
        self.run(1.0)

    def run(self, seconds: float, changed: Mapping[str, object] | None = None) -> None:
        """Let time pass, while all evidence is `changed`."""
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            told = {
                name: thing(name, pose, self.percepts[name].with_stamp(self.now))
                for name, pose in self.believed.items()
            }
            objects = {name: replace(one, **(changed or {})) for name, one in told.items()}  # type: ignore[arg-type]
            self.worlds.update(Evidence(self.now, objects, {}, None, frozenset()))

    def displace(self, motion: Pose, *names: str) -> None:
        """Let some things be seen elsewhere from now on."""
        self.percepts |= {name: motion @ self.believed[name] for name in names}

    def best(self, name: str) -> WeightedWorld:
        return self.worlds.worlds(name)[0]

    def error(self, name: str, place: Pose) -> float:
        """Metres from a place to the best guess."""
        pose = self.best(name).objects[name].pose
        assert pose is not None
        return float(pose.distance(place)[0])

    def chance(self, name: str, camera: str) -> float:
        """Probability that a camera moved, and the thing did not."""
        return sum(world.weight for world in self.worlds.worlds(name) if camera in world.moved_cameras)


@pytest.fixture
def table() -> Table:
    return Table()


def test_what_a_moved_camera_shows_elsewhere_is_where_it_was_from_the_first_percept_on(table: Table) -> None:
    table.displace(BUMP, *PLACES)
    table.run(STEP)
    for name, place in PLACES.items():
        assert table.best(name).reason == DOUBTED and table.error(name, Pose(place)) < 0.001
        assert table.chance(name, CAMERA) > 0.99
        assert sum(world.weight for world in table.worlds.worlds(name)) == pytest.approx(1.0)


def test_what_is_seen_displaced_among_things_that_are_not_may_be_where_it_is_seen(table: Table) -> None:
    table.displace(SHOVE, "box")
    table.run(STEP)
    assert table.chance("box", CAMERA) < 0.01
    assert table.best("box").reason in (RESTLESS, "as perceived")
    assert all(table.best(name).reason == "rests in view" for name in PLACES if name != "box")


def test_a_thing_that_moved_beside_a_moved_camera_is_told_apart(table: Table) -> None:
    table.displace(BUMP, "can", "cup", "jug")
    table.displace(BUMP @ SHOVE, "box")
    table.run(STEP)
    assert table.chance("box", CAMERA) < 0.01
    assert table.chance("can", CAMERA) > 0.99


def followed(table: Table) -> None:
    """The camera moves, and the simulation follows what it shows."""
    table.displace(BUMP, *PLACES)
    table.run(0.5)
    table.believed = dict(table.percepts)
    table.run(0.5)


def test_the_camera_may_have_moved_though_the_simulation_has_followed_it(table: Table) -> None:
    followed(table)
    for name, place in PLACES.items():
        assert table.error(name, Pose(place)) < 0.001 and table.chance(name, CAMERA) > 0.99


@pytest.mark.parametrize("changed", [{"driven": True}, {"hand": "hand"}, {"seen_from": (0.3, -1.0, 0.9)}])
def test_that_ends_once_things_move_or_it_is_known_where_the_camera_is(
    table: Table, changed: Mapping[str, object]
) -> None:
    followed(table)
    table.run(STEP, changed)
    table.run(STEP)
    assert all(table.chance(name, CAMERA) == 0.0 for name in PLACES)


def test_what_is_driven_has_moved_though_it_seemed_to_stay_when_it_was_seen_displaced_first(table: Table) -> None:
    table.displace(BUMP, *PLACES)
    table.run(STEP)
    assert table.chance("box", CAMERA) > 0.99
    table.believed = dict(table.percepts)
    table.run(STEP, {"driven": True, "is_moving": True})
    assert table.best("box").reason == MOVES and table.chance("box", CAMERA) == 0.0


def test_what_is_followed_bit_by_bit_is_where_it_was_before_all_of_it(table: Table) -> None:
    table.displace(BUMP, *PLACES)
    table.run(0.5)
    for share in (0.7, 0.95, 1.0):
        for name, place in PLACES.items():
            there = share * np.array(table.percepts[name].t) + (1.0 - share) * np.array(place)
            table.believed[name] = Pose(there, table.percepts[name].q)
        table.run(0.3, {"is_moving": share < 1.0})
    for name, place in PLACES.items():
        assert table.error(name, Pose(place)) < 0.001 and table.chance(name, CAMERA) > 0.99


def test_what_is_back_where_it_was_once_the_camera_has_a_new_pose_is_there(table: Table) -> None:
    """Seen by the new pose, all things are displaced from where the simulation has followed them to."""
    followed(table)
    found_out: Mapping[str, object] = {"seen_from": (0.31, -1.015, 0.812)}
    table.percepts = {name: Pose(place) for name, place in PLACES.items()}
    table.run(3.0, found_out)
    assert all(table.chance(name, CAMERA) == 0.0 for name in PLACES)
    table.believed = dict(table.percepts)
    table.run(1.0, found_out)
    for name, place in PLACES.items():
        assert table.error(name, Pose(place)) < 0.001 and table.chance(name, CAMERA) == 0.0


def test_what_turns_up_elsewhere_is_not_where_it_was_before_its_camera_moved(table: Table) -> None:
    followed(table)
    there = table.believed["box"] = table.percepts["box"] = Pose((0.7, 0.4, 0.02))
    table.run(STEP)
    assert table.error("box", there) < 0.001 and table.chance("box", CAMERA) == 0.0
    assert table.chance("can", CAMERA) > 0.99


def test_what_has_moved_again_is_not_where_it_was_before_its_camera_moved(table: Table) -> None:
    """From the first percept on, before the simulation has followed that."""
    followed(table)
    there = table.percepts["box"] = Pose((0.7, 0.4, 0.02))
    table.run(STEP)
    assert table.error("box", there) < 0.001 and table.chance("box", CAMERA) < 0.01
    assert table.chance("can", CAMERA) > 0.99


def test_what_a_camera_shows_that_is_known_not_to_have_moved_has_moved(table: Table) -> None:
    table.displace(BUMP, *PLACES)
    table.run(0.5)
    assert table.chance("box", CAMERA) > 0.99
    table.run(STEP, {"is_sure": True})
    assert all(table.best(name).reason in (RESTLESS, PERCEIVED) for name in PLACES)
    assert all(table.chance(name, CAMERA) == 0.0 for name in PLACES)


@pytest.mark.parametrize("standing", [frozenset(), frozenset({CAMERA})])
def test_the_belief_tells_which_things_are_seen_by_cameras_that_stand(standing: frozenset[str]) -> None:
    belief = Belief()
    belief.add_object("box", (0.04, 0.04, 0.04))
    belief.doubt_cameras((), standing=standing)
    for count in range(5):
        belief.observe([SeenObject("box", Pose(PLACES["box"]), 0.1 * count, EYE, CAMERA)])
        belief.step(0.1 * count)
    assert belief.evidence().objects["box"].is_sure == bool(standing)
    belief.close()


def test_what_stands_on_another_thing_tells_nothing_of_the_camera(table: Table) -> None:
    """Whoever moves a tray displaces all that is on it by one motion."""
    table.displace(SHOVE, *PLACES)
    own = dict.fromkeys(PLACES, True) | {"can": False, "cup": False, "jug": False}
    table.now += STEP
    told = {
        name: replace(
            thing(name, pose, table.percepts[name].with_stamp(table.now)), supports=() if own[name] else ("box",)
        )
        for name, pose in table.believed.items()
    }
    table.worlds.update(Evidence(table.now, told, {}, None, frozenset()))
    assert table.chance("box", CAMERA) < 0.1


@pytest.mark.parametrize("others", [frozenset[str](), frozenset({"wrist"})])
def test_what_several_cameras_see_tells_nothing_of_one(table: Table, others: frozenset[str]) -> None:
    table.displace(BUMP, *PLACES)
    table.run(STEP, {"seen_by": frozenset({CAMERA, *others})})
    assert (table.chance("box", CAMERA) > 0.99) == (not others)


def test_what_was_seen_at_another_time_tells_nothing_of_the_camera_now(table: Table) -> None:
    """Three things were not seen since before the bump: the fourth alone may as well have moved."""
    table.displace(BUMP, "box")
    table.now += STEP
    told = {
        name: thing(name, pose, table.percepts[name].with_stamp(table.now - (0.0 if name == "box" else 0.3)))
        for name, pose in table.believed.items()
    }
    together, alone = WeightedWorlds(learned_parameters()), WeightedWorlds(learned_parameters())
    for worlds, names in ((together, PLACES), (alone, ("box",))):
        worlds.update(Evidence(table.now, {name: told[name] for name in names}, {}, None, frozenset()))
    chances = [
        sum(world.weight for world in worlds.worlds("box") if world.moved_cameras) for worlds in (together, alone)
    ]
    assert chances[0] == pytest.approx(chances[1]) and chances[0] > 0.01


@pytest.mark.parametrize("beside", [False, True])
def test_what_has_lost_what_stood_beside_it_has_rather_fallen_than_its_camera_moved(beside: bool) -> None:
    place = Pose(PLACES["box"])
    fallen = thing("box", place, Pose((0.0, 0.0, -0.024)) @ place)
    away = Pose((0.05, 0.0, 0.0)) if beside else Pose((0.3, 0.0, 0.0))
    lost = replace(thing("can", away @ place, away @ place), is_recognised=False, is_missing=True)
    verdict = staying(Evidence(1.0, {"box": fallen, "can": lost}, {}, None, frozenset()), MOVED)["box"]
    assert (verdict.by_camera < 0.5) is beside
