"""Kinematics: known poses of the Gen3, laws of forward, Jacobian and inverse for several arms."""

from __future__ import annotations

import contextlib
import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from agents.arm_controller.model.kinematics import USUAL_SPEED, JointChain, UnreachableError
from agents.arm_controller.model.urdf import load_robot, parse_robot
from dsr.errors import ConfigError
from dsr.math3d import transforms
from dsr.math3d.transforms import Pose

ETC = Path(__file__).parents[3] / "etc"
OBSERVE = np.array((0.0, 0.0, math.pi, -0.96, 0.0, -2.1, math.pi / 2))
HOME = OBSERVE + 0.1 * np.eye(7)[5]  # within the limits: the observe pose is 0.01 rad beyond that of joint 6

GANTRY = b"""<robot name="gantry"><link name="base"/><link name="x"/><link name="y"/><link name="z"/>
  <link name="a"/><link name="b"/><link name="c"/><link name="tip"/>
  <joint name="jx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1"/></joint>
  <joint name="jy" type="prismatic"><parent link="x"/><child link="y"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1"/></joint>
  <joint name="jz" type="prismatic"><parent link="y"/><child link="z"/><axis xyz="0 0 -1"/>
    <limit lower="0" upper="1"/></joint>
  <joint name="ja" type="continuous"><parent link="z"/><child link="a"/><axis xyz="0 0 1"/></joint>
  <joint name="jb" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2"/></joint>
  <joint name="jc" type="continuous"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/></joint>
  <joint name="flange" type="fixed"><parent link="c"/><child link="tip"/><origin xyz="0.1 0 0" rpy="0 1 0"/></joint>
</robot>"""

PALLETISER = b"""<robot name="palletiser"><link name="base"/><link name="turret"/><link name="lower"/>
  <link name="upper"/>
  <link name="level"/><link name="tip"/>
  <joint name="yaw" type="continuous"><parent link="base"/><child link="turret"/><axis xyz="0 0 1"/></joint>
  <joint name="lean" type="revolute"><parent link="turret"/><child link="lower"/><origin xyz="0.1 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2"/></joint>
  <joint name="reach" type="revolute"><parent link="lower"/><child link="upper"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2"/><mimic joint="lean" multiplier="-1.5" offset="0.4"/></joint>
  <joint name="wrist" type="continuous"><parent link="upper"/><child link="level"/><origin xyz="0.6 0 0"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="flange" type="fixed"><parent link="level"/><child link="tip"/><origin xyz="0.1 0 0"/></joint>
</robot>"""


def panda() -> JointChain:
    package = find_spec("pybullet_data")
    if package is None or package.origin is None:
        pytest.skip("the Panda's URDF is not installed")
    robot = load_robot(Path(package.origin).parent / "franka_panda" / "panda.urdf")
    return JointChain(robot.between("panda_link0", "panda_hand"))


CHAINS = {
    "gen3": lambda: JointChain(load_robot(ETC / "robots" / "gen3.urdf").between("base_link", "tool_link")),
    "gantry": lambda: JointChain(parse_robot(GANTRY).between("base", "tip")),
    "palletiser": lambda: JointChain(parse_robot(PALLETISER).between("base", "tip")),
    "panda": panda,
}


@pytest.fixture(params=CHAINS)
def chain(request: pytest.FixtureRequest) -> JointChain:
    return CHAINS[request.param]()


def gen3(tip: str) -> JointChain:
    return JointChain(load_robot(ETC / "robots" / "gen3.urdf").between("base_link", tip))


def draw(chain: JointChain, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(np.maximum(chain.lower, -np.pi), np.minimum(chain.upper, np.pi))


def test_gen3_stands_upright_at_zero() -> None:
    assert gen3("end_effector_link").forward([0.0] * 7).t == pytest.approx((0.0, -0.02485, 1.187385), abs=1e-6)


def test_gen3_looks_down_at_its_observe_pose() -> None:
    pose = gen3("end_effector_link").forward(OBSERVE)
    assert pose.t == pytest.approx((0.271, 0.001, 0.719), abs=5e-4)
    assert pose.rotation_matrix[:, 2] == pytest.approx((0, 0, -1), abs=0.1)
    tool = gen3("tool_link").forward(OBSERVE)
    assert tool.t == pytest.approx(tuple(pose.apply((0, 0, 0.12))))


def test_wrist_camera_looks_along_the_hand_with_the_gripper_below_in_the_image() -> None:
    hand = gen3("end_effector_link").forward(OBSERVE)
    camera = gen3("camera_wrist_link").forward(OBSERVE)
    hand_from_camera = hand.inverse() @ camera
    assert hand_from_camera.t == pytest.approx((0.0, 0.05639, -0.00305))
    assert hand_from_camera.rotation_matrix == pytest.approx(np.diag((-1.0, -1.0, 1.0)), abs=1e-12)


def test_forward_is_the_product_of_the_joints() -> None:
    robot = load_robot(ETC / "robots" / "gen3.urdf")
    joints = robot.between("base_link", "tool_link")
    q = dict(zip((joint.name for joint in joints if joint.moves), draw(gen3("tool_link"), rng(3)), strict=True))
    product = Pose.identity()
    for joint in joints:
        product = product @ joint.pose(q.get(joint.name, 0.0))
    assert gen3("tool_link").forward(list(q.values())).distance(product) == pytest.approx((0, 0), abs=1e-7)


def test_a_joint_that_mimics_another_moves_with_it_and_within_both_limits() -> None:
    chain = CHAINS["palletiser"]()
    assert chain.names == ("yaw", "lean", "wrist")
    assert chain.all_positions((0.0, 0.2, 0.0)) == pytest.approx((0.0, 0.2, 0.1, 0.0))
    assert (chain.lower[1], chain.upper[1]) == pytest.approx((-1.0, 1.6))
    with pytest.raises(ConfigError, match="'reach' mimics 'lean', which is no joint on the way"):
        JointChain(parse_robot(PALLETISER).between("lower", "tip"))


@pytest.mark.parametrize(
    ("limits", "fastest"),
    [
        ({}, USUAL_SPEED),
        ({"lean": "0"}, USUAL_SPEED),  # as some descriptions say for none
        ({"lean": "3"}, 3.0),
        ({"lean": "3", "reach": "1.5"}, 1.0),  # it moves 1.5 times as fast
    ],
)
def test_a_joint_is_as_fast_as_its_limit_and_that_of_what_mimics_it_and_slow_without(
    limits: dict[str, str], fastest: float
) -> None:
    text = PALLETISER.decode()
    for joint, lower in (("lean", "-1"), ("reach", "-2")):
        if joint in limits:
            text = text.replace(f'<limit lower="{lower}"', f'<limit velocity="{limits[joint]}" lower="{lower}"')
    chain = JointChain(parse_robot(text.encode()).between("base", "tip"))
    assert chain.velocity == pytest.approx((USUAL_SPEED, fastest, USUAL_SPEED))


@pytest.mark.parametrize("master", ["wrist2", "reach", "flange"])
def test_a_joint_mimics_one_that_moves_by_itself(master: str) -> None:
    with pytest.raises(ConfigError, match="'reach' mimics"):
        parse_robot(PALLETISER.replace(b'mimic joint="lean"', f'mimic joint="{master}"'.encode()))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_jacobian_is_the_derivative_of_forward(chain: JointChain) -> None:
    q, step = draw(chain, rng()), 1e-6
    jacobian = chain.jacobian(q)
    here = chain.forward(q)
    for joint in range(len(chain)):
        moved = chain.forward(q + step * np.eye(len(chain))[joint])
        twist = transforms.log(here.inverse() @ moved) / step
        turned = np.kron(np.eye(2), here.rotation_matrix) @ twist
        assert jacobian[:, joint] == pytest.approx(turned, abs=1e-5)


def test_inverse_reaches_what_is_reachable_within_limits(chain: JointChain) -> None:
    random = rng(1)
    solved = 0
    for _ in range(30):
        target = chain.forward(draw(chain, random))
        try:
            solution = chain.inverse(target, draw(chain, random), rng=random)
        except UnreachableError:
            continue
        solved += 1
        distance, angle = target.distance(chain.forward(solution.positions))
        assert distance < 0.15e-3
        assert angle < 1e-3
        assert (solution.positions >= chain.lower).all() and (solution.positions <= chain.upper).all()
    assert solved >= 29


def test_inverse_from_nearby_takes_a_short_trajectory(chain: JointChain) -> None:
    random = rng(2)
    middle = np.where(chain.turning, 0.3, (np.maximum(chain.lower, -9) + np.minimum(chain.upper, 9)) / 2)
    solution = chain.inverse(chain.forward(middle + 0.02), middle, rng=random)
    assert np.abs(np.array(solution.positions) - middle).max() < 0.3


def test_continuous_joints_stay_within_half_a_turn_of_the_start() -> None:
    chain, start = gen3("tool_link"), HOME + np.array((4, 0, 0, 0, -2, 0, 0)) * math.pi
    solution = chain.inverse(chain.forward(HOME), start, rng=rng())
    assert solution.positions == pytest.approx(tuple(start), abs=1e-3)


def test_posture_pulls_where_the_target_leaves_freedom() -> None:
    chain, posture = gen3("tool_link"), HOME + 0.3 * np.eye(7)[2]
    target = chain.forward(HOME + 0.05)
    near = chain.inverse(target, HOME, rng=rng(), posture=posture)
    plain = chain.inverse(target, HOME, rng=rng())
    away, away_plain = (np.linalg.norm(chain.difference(s.positions, posture)) for s in (near, plain))
    assert away < 0.9 * away_plain


def test_what_is_out_of_reach_is_said_to_be_with_the_residual() -> None:
    chain = gen3("tool_link")
    with pytest.raises(UnreachableError, match=r"out of reach.* mm") as error:
        chain.inverse(Pose((1.5, 0.0, 0.3)), HOME, rng=rng())
    assert 0.3 < error.value.position < 1.0


def test_inverse_is_repeatable() -> None:
    chain = gen3("tool_link")
    target = chain.forward(draw(chain, rng(7)))
    first, second = (chain.inverse(target, HOME, rng=rng(5)) for _ in range(2))
    assert first == second


def test_difference_goes_the_short_way_round_only_for_continuous_joints() -> None:
    chain = gen3("tool_link")
    a, b = np.zeros(7), np.array((6.0, 2.2, -6.0, 2.5, 3.0, -2.0, 0.0))
    turn = 2 * math.pi
    assert chain.difference(a, b) == pytest.approx((6.0 - turn, 2.2, turn - 6.0, 2.5, 3.0, -2.0, 0.0))


def test_half_a_turn_between_start_and_target_is_no_obstacle() -> None:
    chain = CHAINS["gantry"]()
    target = chain.forward((0.0, 0.0, 0.0, 0.0, 0.0, math.pi))
    solution = chain.inverse(target, np.zeros(6), rng=rng(), restarts=0)
    assert target.distance(chain.forward(solution.positions)) == pytest.approx((0.0, 0.0), abs=1e-3)


def test_joints_at_their_limits_do_not_hold_up_the_others() -> None:
    chain, random = panda(), rng(4)
    targets = [chain.forward(draw(chain, random)) for _ in range(60)]
    reached = 0
    for target in targets:
        with contextlib.suppress(UnreachableError):
            chain.inverse(target, draw(chain, random), rng=random, restarts=3)
            reached += 1
    assert reached >= 55
