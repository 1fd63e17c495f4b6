"""An arm asked for views from elsewhere: it is waited for, its refusals are lived with, and it goes back."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.watch.looking import Looking, can_look
from dsr.clock import ManualClock
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.intentions import DONE, FAILED, PLANNED, RUN, RUNNING

HOME = Pose((0.27, 0.0, 0.6), (1.0, 0.0, 0.0, 0.0))
MIDDLE = (0.35, 0.0, 0.02)
CONFIG = CalibratorConfig()


class Arm:
    """A graph with a gripper, and an arm controller that does what action nodes ask, unless it cannot."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        link = LocalNetwork(self.clock).connect("test")
        self.memory = Memory("looking", "test", transport=link, clock=self.clock)
        self.memory.add_node("world", "world")
        self.memory.add_node("gripper", "gripper")
        self.memory.add_node("camera", "camera")
        self.memory.add_edge("world", "gripper", "RT", pose=HOME)
        self.memory.add_edge("gripper", "camera", "RT", pose=Pose((0.0, 0.05, 0.0)))
        self.views = 1
        self.refuses = 0
        self.sees = True
        self.asked: list[Pose] = []
        self.looking = Looking(self.memory, "gripper", "camera", MIDDLE, lambda: self.views, CONFIG)

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.clock.advance(0.1)
            self.looking.update()
            for node in list(self.memory.nodes("action")):
                if node.get("source") == "calibrator" and node.get("status") == PLANNED and node.get("request") == RUN:
                    self._move(node.name, node["target_pose"])

    def _move(self, name: str, tool: Pose) -> None:
        self.asked.append(tool)
        if len(self.asked) <= self.refuses:
            self.memory.update_node(name, status=FAILED)
            return
        gripper = tool @ Pose(CONFIG.gripper_from_tool).inverse()
        self.memory.add_edge("world", "gripper", "RT", pose=gripper)
        self.memory.update_node(name, status=DONE)
        self.views += self.sees


@pytest.fixture
def arm() -> Iterator[Arm]:
    arm = Arm()
    yield arm
    arm.memory.close()


def test_it_looks_at_the_objects_turned_and_from_two_places(arm: Arm) -> None:
    arm.go(10.0)
    assert arm.looking.is_over and len(arm.asked) == 2
    for tool in arm.asked:
        camera = tool @ Pose((0.0, 0.05, -0.12))
        before = HOME @ Pose((0.0, 0.05, 0.0))
        assert camera.distance(before)[1] > 0.5
        seen, then = (pose.inverse().apply(MIDDLE) for pose in (camera, before))
        assert math.dist(seen, 0.9 * then) < 1e-6


def test_it_tries_other_places_where_the_arm_cannot_go(arm: Arm) -> None:
    arm.refuses = 3
    arm.go(10.0)
    assert len(arm.asked) == 5 and arm.views == 3


def test_a_place_from_which_nothing_is_seen_does_not_count(arm: Arm) -> None:
    arm.sees = False
    arm.go(4.0)
    assert len(arm.asked) == 2 and not arm.looking.is_over


def test_it_waits_for_others_to_give_the_arm_free(arm: Arm) -> None:
    arm.memory.add_node("action_0_1", "action", skill="pick", status=RUNNING, request=RUN, source="planner")
    arm.go(2.0)
    assert not arm.asked
    arm.memory.update_node("action_0_1", status=DONE)
    arm.go(0.3)
    assert arm.asked


def test_it_goes_back_and_leaves_nothing_behind(arm: Arm) -> None:
    arm.go(0.3)
    arm.looking.go_home()
    arm.go(3.0)
    assert arm.looking.is_over and not list(arm.memory.nodes("action"))
    assert arm.memory.transform("world", "gripper").distance(HOME)[0] < 1e-9


def test_it_does_not_go_back_while_others_work_with_the_arm(arm: Arm) -> None:
    arm.go(0.3)
    arm.memory.add_node("action_0_1", "action", skill="pick", status=RUNNING, request=RUN, source="planner")
    arm.looking.go_home()
    asked = len(arm.asked)
    arm.go(3.0)
    assert arm.looking.is_over and len(arm.asked) == asked > 0


def test_without_an_arm_controller_nobody_is_asked(arm: Arm) -> None:
    assert not can_look(arm.memory, "gripper") and not can_look(arm.memory, "world")
