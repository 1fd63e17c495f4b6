"""Bodies that are no boxes: in the simulator, in placements, in rollouts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dsr.math3d.quaternions import Vector3
from dsr.math3d.shapes import Part, Shape
from dsr.math3d.transforms import Pose
from simulation_handler.config import BeliefConfig
from simulation_handler.contact.placement import find_support, place, separate
from simulation_handler.physics.rollouts import RolloutBody, RolloutScene
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.messages import RolloutJob, _encoder, _jobs
from simulation_handler.physics.simulator import SimulationError, Simulator
from simulation_handler.shapes.geometry import Solid
from tests.simulation_handler.worlds import BALL, CUBE, ROUND, container

TABLE = Solid("table", (1.2, 1.2, 0.04), (0.0, 0.0, -0.02), fixed=True)
BOX = (0.17, 0.17, 0.15)
NOISE = np.diag((1e-6, 1e-6, 1e-5))
CONFIG = BeliefConfig()


def box(x: float, y: float, z: float = 0.075, *, upside_down: bool = False, name: str = "box") -> Solid:
    return Solid(name, BOX, (x, y, z), shape=container(BOX, upside_down=upside_down))


def cube(x: float, y: float, z: float = 0.02) -> Solid:
    return Solid("cube", CUBE, (x, y, z))


def settled(sim: Simulator, seconds: float = 3.0) -> None:
    sim.step(round(240 * seconds))


def test_a_cube_falls_into_a_container_and_stays_there(table: Simulator) -> None:
    table.add_body("box", BOX, container(BOX), (0.0, 0.0, 0.075), mass=0.2)
    table.add_box("cube", CUBE, (0.03, 0.0, 0.2), mass=0.05)
    settled(table)
    assert table.position("cube")[2] == pytest.approx(0.023, abs=1e-3)
    assert table.position("box") == pytest.approx((0.0, 0.0, 0.075), abs=2e-3)


def test_a_container_upside_down_does_not_push_what_is_under_it(table: Simulator) -> None:
    table.add_box("cube", CUBE, (0.01, 0.02, 0.02), mass=0.05)
    table.add_body("box", BOX, container(BOX, upside_down=True), (0.0, 0.0, 0.075), mass=0.2)
    settled(table)
    assert table.position("cube") == pytest.approx((0.01, 0.02, 0.02), abs=1e-4)
    assert table.position("box") == pytest.approx((0.0, 0.0, 0.075), abs=1e-3)


def test_a_ball_that_is_pushed_comes_to_rest(table: Simulator) -> None:
    turned = Pose.from_rotvec((0, 0, 0), (0.3, 0.2, 0.1)).q
    table.add_body("ball", BALL, ROUND, (-0.02, 0.0, 0.075), turned, mass=0.05, friction=0.7)
    table.add_box("ramp", (0.2, 0.2, 0.02), (0.0, 0.0, 0.02), Pose.from_rotvec((0, 0, 0), (0.0, 0.25, 0.0)).q)
    settled(table, 6.0)
    x, _, z = table.position("ball")
    assert 0.1 < x < 0.4
    assert z == pytest.approx(0.03, abs=1e-3)
    assert table.speed("ball") == pytest.approx((0.0, 0.0), abs=1e-3)


def test_a_ball_rolls_as_far_as_its_rolling_friction_lets_it(table: Simulator) -> None:
    travelled = {}
    for name, rolling_friction, y in (("easy", 0.002, -0.1), ("usual", None, 0.0), ("stiff", 0.02, 0.1)):
        table.add_body(name, BALL, ROUND, (-0.1, y, 0.03), mass=0.05, friction=0.7, rolling_friction=rolling_friction)
        table.set_velocity(name, (0.2, 0.0, 0.0), (0.0, 0.2 / 0.03, 0.0))
    settled(table, 3.0)
    for name in ("easy", "usual", "stiff"):
        travelled[name] = table.position(name)[0] + 0.1
    assert travelled["easy"] > 3.0 * travelled["usual"] > 3.0 * travelled["stiff"] > 0.0


def test_a_body_that_pybullet_cannot_make_is_refused(table: Simulator) -> None:
    with pytest.raises(SimulationError, match="17 pieces"):
        table.add_body("odd", CUBE, ROUND * 17, (0.0, 0.0, 0.0))


def test_a_solid_is_made_of_its_pieces() -> None:
    turned = box(0.3, 0.2).at((0.3, 0.2, 0.1), Pose.from_rotvec((0, 0, 0), (0, 0, math.pi / 2)).q)
    bottom, *walls = turned.parts
    assert bottom.position == pytest.approx((0.3, 0.2, 0.1 - 0.0735))
    assert sorted(round(wall.position[1] - 0.2, 4) for wall in walls) == [-0.0835, 0.0, 0.0, 0.0835]
    assert cube(0.0, 0.0).parts == (cube(0.0, 0.0),)


def test_a_ball_is_never_tilted_and_round_from_above() -> None:
    ball = Solid("ball", BALL, (0.1, 0.2, 0.05), Pose.from_rotvec((0, 0, 0), (0.7, 0.5, 0.1)).q, shape=ROUND)
    assert ball.face_down()[1] == 0.0
    assert (ball.bottom, ball.top) == pytest.approx((0.02, 0.08))
    assert max(math.dist(point, (0.1, 0.2)) for point in ball.footprint) == pytest.approx(0.03)
    placement = place(ball, NOISE, [TABLE], CONFIG)
    assert placement.supports == ("table",)
    assert placement.solid.position[2] == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("solid", "hollow"),
    [(box(0, 0), True), (cube(0, 0), False), (Solid("ball", BALL, (0, 0, 0), shape=ROUND), False)],
)
def test_what_has_room_in_its_middle_is_hollow(solid: Solid, hollow: bool) -> None:
    assert solid.is_hollow is hollow


def test_a_cube_in_a_container_rests_on_its_bottom() -> None:
    placement = place(cube(0.03, 0.0, 0.031), NOISE, [TABLE, box(0.0, 0.0)], CONFIG)
    assert placement.supports == ("box",)
    assert placement.solid.position[2] == pytest.approx(0.023)


def test_a_container_over_a_cube_stands_on_the_table() -> None:
    percept = box(0.0, 0.0, 0.084, upside_down=True)
    placement = place(percept, NOISE, [TABLE, cube(0.02, 0.0)], CONFIG)
    assert placement.supports == ("table",)
    assert placement.solid.position[2] == pytest.approx(0.075)


def test_a_container_held_over_a_cube_is_not_lifted_by_its_bounding_box() -> None:
    percept = box(0.0, 0.0, 0.105, upside_down=True)
    placement = place(percept, NOISE, [TABLE, cube(0.02, 0.0)], CONFIG)
    assert not placement.rests
    assert placement.solid.position == percept.position


def test_what_is_inside_is_pushed_away_by_walls_alone() -> None:
    solids = [TABLE, box(0.0, 0.0, upside_down=True), cube(0.02, 0.0)]
    assert separate(solids, {"cube": 1.0, "box": 1.0}) == {}
    pushed = separate([*solids[:2], cube(0.0645, 0.0)], {"cube": 1.0})
    assert pushed["cube"][0] == pytest.approx(0.085 - 0.003 - 0.02, abs=1e-4)


def test_the_rim_of_a_container_does_not_carry_what_stands_beside_its_middle() -> None:
    supports, level = find_support(cube(0.0, 0.0, 0.17), 0.15, [TABLE, box(0.0, 0.0)], 0.01)
    assert (supports, level) == ((), None)


def scene(shape: Shape, size: Vector3) -> RolloutScene:
    return RolloutScene(
        (
            RolloutBody("table", TABLE.size, TABLE.position, fixed=True),
            RolloutBody("box", size, (0.0, 0.0, 0.5 * size[2]), mass=0.2, shape=shape),
            RolloutBody("ball", BALL, (0.0, 0.0, 0.05), mass=0.05, shape=ROUND),
        )
    )


def test_rollouts_know_shapes_and_send_them_to_workers() -> None:
    inside = scene(container(BOX), BOX)
    engine = Engine()
    outcomes = [engine.run(inside, 1.0) for _ in range(2)]
    engine.close()
    assert outcomes[0] == outcomes[1]
    assert outcomes[0].poses["ball"][0][2] == pytest.approx(0.033, abs=1e-3)
    assert _jobs.decode(_encoder.encode(RolloutJob(1, inside.bodies, 1.0))).bodies == inside.bodies


def test_pieces_may_be_of_several_kinds(table: Simulator) -> None:
    shape = (Part("cylinder", (0.07, 0.07, 0.09)), Part("box", (0.02, 0.01, 0.04), (0.04, 0.0, 0.0)))
    table.add_body("mug", (0.09, 0.07, 0.09), shape, (0.0, 0.0, 0.06), mass=0.1)
    settled(table)
    assert table.position("mug")[2] == pytest.approx(0.045, abs=2e-3)
