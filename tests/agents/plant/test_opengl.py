"""What OpenGL draws is what the physics engine's own renderer draws: places, depths, bodies and colours."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest

from agents.plant.bullet import Bullet
from agents.plant.hand_body import NOWHERE, HandBody
from agents.plant.hand_figure import relaxed
from agents.plant.looks import read_painted
from agents.plant.renderer import RenderedPicture, Renderer, opengl_works
from agents.plant.robot_file import load_body
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics

pytestmark = pytest.mark.skipif(not opengl_works(), reason="OpenGL does not work here")

ROBOTS = Path(__file__).parents[3] / "etc" / "robots"
INTRINSICS = Intrinsics.from_fov(160, 120, 1.1)
BEFORE = Pose((1.6, 0.3, 0.5), (-0.5, -0.5, 0.5, 0.5))
"""world_from_camera of one that looks along -x, with z upwards in its image."""
ABOVE = Pose((0.0, 0.3, 1.8), (1.0, 0.0, 0.0, 0.0))
ROUND = 0.005
"""m, by which two approximations of something round may differ."""
EDGES = 0.06
"""1, share of the pixels of what is shown that may differ: those at its edges."""
CUBE = """<robot name="cube"><link name="base">
  <inertial><origin xyz="0.02 0 0.3" rpy="0 0 0.7"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <visual><origin xyz="0 0 0.4" rpy="0.5 0 0"/><geometry><mesh filename="wedge.obj" scale="0.5 1 2"/></geometry>
    <material name="red"><color rgba="1 0 0 1"/></material></visual>
</link></robot>"""
WEDGE = "v 0 0 0\nv 0.4 0 0\nv 0 0.4 0\nv 0 0 0.2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


@pytest.fixture
def clients() -> Iterator[tuple[Bullet, Renderer, Bullet, Renderer]]:
    """A physics client that is drawn by OpenGL, and one that is drawn by its own renderer."""
    one, other = Bullet(), Bullet()
    drawn, own = Renderer(one, "opengl"), Renderer(other, "tiny")
    assert (drawn.name, own.name) == ("opengl", "tiny")
    yield one, drawn, other, own
    for part in (drawn, own, one, other):
        part.close()


def alike(drawn: RenderedPicture, own: RenderedPicture) -> None:
    """Both show the same bodies at the same depths but for edges, and something at all."""
    assert drawn.bodies is not None and own.bodies is not None
    shown = own.bodies >= 0
    assert shown.mean() > 0.01
    assert (drawn.bodies != own.bodies).sum() <= EDGES * shown.sum()
    both = shown & (drawn.bodies >= 0)
    assert np.mean(np.abs(drawn.depth - own.depth)[both] > ROUND) < EDGES
    assert np.abs(drawn.color[both].astype(int) - own.color[both]).mean() < 25


@pytest.mark.parametrize("robot", sorted(file.stem for file in ROBOTS.glob("*.urdf")))
@pytest.mark.parametrize("camera", [BEFORE, ABOVE], ids=["before", "above"])
def test_robots(clients: tuple[Bullet, Renderer, Bullet, Renderer], robot: str, camera: Pose) -> None:
    one, drawn, other, own = clients
    for bullet in (one, other):
        body = load_body(bullet, ROBOTS / f"{robot}.urdf", Pose((0.0, 0.3, 0.0), (0.0, 0.0, 0.6, 0.8)))
        for joint in range(bullet.getNumJoints(body)):
            bullet.resetJointState(body, joint, 0.3)
    alike(drawn.render(camera, INTRINSICS, bodies=True), own.render(camera, INTRINSICS, bodies=True))


def test_a_mesh_is_scaled_and_placed_and_the_centre_of_mass_may_be_anywhere(
    clients: tuple[Bullet, Renderer, Bullet, Renderer], tmp_path: Path
) -> None:
    one, drawn, other, own = clients
    (tmp_path / "cube.urdf").write_text(CUBE)
    (tmp_path / "wedge.obj").write_text(WEDGE)
    for bullet in (one, other):
        load_body(bullet, tmp_path / "cube.urdf", Pose((0.0, 0.3, 0.0)))
    for camera in (BEFORE, ABOVE):
        alike(drawn.render(camera, INTRINSICS, bodies=True), own.render(camera, INTRINSICS, bodies=True))
    color = drawn.render(BEFORE, INTRINSICS).color
    assert (color[..., 0] > 150).all() and (color[..., 1] == 0).sum() > 50, "it is red"


def test_a_number_that_is_used_again_shows_the_new_body(clients: tuple[Bullet, Renderer, Bullet, Renderer]) -> None:
    bullet, drawn, _, _ = clients
    shown = []
    for size in (0.1, 0.2):
        visual = bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=[size] * 3)
        body = bullet.create_body(0.0, -1, visual, (0.0, 0.3, 0.5))
        shown.append((body, (drawn.render(BEFORE, INTRINSICS, bodies=True).bodies == body).sum()))
        bullet.remove_body(body)
    assert (drawn.render(BEFORE, INTRINSICS, bodies=True).bodies == -1).all()
    assert shown[0][0] == shown[1][0], "the engine gives the number again"
    assert 3.5 * shown[0][1] < shown[1][1]


def test_figures_of_a_hand_leave_nothing_behind(clients: tuple[Bullet, Renderer, Bullet, Renderer]) -> None:
    bullet, drawn, other, own = clients
    looks = bullet.looks
    assert looks is not None
    hands = [HandBody(client, "right") for client in (bullet, other)]
    forearm = (np.array((0.0, 0.2, 0.5)), np.array((0.0, 0.0, 0.5)))
    for k in range(8):
        for hand in hands:
            hand.put(Pose((0.0, 0.3, 0.5)), relaxed("right") + 0.004 * k, forearm)
        alike(drawn.render(ABOVE, INTRINSICS, bodies=True), own.render(ABOVE, INTRINSICS, bodies=True))
    assert len(looks.bodies) == bullet.getNumBodies() == 5, "four figures and a sleeve"
    assert not looks._files
    hands[0].put(NOWHERE, relaxed("right"), forearm)


def test_an_obj_file_without_normals_and_pictures(tmp_path: Path) -> None:
    file = tmp_path / "wedge.obj"
    file.write_text(f"# a comment\n\no wedge\n{WEDGE}")
    painted = read_painted(file)
    assert painted.corners.shape == (12, 8) and painted.picture.tolist() == [[[255, 255, 255]]]
    assert painted.corners[:3, 3:6].tolist() == [[0, 0, -1]] * 3
    assert np.linalg.norm(painted.corners[:, 3:6], axis=1) == pytest.approx(1.0)


def test_a_number_is_used_again_at_the_same_place_and_what_is_invisible_is_not_drawn(
    clients: tuple[Bullet, Renderer, Bullet, Renderer],
) -> None:
    bullet, drawn, _, _ = clients
    for color, shown in (((1.0, 0.0, 0.0, 1.0), 0), ((0.0, 1.0, 0.0, 1.0), 1)):
        visual = bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=[0.1] * 3, rgbaColor=color)
        body = bullet.create_body(0.0, -1, visual, (0.0, 0.3, 0.5))
        picture = drawn.render(BEFORE, INTRINSICS, bodies=True)
        there = picture.color[picture.bodies == body]
        assert len(there) > 100 and there[:, shown].all() and not there[:, 1 - shown].any()
        bullet.remove_body(body)
    hidden = bullet.createVisualShape(pybullet.GEOM_BOX, halfExtents=[0.1] * 3, rgbaColor=(1.0, 0.0, 0.0, 0.0))
    bullet.create_body(0.0, -1, hidden, (0.0, 0.3, 0.5))
    plane = bullet.createVisualShape(pybullet.GEOM_PLANE, planeNormal=(0.0, 0.0, 1.0))
    bullet.create_body(0.0, -1, plane, (0.0, 0.0, 0.0))
    assert (drawn.render(BEFORE, INTRINSICS, bodies=True).bodies == -1).all()
