"""The arm's shape: boxes where its links are, what it meets, and the view from the observe pose."""

from __future__ import annotations

import numpy as np
import pytest

from agents.arm_controller.model.arm_model import arm_model, load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.model.urdf import load_robot
from agents.arm_controller.motion.obstacles import ITSELF, Load, Obstacles
from agents.arm_controller.scene import Obstacle
from dsr import Pose
from dsr.math3d.boxes import Boxes

from .conftest import GEN3, HOME

CAMERA = np.array([0.35, 0.0, 0.65])
OPEN = Load(0.085)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return Figure(arm_model(load_robot(GEN3)))


def test_fingers_are_beside_the_tool_point_at_their_opening(figure: Figure, tool: JointChain) -> None:
    boxes = figure.boxes(np.array([HOME]), 0.06)
    tool_from_base = tool.forward(HOME).inverse()
    pads = [tool_from_base.apply(center) for center in boxes.centers[0, -4:]]
    assert sorted(round(float(pad[0]), 4) for pad in pads) == [-0.042, -0.034, 0.034, 0.042]
    assert figure.gripper_boxes(0.06) == 8  # wrist and camera, flange and palm, two of each finger
    assert figure.reach == pytest.approx(0.015)
    assert boxes.centers.shape == (1, figure.base_boxes + 20, 3)


def test_what_is_held_moves_with_the_tool(figure: Figure, tool: JointChain) -> None:
    held = LinkBox(Pose((0.0, 0.01, 0.02)), (0.02, 0.02, 0.02))
    boxes = figure.boxes(np.array([HOME]), 0.04, [held])
    assert boxes.centers[0, -1] == pytest.approx(tool.forward(HOME).apply((0.0, 0.01, 0.02)))


def test_a_folded_arm_meets_itself_and_a_usual_one_does_not(figure: Figure) -> None:
    folded = (0.0, 2.2, 0.0, 2.57, 0.0, 2.09, 0.0)
    rows = np.array([HOME, load_arm(GEN3).home, folded])
    assert figure.meets_itself(figure.boxes(rows, 0.085), 0.0).tolist() == [False, False, True]
    free = Obstacles(figure, [], Pose.identity())
    assert free.blocking(np.linspace(HOME, folded, 40), OPEN, 0) == ITSELF


def test_what_is_met_is_named_and_what_is_left_is_not(figure: Figure, tool: JointChain) -> None:
    trajectory = np.linspace(HOME, (0.8, *HOME[1:]), 40)
    wall = Obstacle("wall", tool.forward(trajectory[20]), (0.05, 0.05, 0.05))
    far = Obstacle("far", Pose((0.0, 0.0, 3.0)), (1.0, 1.0, 1.0))
    around = Obstacles(figure, [far, wall], Pose.identity())
    assert around.blocking(trajectory, OPEN, 0) == "wall"
    assert Obstacles(figure, [far, wall], Pose.identity(), target="wall").blocking(trajectory[:21], OPEN, 21) is None


def test_what_the_arm_is_too_close_to_may_be_left_but_not_approached(figure: Figure, tool: JointChain) -> None:
    x, y, z = tool.forward(HOME).t
    beside = Obstacles(figure, [Obstacle("wall", Pose((x, y - 0.0885, z)), (0.05, 0.05, 0.05))], Pose.identity())
    away = np.linspace(HOME, (-0.3, *HOME[1:]), 30)
    assert beside.blocking(away, OPEN, 0) is None
    assert beside.blocking(-away + 2 * np.array(HOME), OPEN, 0) == "wall"


def test_things_are_where_the_arm_stands(figure: Figure, tool: JointChain) -> None:
    world_from_arm = Pose((1.0, 2.0, 0.5), (0.0, 0.0, 0.6, 0.8))
    thing = Obstacle("cube", world_from_arm @ tool.forward(HOME), (0.08, 0.08, 0.04))
    path = np.array([HOME])
    assert Obstacles(figure, [thing], world_from_arm.inverse()).blocking(np.vstack([path - 0.5, path]), OPEN, 0)
    assert not Obstacles(figure, [thing], Pose.identity()).blocking(np.vstack([path - 0.5, path]), OPEN, 0)


def test_at_the_observe_pose_the_overhead_camera_sees_the_whole_table(figure: Figure) -> None:
    """Rays from the camera to everything up to 0.25 m above the place where things are put."""
    boxes = figure.boxes(np.array([load_arm(GEN3).home]), 0.085)
    grid = np.meshgrid(np.linspace(0.15, 0.55, 17), np.linspace(-0.25, 0.25, 21), np.linspace(0.0, 0.25, 6))
    assert not hidden(boxes, np.stack([part.ravel() for part in grid], axis=1)).any()
    above_table = figure.boxes(np.array([(0.0, 0.9, np.pi, -1.86, 0.0, -1.75, np.pi / 2)]), 0.085)
    assert hidden(above_table, np.stack([part.ravel() for part in grid], axis=1)).any()


def hidden(boxes: Boxes, points: np.ndarray) -> np.ndarray:
    """Whether the line from the camera to each point (n, 3) passes through a box (slab method)."""
    result = np.zeros(len(points), dtype=bool)
    for center, axes, half in zip(boxes.centers[0], boxes.axes[0], boxes.halves[0], strict=True):
        start, end = axes.T @ (CAMERA - center), (points - center) @ axes
        trajectory = np.where(np.abs(end - start) < 1e-12, 1e-12, end - start)
        one, other = (-half - start) / trajectory, (half - start) / trajectory
        enters, leaves = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        result |= (enters <= leaves) & (leaves >= 0.0) & (enters <= 1.0)
    return result


def test_the_throat_ends_at_the_palm_or_where_fingers_come_together(figure: Figure) -> None:
    assert figure.throat(0.04) == pytest.approx(0.04, abs=2e-3)  # the Gen3's palm
    linkage = Figure(load_arm(GEN3.with_name("open_manipulator_p.urdf")))
    narrow, wide = linkage.throat(0.04), linkage.throat(0.1)
    assert 0.002 < narrow < wide < 0.06
