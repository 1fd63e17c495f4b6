"""Zones that no arm enters, the workspace of its tool, and limits that every commanded trajectory keeps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from agents.arm_controller.config import ArmControllerConfig
from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.motion.obstacles import Load, Obstacles
from agents.arm_controller.motion.trajectory import PERIOD
from agents.arm_controller.safety.zones import EDGE, Zone, Zones
from agents.arm_controller.scene import ArmScene
from dsr import Pose
from dsr.errors import ConfigError
from tests.agents.arm_controller.conftest import DOWN, GEN3, HOME, Table

MakeBench = Callable[..., Any]
BESIDE = {"lower": (0.2, 0.2, 0.0), "upper": (0.6, 0.5, 0.6)}
"""A box on the left of the arm as it stands at home."""
LEFT = (-0.9, *HOME[1:])
"""Joint positions with the tool in that box."""


@pytest.fixture
def table(make_bench: MakeBench) -> Iterator[Table]:
    workspace = {"lower": (0.0, -0.6, 0.0), "upper": (0.6, 0.6, 0.8)}
    bench = make_bench(Table, forbidden={"cupboard": BESIDE}, workspace=workspace)
    bench.lay()
    yield bench


def commanded(table: Table) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array(told[1]), np.array(told[2])) for told in table.arm.told if told[0] == "follow"]


def test_a_target_in_a_forbidden_zone_is_refused_by_hand_and_for_a_skill(table: Table) -> None:
    table.memory.update_node("arm", target_joints=LEFT)
    table.run(0.1)
    assert (table.status, table.memory.node("arm")["explanation"]) == (
        "unreachable", "target_joints: cupboard is in the way",
    )  # fmt: skip
    assert table.act("move", target_pose=Pose((0.4, 0.35, 0.3), DOWN)) == ("failed", "cupboard is in the way")
    assert commanded(table) == []


def test_a_node_of_the_graph_is_a_zone_too(table: Table) -> None:
    assert table.act("move", target_pose=Pose((0.4, -0.2, 0.3), DOWN))[0] == "done"
    assert table.act("observe")[0] == "done"
    table.memory.add_node("shelf", "zone", size=(0.3, 0.3, 0.6))
    table.memory.add_edge("world", "shelf", "RT", pose=Pose((0.45, -0.3, 0.3)))
    table.run(0.1)
    assert table.act("move", target_pose=Pose((0.4, -0.2, 0.3), DOWN)) == ("failed", "shelf is in the way")


def test_the_tool_does_not_leave_the_workspace(table: Table) -> None:
    assert table.act("move", target_pose=Pose((0.66, -0.05, 0.3), DOWN)) == ("failed", f"{EDGE} is in the way")
    assert commanded(table) == []


def test_paths_go_around_zones_and_every_trajectory_keeps_the_limits(table: Table) -> None:
    for skill, more in (
        ("pick", {"target": "cube_3"}),
        ("place", {"target": "cube_3", "destination": "cube_5"}),
        ("move", {"target_pose": Pose((0.4, -0.2, 0.3), DOWN)}),
        ("observe", {}),
    ):
        table.arm.obstacle = 0.0 if skill == "move" else 0.04
        assert table.act(skill, **more)[0] in ("done", "failed")
    config, model = ArmControllerConfig(), load_arm(GEN3)
    fastest = np.array([joint.velocity for joint in model.chain.joints]) * config.default_speed
    zones = Zones(None, {"cupboard": Zone(**BESIDE)}, ArmScene(table.memory))
    obstacles = Obstacles(Figure(model), zones.forbidden(), Pose())
    assert len(commanded(table)) >= 4
    for times, rows in commanded(table):
        velocities = np.diff(rows, axis=0, prepend=rows[:1], append=rows[-1:]) / PERIOD
        accelerations = np.diff(velocities, axis=0) / PERIOD
        assert np.diff(times) == pytest.approx(PERIOD)
        assert (np.abs(velocities) <= fastest * (1 + 1e-9)).all()
        assert np.abs(accelerations).max() <= config.acceleration * (1 + 1e-9)
        assert np.abs(np.diff(accelerations, axis=0)).max() / PERIOD <= config.jerk * (1 + 1e-9)
        assert obstacles.blocking(rows, Load(0.08), len(rows)) != "cupboard"


def test_a_zone_without_an_inside_is_wrong_input(table: Table) -> None:
    with pytest.raises(ConfigError, match="zone 'wall': expected `lower` less than `upper`"):
        Zones(None, {"wall": Zone((0.0, 0.0, 0.0), (1.0, 0.0, 1.0))}, ArmScene(table.memory))
