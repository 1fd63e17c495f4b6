"""Robots of all kinds in the physics engine: where their links are, and how they grasp."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from agents.arm_controller.model.arm_model import ArmModel, load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import load_robot
from agents.plant.arm import SimulatedArm
from agents.plant.bullet import Bullet
from agents.plant.robot_file import load_body
from agents.scenario.format.scenario import ObjectSpec, RobotSpec
from dsr.errors import ConfigError
from dsr.files.built_in import ETC
from dsr.math3d.shapes import Part
from dsr.math3d.transforms import Pose

MakeCube = Callable[..., ObjectSpec]
MakeReality = Callable[..., Any]
Play = Callable[..., None]
OWN = sorted(ETC.glob("robots/*.urdf"))
DOWN = (1.0, 0.0, 0.0, 0.0)
GANTRY = """<robot name="gantry">
  <link name="base"/><link name="x"/><link name="bar"/><link name="hand"/>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="x"/><origin xyz="0 0.1 0.5" rpy="0.3 0 0.1"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1"/></joint>
  <joint name="swing" type="continuous"><parent link="x"/><child link="bar"/><axis xyz="0 0 1"/></joint>
  <joint name="level" type="revolute"><parent link="bar"/><child link="hand"/><origin xyz="0.4 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3"/><mimic joint="swing" multiplier="-1" offset="0.2"/></joint>
</robot>"""


def arms() -> list[Path]:
    package = find_spec("pybullet_data")
    assert package is not None and package.origin is not None
    return [*OWN, Path(package.origin).parent / "kuka_iiwa" / "model.urdf"]


def check_forward(model: ArmModel, file: Path, base: Pose, seed: int) -> None:
    """The tip is where the engine has it, and so is each link that moves."""
    bullet = Bullet()
    try:
        body = load_body(bullet, file, base)
        infos = [bullet.getJointInfo(body, index) for index in range(bullet.getNumJoints(body))]
        numbers = {info[1].decode(): info[0] for info in infos}
        links = {info[12].decode(): info[0] for info in infos}
        rng = np.random.default_rng(seed)
        chain = model.chain
        for _ in range(20):
            q = rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi))
            for joint, position in zip(chain.moving, chain.all_positions(q), strict=True):
                bullet.resetJointState(body, numbers[joint.name], position)
            found = chain.frames(q[None])[0]
            named = {joint.child: found[1 + index] for index, joint in enumerate(chain.moving)}
            for link, frame in {**named, model.tool: found[-1]}.items():
                expected = bullet.link_pose(body, links[link])
                assert (base @ Pose.from_matrix(frame)).distance(expected) == pytest.approx((0, 0), abs=2e-6), link
    finally:
        bullet.close()


@pytest.mark.parametrize("file", arms(), ids=lambda file: f"{file.parent.name}-{file.stem}")
def test_links_are_where_the_physics_engine_has_them(file: Path) -> None:
    check_forward(load_arm(file), file, Pose.from_rotvec((0.2, -0.1, 0.3), (0.0, 0.0, 0.7)), 1)


def test_links_that_slide_and_that_mimic_others_are_there_too(tmp_path: Path) -> None:
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    model = load_arm(tmp_path / "gantry.urdf", palm="hand")
    assert model.chain.names == ("slide", "swing")
    check_forward(model, tmp_path / "gantry.urdf", Pose.identity(), 2)


@pytest.mark.parametrize("file", OWN, ids=lambda file: file.stem)
def test_every_arm_grasps_carries_and_lets_go(
    file: Path, make_reality: MakeReality, cube: MakeCube, play: Play, send: Callable[..., None]
) -> None:
    model = load_arm(file)
    low = max(0.025, Figure(model).reach + 0.006)  # pads of a linkage reach lower the more they close
    rng = np.random.default_rng(0)
    start, lifted = (
        model.chain.inverse(Pose((0.32, 0.0, height), DOWN), model.home, rng=rng).positions for height in (low, 0.12)
    )
    reality = make_reality(cube(4, 0.32, 0.0), robot=RobotSpec(model=file.stem, start=start))
    arm, world = reality.arm, reality.world
    assert arm.opening == pytest.approx(arm.widest, abs=2e-3) and not arm.contact
    arm.move_gripper(0.0)
    play(reality, 2.0)
    assert arm.held == "cube_4" and arm.contact
    assert arm.opening == pytest.approx(0.04, abs=2e-3)
    send(arm, lifted)
    play(reality, 2.0)
    assert world.pose("cube_4").t == pytest.approx((0.32, 0.0, 0.14 - low), abs=0.006)
    arm.move_gripper(arm.widest)
    play(reality, 2.0)
    assert arm.held is None and not arm.contact
    assert world.pose("cube_4").t[2] == pytest.approx(0.02, abs=1e-3)


def test_the_bars_of_a_linkage_do_not_give_way_to_what_is_at_the_end_of_the_pads(
    make_reality: MakeReality, play: Play
) -> None:
    """A ball of 40 mm below the middle of the pads: those that lean would close to 30 mm."""
    model = load_arm(ETC / "robots" / "open_manipulator_p.urdf")
    start = model.chain.inverse(Pose((0.32, 0.0, 0.039), DOWN), model.home, rng=np.random.default_rng(0)).positions
    wide = (0.04, 0.04, 0.04)
    ball = ObjectSpec(name="ball", type="ball", size=wide, shape=(Part("sphere", wide),), position=(0.32, 0.0, 0.02))
    reality = make_reality(ball, robot=RobotSpec(model="open_manipulator_p", start=start))
    reality.arm.move_gripper(0.0)
    play(reality, 2.0)
    assert reality.arm.held == "ball"
    assert reality.arm.opening == pytest.approx(0.04, abs=2e-3)


def test_an_arm_stands_where_the_scenario_says_and_begins_at_home(make_reality: MakeReality) -> None:
    reality = make_reality(robot=RobotSpec(model="ur5e", position=(0.1, 0.4, 0.0), yaw=-1.5))
    model = load_arm(ETC / "robots" / "ur5e.urdf")
    assert reality.arm.positions == pytest.approx(model.home)
    expected = RobotSpec(position=(0.1, 0.4, 0.0), yaw=-1.5).base @ model.chain.forward(model.home)
    assert reality.arm.link_pose("tool_link").distance(expected) == pytest.approx((0, 0), abs=1e-5)


def test_a_robot_of_ones_own_comes_from_a_path_with_its_meshes(
    make_reality: MakeReality, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The forearm's box becomes a mesh; what is drawn only may be missing."""
    text = (ETC / "robots" / "gen3.urdf").read_text()
    box = '<geometry><box size="0.06 0.035 0.03"/></geometry>'
    drawn, collides = (f'<geometry><mesh filename="{name}.stl"/></geometry>' for name in ("gone", "b"))
    trimesh.creation.box((0.06, 0.035, 0.03)).export(tmp_path / "b.stl")
    (tmp_path / "mine.urdf").write_text(text.replace(box, drawn, 1).replace(box, collides, 1))
    assert load_robot(tmp_path / "mine.urdf").boxes["link_7"][-1].size == pytest.approx((0.06, 0.035, 0.03), abs=1e-6)
    with pytest.raises(ConfigError, match="needs joint positions to start at"):
        make_reality(robot=RobotSpec(model=str(tmp_path / "mine.urdf")))
    (tmp_path / "mine.srdf").write_text((ETC / "robots" / "gen3.srdf").read_text())
    reality = make_reality(robot=RobotSpec(model=str(tmp_path / "mine.urdf")))
    assert reality.arm.names == tuple(f"joint_{number}" for number in range(1, 8))
    assert "link 'link_7' is not drawn" in caplog.text


def test_what_cannot_be_simulated_is_refused(make_world: object, tmp_path: Path) -> None:
    world = make_world()  # type: ignore[operator]
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    with pytest.raises(ConfigError, match=r"gantry.urdf: the robot has 2 joints and fingers on 0 sides; expected"):
        SimulatedArm(world, tmp_path / "gantry.urdf", (0.0, 0.0))
