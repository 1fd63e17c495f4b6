"""How often messages go out at most: each topic has a rate, what is newest goes out, and no event is lost."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from agents.ros_bridge.bridge.throttle import Throttle
from dsr import Pose
from dsr.agent import Access, Agent
from dsr.clock import ManualClock
from dsr.images.blobs import Frame
from dsr.runtime.system import AgentSpec
from dsr.timeline import Chronicle
from tests.agents.ros_bridge.robot import bridged


@pytest.mark.parametrize(("period", "hz"), [(0.02, 10.0), (0.02, 30.0), (0.011, 50.0), (0.1, 7.0), (0.013, 1.0)])
def test_on_the_average_it_is_as_often_as_wanted_and_never_more(period: float, hz: float) -> None:
    clock = ManualClock()
    pace, taken = Throttle(clock, hz), []
    for _ in range(2000):
        if pace.take():
            taken.append(clock.monotonic())
        clock.advance(period)
    rate = (len(taken) - 1) / (taken[-1] - taken[0])
    assert rate == pytest.approx(min(hz, 1.0 / period), rel=0.02)
    gaps = np.diff(taken)
    assert gaps.min() >= 1.0 / hz - period - 1e-6, "what is late is not made up for by two at once"


def test_after_a_pause_there_is_no_burst() -> None:
    clock = ManualClock()
    pace = Throttle(clock, 10.0)
    assert [pace.take() for _ in range(3)] == [True, False, False]
    clock.advance(60.0)
    assert pace.is_due
    assert [pace.take() for _ in range(3)] == [True, False, False]


def test_there_may_be_no_limit() -> None:
    pace = Throttle(ManualClock(), math.inf)
    assert all(pace.take() for _ in range(100))


class Busy(Agent):
    """Writes a frame, joints and a picture with each tick."""

    rate_hz = 100.0
    writes = Access(
        nodes=("world", "arm", "camera"), edges=("RT",), attributes=("joint_names", "joint_positions", "stream")
    )

    def setup(self) -> None:
        self.memory.add_node("world", "world")
        self.memory.add_node("arm_1", "arm", joint_names="a")
        self.memory.add_node("eye", "camera", stream="eye")
        self._number = 0

    def tick(self, now: float) -> None:
        self._number += 1
        self.memory.add_edge("world", "arm_1", "RT", pose=Pose((float(self._number), 0.0, 0.0), stamp=now))
        self.memory.update_node("arm_1", joint_positions=(float(self._number),))
        self.memory.put_frame("eye", Frame(now, {"color": np.zeros((2, 2, 3), np.uint8)}, {}))


SENT = {
    "tf_hz": 20.0, "joints_hz": 10.0, "images_hz": 6.0,
    "clock_hz": 5.0, "diagnostics_hz": 2.0, "beliefs_hz": 4.0, "events_hz": 3.0,
}  # fmt: skip
TOPICS = {
    "/tf": ("tf2_msgs/msg/TFMessage", 20.0),
    "/dsr/joint_states": ("sensor_msgs/msg/JointState", 10.0),
    "/dsr/eye/image_raw": ("sensor_msgs/msg/Image", 6.0),
    "/clock": ("rosgraph_msgs/msg/Clock", 5.0),
    "/diagnostics": ("diagnostic_msgs/msg/DiagnosticArray", 2.0),
    "/dsr/beliefs": ("vision_msgs/msg/Detection3DArray", 4.0),
    "/dsr/markers": ("visualization_msgs/msg/MarkerArray", 4.0),
}
SECONDS = 4.0


def test_each_topic_has_a_largest_rate_and_the_newest_goes_out() -> None:
    with bridged({"send": SENT}, others=[AgentSpec("busy", Busy)]) as system:
        for name, (type, _) in TOPICS.items():
            system.robot.listen(name, type)
        system.run(SECONDS)
        for name, (_, hz) in TOPICS.items():
            assert len(system.robot.heard[name]) == pytest.approx(hz * SECONDS, abs=1.5), name
        frames = [one.transforms[0].transform.translation.x for one in system.robot.heard["/tf"]]
        newest = system.memory.edge("world", "arm_1", "RT")["pose"].t[0]
        assert frames == sorted(set(frames)) and newest - frames[-1] <= 100.0 / SENT["tf_hz"] + 2.0


def test_events_wait_for_their_time_and_none_is_lost() -> None:
    with bridged({"send": SENT}) as system:
        system.robot.listen("/dsr/events", "std_msgs/msg/String")
        system.run()
        chronicle = Chronicle(system.memory, "test")
        for number in range(12):
            chronicle.happened("Spill", f"cup_{number}")
        system.run(1.0)
        heard = system.robot.heard["/dsr/events"]
        assert len(heard) == pytest.approx(SENT["events_hz"], abs=1.5)
        system.run(4.0)
        assert [json.loads(one.data)["participants"] for one in heard] == [[f"cup_{number}"] for number in range(12)]
