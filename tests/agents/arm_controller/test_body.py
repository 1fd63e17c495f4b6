"""The robot in the graph: complete, where the joints say it is, and of the time of the sample."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from agents.arm_controller.body import REFRESH
from agents.arm_controller.model.kinematics import JointChain
from agents.arm_controller.model.urdf import load_robot
from dsr import Pose
from dsr.errors import ConfigError

from .conftest import GEN3, HOME, PERIOD, Bench, FakeArm

OVERHEAD = {"driver": "fake:Camera", "name": "overhead", "mount": {"translation": [0.35, 0.0, 0.65]}}
WRIST = {"driver": "fake:Camera", "name": "wrist", "link": "camera_wrist_link"}


def test_the_chain_hangs_together_from_the_world_to_the_gripper(bench: Bench) -> None:
    bench.run(0.1)
    memory = bench.memory
    names = ["world", "robot", "arm", *(f"arm_link_{i}" for i in range(1, 8)), "gripper"]
    assert all(memory.get_edge(*pair, "RT") for pair in pairwise(names))
    assert {(edge.src, edge.dst) for edge in memory.edges("has")} == {("robot", "body"), ("robot", "mind")}
    assert memory.node("arm")["joint_names"] == ",".join(bench.arm.names)


def test_the_gripper_is_where_the_joints_say_at_the_time_of_the_sample(bench: Bench) -> None:
    bench.run(PERIOD)
    bench.arm.follow((0.0, 0.6), (HOME, tuple(np.array(HOME) + 0.3)))
    bench.run(0.2)
    flange = JointChain(load_robot(GEN3).between("base_link", "end_effector_link"))
    sample = bench.arm.present
    assert sample is not None
    pose = bench.memory.transform("world", "gripper")
    assert pose.distance(flange.forward(sample.positions)) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert pose.stamp == sample.stamp
    assert bench.memory.node("arm")["joint_positions"] == pytest.approx(sample.positions)
    assert bench.memory.node("arm")["joint_velocities"] == pytest.approx(sample.velocities)
    earlier = bench.memory.transform("world", "gripper", at=sample.stamp - PERIOD)
    assert earlier.distance(pose)[0] > 1e-3


class AnnouncingArm(FakeArm):
    """Says when a sample comes."""

    def on_sample(self, call: Callable[[], object]) -> None:
        self.say = call


def test_a_tick_that_came_too_soon_for_a_sample_is_made_up_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.agents.arm_controller.conftest.FakeArm", AnnouncingArm)
    bench = Bench({"driver": "fake:Arm", "urdf": str(GEN3)}, monkeypatch)
    woken, arm = list[str](), bench.arm
    assert isinstance(arm, AnnouncingArm)
    bench.agent.wake = lambda: woken.append("now")
    bench.run(0.1)
    arm.say()
    assert woken == [], "the newest tick had a sample, and the next has its turn"
    bench.run(PERIOD, silent=True)
    arm.say()
    arm.say()
    assert woken == ["now"]
    bench.run(0.0)
    bench.runner.tick(bench.clock.now())
    arm.say()
    assert woken == ["now"], "a device that announces what it does not have must not make the controller tick on and on"
    bench.run(PERIOD, silent=True)
    arm.say()
    assert woken == ["now", "now"]


def test_what_stands_still_is_written_less_often(bench: Bench) -> None:
    bench.run(0.1)
    watch = bench.memory.watch(edge_type="RT", existing=False)
    written = dict.fromkeys(("arm", "arm_link_6"), 0)
    bench.memory.update_node("arm", target_joints=(*HOME[:6], HOME[6] + 0.5))
    for _ in range(30):
        bench.run(PERIOD)
        for change in watch.poll():
            if change.src in written:
                written[change.src] += 1
        now = bench.clock.now()
        assert bench.memory.transform("world", "gripper", at=now).stamp > now - REFRESH - PERIOD
    assert written["arm"] <= 30 * PERIOD / REFRESH + 1
    assert written["arm_link_6"] > 25


def test_joints_may_come_in_another_order_and_with_others_among_them(bench: Bench) -> None:
    arm = bench.arm
    arm.advance(bench.clock.now())
    sample = arm.present
    assert sample is not None
    arm.names = ("rail", *reversed(sample.names))
    arm.positions = np.array((0.7, *reversed(HOME)))
    arm.velocities = np.zeros(8)
    arm.advance = lambda now: setattr(arm, "present", arm.sample(now))
    bench.memory.update_node("arm", target_joints=np.array(HOME) + 0.1)
    bench.run(0.1)
    assert bench.memory.node("arm")["joint_positions"] == pytest.approx(HOME)
    told, _, positions = arm.told[-1]
    assert told == "follow"
    assert positions[0] == pytest.approx((0.7, *reversed(HOME)))
    assert positions[-1] == pytest.approx((0.7, *reversed(np.array(HOME) + 0.1)))


@pytest.mark.parametrize("fault", ["joint_8", "nan", "short"])
def test_samples_that_do_not_describe_the_arm_are_dropped(
    bench: Bench, fault: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench.run(0.1)
    good = bench.memory.transform("world", "gripper")
    if fault == "joint_8":
        bench.arm.names = tuple(f"joint_{i}" for i in range(2, 9))
    elif fault == "nan":
        bench.arm.positions[3] = np.nan
    else:
        bench.arm.names = bench.arm.names[:-1]
    bench.run(1.0)
    assert bench.memory.transform("world", "gripper") == good
    assert bench.status == "halted"
    assert len([record for record in caplog.records if "dropped" in record.message]) == 1


def test_gripper_opening_and_contact_are_written(bench: Bench) -> None:
    bench.run(0.04)
    gripper = bench.memory.node("gripper")
    assert (gripper["opening"], gripper["contact"]) == (0.085, False)
    bench.arm.obstacle = 0.04
    bench.arm.move_gripper(0.0)
    bench.run(0.04)
    assert (gripper["opening"], gripper["contact"]) == (0.04, True)


def test_cameras_hang_where_the_configuration_says(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(cameras={"camera_overhead": OVERHEAD, "camera_wrist": WRIST})
    bench.run(0.1)
    assert bench.memory.edge("world", "camera_overhead", "RT").pose == Pose((0.35, 0.0, 0.65))
    gripper_from_camera = bench.memory.edge("gripper", "camera_wrist", "RT").pose
    assert gripper_from_camera.t == pytest.approx((0.0, 0.05639, -0.00305))


def test_a_calibrated_mount_survives_a_restart(make_bench: Callable[..., Bench]) -> None:
    bench = make_bench(cameras={"camera_wrist": WRIST})
    better = Pose((0.0, 0.05, 0.0))
    bench.memory.update_edge("gripper", "camera_wrist", "RT", pose=better)
    bench.run(1.0)
    bench.own.close()
    bench.start()
    bench.run(0.1)
    assert bench.own.edge("gripper", "camera_wrist", "RT").pose == better


def test_what_somebody_removed_is_put_back(bench: Bench) -> None:
    bench.run(0.1)
    bench.memory.remove_node("gripper")
    bench.memory.remove_node("arm_link_3")
    bench.run(0.1)
    assert bench.memory.transform("world", "gripper").stamp > bench.clock.now() - REFRESH - PERIOD
    assert "contact" in bench.memory.node("gripper")


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"urdf": "etc/robots/none.urdf"}, "cannot be read"),
        ({"tool_link": "tool"}, "no link 'tool'; did you mean 'tool_link'"),
        ({"cameras": {"c": {"parent": "worl"}}}, "'worl' is no node of the robot; did you mean 'world'"),
        ({"cameras": {"c": {"link": "finger_left_link"}}}, "'finger_left_joint' moves"),
        ({"cameras": {"c": {"driverr": "x"}}}, "unknown field 'driverr'.*; did you mean 'driver'"),
        ({"mount": {"rotation": [0.0, 0.0, 0.0, 0.5]}}, "norm 0.5"),
        ({"posture": [0.0, 1.0]}, "posture of 2 positions: expected 7"),
        ({"default_speed": 0.0}, "default_speed 0.0: expected more than 0"),
    ],
)
def test_wrong_configuration_is_refused_with_its_reason(
    make_bench: Callable[..., Bench], config: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        make_bench(**config)


def test_parts_have_bounds_from_their_collision_shapes(bench: Bench) -> None:
    bench.run(0.1)
    names = ["arm", *(f"arm_link_{i}" for i in range(1, 8)), "gripper"]
    assert all("bounds" in bench.memory.node(name) for name in names)
    assert bench.memory.node("arm_link_2")["bounds"] == pytest.approx((-0.044, -0.25438, -0.050375, 0.044, 0, 0.044))
    assert bench.memory.node("gripper")["bounds"] == pytest.approx((-0.0625, -0.0375, 0, 0.0625, 0.0375, 0.135))
