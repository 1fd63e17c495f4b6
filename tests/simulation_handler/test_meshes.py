"""Meshes in the simulation: their convex pieces fall, rest and carry like the bodies they are."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import dsr
from dsr.clock import WALL_CLOCK
from dsr.geometry import Mesh
from dsr.math3d.shapes import MOST_PARTS, bounds
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from simulation_handler import SimulationHandler
from simulation_handler.belief import Belief
from simulation_handler.physics.rollouts import RolloutBody, RolloutScene
from simulation_handler.physics.rollouts.engine import Engine
from simulation_handler.physics.rollouts.messages import RolloutJob, _encoder, _jobs
from simulation_handler.physics.simulator import Simulator
from simulation_handler.shapes.decomposing import decomposed
from simulation_handler.shapes.meshes import Forms, form_of
from tests.dsr.geometry.shapes import CORNERS, FACES
from tests.simulation_handler.worlds import CUBE


def block(size: tuple[float, ...], centre: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Mesh:
    return Mesh((np.array(CORNERS) - 0.5) * size + centre, FACES)


def together(*meshes: Mesh) -> Mesh:
    """One mesh of several pieces."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles.astype(int) + start for mesh, start in zip(meshes, first, strict=False)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(triangles))


def wedge(size: tuple[float, ...]) -> Mesh:
    """A ramp that rises along x."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 1, 0), (1, 1, 0), (1, 1, 1)]
    faces = [(0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (0, 2, 5), (0, 5, 3)]
    return Mesh((np.array(corners) - 0.5) * size, faces)


def bench() -> Mesh:
    """Two legs with a board on them, that leave room beneath."""
    legs = [block((0.02, 0.1, 0.1), (x, 0.0, 0.05)) for x in (-0.09, 0.09)]
    return together(*legs, block((0.2, 0.1, 0.02), (0.0, 0.0, 0.11)))


def cup(wall: float = 0.006) -> Mesh:
    """Open at the top, of one piece: 80 mm wide and 90 mm high; the bottom is as thick as the wall (m)."""
    inner, bottom = 0.04 - wall, wall - 0.045
    profile = np.array([(0.04, -0.045), (0.04, 0.045), (inner, 0.045), (inner, bottom)])
    angles = 2.0 * np.pi * np.arange(24) / 24
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(24, z)]) for r, z in profile]
    points = np.concatenate([*rings, [(0.0, 0.0, -0.045), (0.0, 0.0, bottom)]])
    around = [(k, (k + 1) % 24) for k in range(24)]
    faces = [face for n in range(3) for a, b in around for face in (
        (24 * n + a, 24 * n + b, 24 * n + 24 + b), (24 * n + a, 24 * n + 24 + b, 24 * n + 24 + a))]  # fmt: skip
    faces += [face for a, b in around for face in ((96, b, a), (97, 72 + a, 72 + b))]
    return Mesh(points, faces)


class TestForms:
    def test_each_connected_piece_is_a_part(self) -> None:
        form = form_of([bench()])
        assert len(form.shape) == 3 and form.is_true
        assert form.size == pytest.approx((0.2, 0.1, 0.12)) and form.centre == pytest.approx((0.0, 0.0, 0.06))
        low, high = bounds(form.shape)
        assert low == pytest.approx((-0.1, -0.05, -0.06)) and high == pytest.approx((0.1, 0.05, 0.06))

    def test_triangles_that_share_places_but_no_vertices_are_connected(self) -> None:
        mesh = block((1.0, 1.0, 1.0))
        soup = Mesh(mesh.vertices[mesh.triangles.ravel()], np.arange(36).reshape(-1, 3))
        assert len(form_of([soup]).shape) == 1

    def test_too_many_pieces_are_one_for_each_mesh_or_one_for_all(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("simulation_handler.shapes.meshes.decomposed", lambda *_: None)
        many = [block((0.01, 0.01, 0.01), (0.1 * k, 0.0, 0.0)) for k in range(MOST_PARTS + 1)]
        assert len(form_of([together(*many)]).shape) == 1
        assert len(form_of([together(*many[:9]), together(*many[9:])]).shape) == 2
        assert len(form_of(many).shape) == 1

    def test_what_is_round_has_few_corners(self) -> None:
        angle = np.random.default_rng(0).normal(size=(5000, 3))
        points = angle / np.linalg.norm(angle, axis=1)[:, None]
        form = form_of([Mesh(points, ConvexHull(points).simplices)])
        (part,) = form.shape
        assert 40 <= len(part.corners) <= 64 and part.size == pytest.approx((2.0, 2.0, 2.0), abs=0.02)

    def test_a_flat_one_is_thin(self) -> None:
        form = form_of([Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])])
        assert form.size == (1.0, 1.0, 0.001) and form.is_true

    def test_a_hollow_one_is_divided_and_always_alike(self) -> None:
        form = form_of([cup()])
        assert 4 <= len(form.shape) <= MOST_PARTS and form.is_true
        assert form_of([cup()]) == form

    @pytest.mark.parametrize("wall", [0.001, 0.006, 0.02])
    def test_however_thin_its_walls_it_is_found_hollow(self, wall: float, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("simulation_handler.shapes.meshes.decomposed", lambda *_: None)
        assert not form_of([cup(wall)]).is_true

    def test_what_is_convex_is_so_however_its_triangles_turn(self) -> None:
        mesh = block((1.0, 2.0, 3.0))
        turned = mesh.triangles.copy()
        turned[::2] = turned[::2, ::-1]
        form = form_of([Mesh(mesh.vertices, turned)])
        assert len(form.shape) == 1 and form.is_true

    def test_what_cannot_be_divided_is_told(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("simulation_handler.shapes.meshes.decomposed", lambda *_: None)
        form = form_of([cup()])
        assert len(form.shape) == 1 and not form.is_true
        assert form_of([block((1.0, 1.0, 1.0))]).is_true

    def test_a_program_that_fails_divides_nothing(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("simulation_handler.shapes.decomposing.sys.executable", "/bin/false")
        assert decomposed(np.eye(3), np.array([[0, 1, 2]]), 16) is None


def test_a_block_of_a_mesh_rests_as_a_box_does(table: Simulator) -> None:
    form = form_of([block(CUBE)])
    table.add_body("mesh", form.size, form.shape, (0.0, 0.0, 0.05), mass=0.05)
    table.add_box("box", CUBE, (0.0, 0.0, 0.12), mass=0.05)
    table.step(720)
    assert table.position("mesh") == pytest.approx((0.0, 0.0, 0.02), abs=5e-4)
    assert table.position("box") == pytest.approx((0.0, 0.0, 0.06), abs=1e-3)


def test_there_is_room_between_pieces(table: Simulator) -> None:
    form = form_of([bench()])
    table.add_box("cube", CUBE, (0.0, 0.0, 0.02), mass=0.05)
    table.add_body("bench", form.size, form.shape, (0.0, 0.0, 0.06), mass=0.5)
    table.add_box("top", CUBE, (0.0, 0.0, 0.15), mass=0.05)
    table.step(720)
    assert table.position("cube") == pytest.approx((0.0, 0.0, 0.02), abs=5e-4)
    assert table.position("bench") == pytest.approx((0.0, 0.0, 0.06), abs=1e-3)
    assert table.position("top")[2] == pytest.approx(0.14, abs=1.5e-3)


def test_a_ball_rolls_down_a_wedge_and_not_off_its_box(table: Simulator) -> None:
    form = form_of([wedge((0.2, 0.2, 0.1))])
    table.add_body("ramp", form.size, form.shape, (0.0, 0.0, 0.05))
    table.add_box("cube", CUBE, (0.05, 0.0, 0.12), Pose.from_rotvec((0, 0, 0), (0.0, -math.atan(0.5), 0.0)).q,
                  mass=0.05, friction=0.1)  # fmt: skip
    table.step(480)
    assert table.position("cube")[0] < -0.08


def test_rollouts_have_the_same_pieces_in_another_process() -> None:
    form = form_of([bench()])
    bodies = (
        RolloutBody("table", (1.0, 1.0, 0.02), (0.0, 0.0, -0.01), fixed=True),
        RolloutBody("bench", form.size, (0.0, 0.0, 0.06), mass=0.5, shape=form.shape),
        RolloutBody("cube", CUBE, (0.0, 0.0, 0.16), mass=0.05),
    )
    job = _jobs.decode(_encoder.encode(RolloutJob(1, bodies, 1.0)))
    assert job.bodies == bodies
    engine = Engine()
    first = engine.run(RolloutScene(job.bodies), 1.0)
    assert first.poses["cube"][0][2] == pytest.approx(0.14, abs=1.5e-3)
    assert engine.run(RolloutScene(bodies), 1.0) == first
    engine.close()


class Room:
    """A graph with a step on the floor; a cube is seen on it."""

    def __init__(self, mesh: Mesh, height: float = 0.05) -> None:
        self.lockstep = Lockstep([AgentSpec("simulation_handler", SimulationHandler, {})], strict=True)
        self.memory: Memory = self.lockstep.memory
        self.memory.add_node("world", "world")
        self.memory.add_node("table", "table", size=(1.0, 1.0, 0.04))
        self.memory.add_edge("world", "table", "RT", pose=Pose())
        self.memory.add_node("step", "object", mesh=self.memory.put_mesh(mesh))
        self.memory.add_edge("world", "step", "RT", pose=Pose((0.1, 0.0, height)))
        self.memory.add_node("camera", "camera")
        self.memory.add_edge("world", "camera", "RT", pose=Pose((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))

    def see(self, name: str, place: tuple[float, float, float], seconds: float) -> tuple[float, float, float]:
        """Have it seen there; where it is believed to be then."""
        for _ in range(round(seconds / 0.1)):
            camera = self.memory.transform("world", "camera")
            pose = (camera.inverse() @ Pose(place)).with_stamp(self.lockstep.clock.now())
            self.memory.add_edge("camera", name, "RT", pose=pose)
            self.lockstep.run_for(0.1)
        return self.memory.edge("world", name, "Virtual_RT").pose.t


@pytest.fixture
def room() -> Iterator[Room]:
    room = Room(block((0.2, 0.2, 0.1)))
    yield room
    room.lockstep.close()


def test_a_cube_rests_on_what_has_a_mesh(room: Room) -> None:
    room.memory.add_node("cube_1", "cube", size=CUBE, mass=0.05)
    assert room.see("cube_1", (0.1, 0.0, 0.126), 3.0) == pytest.approx((0.1, 0.0, 0.12), abs=2e-3)
    assert room.memory.get_edge("cube_1", "step", "on") is not None


def test_what_has_a_mesh_has_the_friction_that_its_node_tells(room: Room) -> None:
    room.memory.update_node("step", friction=0.3)
    room.lockstep.run_for(0.2)
    handler = room.lockstep.runner("simulation_handler").agent
    assert isinstance(handler, SimulationHandler) and isinstance(handler.belief, Belief)
    assert handler.belief._bodies.friction_of("step") == 0.3


def test_a_thing_with_a_mesh_falls_into_its_form(room: Room) -> None:
    mesh = bench()
    middle = Mesh(mesh.vertices - np.float32((0.0, 0.0, 0.06)), mesh.triangles)
    size = (0.2, 0.1, 0.12)
    room.memory.add_node("bench", "box", size=size, mass=0.5, mesh=room.memory.put_mesh(middle))
    assert room.see("bench", (-0.3, 0.0, 0.064), 3.0) == pytest.approx((-0.3, 0.0, 0.06), abs=2e-3)


def test_a_cube_falls_into_a_cup_and_stays_there(table: Simulator) -> None:
    form = form_of([cup()])
    table.add_body("cup", form.size, form.shape, (0.0, 0.0, 0.045), mass=0.2)
    table.add_box("die", (0.02, 0.02, 0.02), (0.0, 0.0, 0.12), mass=0.02)
    table.step(720)
    x, y, z = table.position("die")
    assert math.hypot(x, y) < 0.03 and z == pytest.approx(0.018, abs=0.004)
    assert table.position("cup") == pytest.approx((0.0, 0.0, 0.045), abs=2e-3)


def test_what_cannot_be_divided_is_left_out_and_told(
    room: Room, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simulation_handler.shapes.meshes.decomposed", lambda *_: None)
    room.memory.update_node("step", mesh=room.memory.put_mesh(cup()))
    room.lockstep.run_for(1.0)
    assert "too hollow" in caplog.text


def test_with_threads_forms_are_worked_out_beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with dsr.connect("forms", agent="modeller") as memory:
        node = memory.add_node("step", "object", mesh=memory.put_mesh(bench()))
        forms = Forms(memory)
        while (form := forms.of(node)) is None:
            WALL_CLOCK.wait(threading.Event(), 0.01)
        assert form == form_of([bench()])
        forms.close()


def test_what_has_a_mesh_hides_what_is_behind_it() -> None:
    room = Room(block((0.2, 0.2, 0.1)), height=0.3)
    intrinsics = {"fx": 600.0, "fy": 600.0, "cx": 160.0, "cy": 120.0, "width": 320, "height": 240}
    room.memory.update_node("camera", **intrinsics)
    for name, place in (("cube_1", (0.1, 0.0, 0.02)), ("cube_2", (-0.2, 0.0, 0.02))):
        room.memory.add_node(name, "cube", size=CUBE, mass=0.05)
        room.memory.add_edge("world", name, "Virtual_RT", pose=Pose(place))
    room.lockstep.run_for(0.5)
    assert room.memory.edge("camera", "cube_1", "sees")["hidden_by"] == "step"
    assert room.memory.edge("camera", "cube_2", "sees")["visible"] is True
    room.lockstep.close()


def test_meshes_that_nobody_has_harm_nothing(room: Room) -> None:
    room.memory.add_node("ghost", "object", mesh="0" * 64)
    room.memory.add_edge("world", "ghost", "RT", pose=Pose())
    room.memory.add_node("cube_1", "cube", size=CUBE, mass=0.05, mesh="nonsense")
    room.memory.add_node("cube_2", "cube", size=CUBE, mass=0.05, mesh="1" * 64)
    assert room.see("cube_2", (-0.3, 0.0, 0.024), 2.0) == pytest.approx((-0.3, 0.0, 0.02), abs=2e-3)
