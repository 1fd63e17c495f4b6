"""Beliefs, diagnostics, events, /clock, and what the bridge may write."""

from __future__ import annotations

import json
import logging

import msgspec
import numpy as np
import pytest

from agents.ros_bridge import RosBridge
from agents.ros_bridge.bridge.tally import Tally
from agents.ros_bridge.bridge.times import TimeSource
from agents.ros_bridge.link.local import LocalLink
from agents.ros_bridge.mapping.detections import position_ellipsoid, read_detections
from agents.ros_bridge.mapping.stamps import to_seconds, to_time
from agents.ros_bridge.messages.transforms import encode_transforms
from dsr import Pose
from dsr.agent import Agent
from dsr.clock import ManualClock, WallClock
from dsr.math3d.shapes import Part, to_numbers
from dsr.runtime.system import AgentSpec
from dsr.timeline import Chronicle
from dsr.vocabulary.replayed import Replayed, replayed_key
from tests.agents.ros_bridge.robot import TYPES, Bridged, bridged

LOG = logging.getLogger("test")
CUBE = Pose((0.3, 0.1, 0.02), (0.0, 0.0, 0.6, 0.8), covariance=np.diag([4e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]))


class CountingAgent(Agent):
    degraded = "it limps"
    counts = {"steps": 7, "nothing": 0}  # noqa: RUF012

    def tick(self, now: float) -> None:
        pass


def set_scene(system: Bridged) -> None:
    memory = system.memory
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.0, 0.6, 0.0))
    memory.add_edge("world", "table", "RT", pose=Pose())
    memory.add_node("cube_1", "cube", size=(0.04, 0.04, 0.04), color=(1.0, 0.0, 0.0))
    memory.add_edge("world", "cube_1", "Virtual_RT", pose=CUBE.with_stamp(system.now))
    shape = (Part("cylinder", (0.08, 0.08, 0.1)), Part("sphere", (0.02, 0.02, 0.02), (0.0, 0.0, 0.06)))
    memory.add_node("cup_1", "cup", size=(0.08, 0.08, 0.12), shape=to_numbers(shape), present=True)
    memory.add_edge("world", "cup_1", "Virtual_RT", pose=Pose((0.0, 0.0, 0.06), stamp=system.now))
    memory.add_node("gone", "cube", size=(0.04, 0.04, 0.04), present=False)


def test_beliefs_go_out_with_their_covariance() -> None:
    with bridged() as system:
        set_scene(system)
        system.robot.listen("/dsr/beliefs", "vision_msgs/msg/Detection3DArray")
        system.run(0.5)
        messages = system.robot.heard["/dsr/beliefs"]
        assert 4 <= len(messages) <= 6
        found = {one.id: one for one in read_detections(messages[-1])[0]}
        assert found.keys() == {"cube_1", "cup_1"}
        cube = found["cube_1"]
        assert (cube.frame, cube.kind, cube.size) == ("world", "cube", (0.04, 0.04, 0.04))
        np.testing.assert_allclose(cube.pose.covariance, CUBE.covariance, atol=1e-12)


def test_markers_show_shapes_colours_and_ellipsoids_and_are_deleted_with_their_things() -> None:
    with bridged() as system:
        set_scene(system)
        system.robot.listen("/dsr/markers", "visualization_msgs/msg/MarkerArray")
        system.run(0.2)
        markers = {(m.ns, m.id): m for m in system.robot.heard["/dsr/markers"][-1].markers}
        cube, name, ellipsoid = (markers["cube_1", i] for i in range(3))
        assert (cube.type, cube.scale.x, cube.color.r, cube.color.g, cube.action) == (1, 0.04, 1.0, 0.0, 0)
        assert (name.type, name.text) == (9, "cube_1") and ellipsoid.type == 2
        assert sorted((ellipsoid.scale.x, ellipsoid.scale.y, ellipsoid.scale.z)) == pytest.approx([0.04, 0.04, 0.08])
        assert [markers["cup_1", i].type for i in range(3)] == [3, 2, 9]
        table = markers["table", 0]
        assert table.pose.position.z + table.scale.z / 2 == pytest.approx(0.0)
        system.memory.update_node("cube_1", present=False)
        system.run(0.2)
        last = system.robot.heard["/dsr/markers"]
        deleted = {(m.ns, m.id) for message in last for m in message.markers if m.action == 2}
        assert deleted == {("cube_1", 0), ("cube_1", 1), ("cube_1", 2)}
        assert not [m for m in last[-1].markers if m.ns == "cube_1"]


def test_nothing_is_made_while_nobody_listens() -> None:
    with bridged() as system:
        set_scene(system)
        system.run(0.5)
        assert not {"to /dsr/markers", "to /dsr/beliefs"} & system.counts.keys()


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 1.0), (0.6, 0.0, 0.8, 0.0), (0.5, 0.5, 0.5, 0.5)])
def test_an_ellipsoid_has_the_axes_of_the_covariance(rotation: tuple[float, float, float, float]) -> None:
    pose = Pose((1.0, 2.0, 3.0), rotation, covariance=CUBE.covariance)
    found = position_ellipsoid(pose, 2.0)
    assert found is not None
    axes, diameters = found
    again = axes.rotation_matrix @ np.diag([(d / 4.0) ** 2 for d in diameters]) @ axes.rotation_matrix.T
    np.testing.assert_allclose(again, pose.parent_covariances()[0], atol=1e-12)
    assert position_ellipsoid(Pose(), 2.0) is None


def test_statuses_of_agents_are_diagnostics() -> None:
    with bridged(others=[AgentSpec("counter", CountingAgent)]) as system:
        system.robot.listen("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
        system.run(3.1)
        assert 3 <= len(system.robot.heard["/diagnostics"]) <= 4
        status, own = system.robot.heard["/diagnostics"][-1].status
        assert (own.name, own.level, own.message) == ("ros: ros_bridge", 0, "ready")
        assert {value.key: value.value for value in own.values}["to /diagnostics"] != "0"
        assert (status.name, status.level, status.message) == ("ros: counter", 1, "it limps")
        values = {value.key: value.value for value in status.values}
        assert values["steps"] == "7" and "nothing" not in values and float(values["rate (Hz)"]) > 0.0


def test_events_and_situations_go_out_as_json() -> None:
    with bridged() as system:
        system.robot.listen("/dsr/events", "std_msgs/msg/String")
        chronicle = Chronicle(system.memory, "waiter")
        serving = chronicle.begin("serving", ("tray", "guest"))
        system.run()
        chronicle.happened("Spill", "cup_1", confidence=0.8)
        system.run()
        chronicle.end(serving)
        system.run()
        told = [json.loads(message.data) for message in system.robot.heard["/dsr/events"]]
        ends = [(one["kind"], one["end"] is None) for one in told]
        assert ends == [("serving", True), ("Spill", False), ("serving", False)]
        assert told[1]["participants"] == ["cup_1"] and told[1]["confidence"] == 0.8


def test_in_lockstep_our_time_goes_out_on_clock() -> None:
    with bridged() as system:
        system.robot.listen("/clock", "rosgraph_msgs/msg/Clock")
        system.run(0.1)
        stamps = [to_seconds(message.clock) for message in system.robot.heard["/clock"]]
        assert len(stamps) == 5 and np.diff(stamps) == pytest.approx(0.02, abs=1e-6)
        assert stamps[-1] <= system.now


def test_a_replays_time_goes_out_on_clock() -> None:
    with bridged({"clock": "auto"}) as system:
        system.robot.listen("/clock", "rosgraph_msgs/msg/Clock")
        bus = system.lockstep.bus
        bus.publish(replayed_key(system.lockstep.keys), msgspec.msgpack.encode(Replayed(1234.5, 1200.0)))
        system.run()
        assert to_seconds(system.robot.heard["/clock"][-1].clock) == 1234.5
        system.robot.tf(("world", "base", 1234.4, Pose()))
        system.run()
        assert system.memory.edge("world", "base", "RT")["pose"].stamp == pytest.approx(1234.4)


def test_the_bridge_follows_the_clock_of_a_simulation_in_ros() -> None:
    with bridged({"clock": "follow"}) as system:
        found = system.robot.listen_tf()
        system.robot.tf(("world", "base", 5.0, Pose()))
        system.run(1.1)
        assert "base" not in system.memory and system.counts["before the first /clock"] == 1
        assert "nobody publishes /clock" in system.trouble
        began = system.now
        for i in range(10):
            system.robot.send("/clock", "rosgraph_msgs/msg/Clock", clock=to_time(TYPES, 5.0 + 0.1 * i))
            system.robot.tf(("world", "base", 5.0 + 0.1 * i, Pose((float(i), 0.0, 0.0))))
            system.run(0.1)
        assert system.memory.edge("world", "base", "RT")["pose"].stamp == pytest.approx(began + 0.9, abs=0.02)
        system.memory.add_node("cube", "cube")
        system.memory.add_edge("base", "cube", "RT", pose=Pose(stamp=system.now))
        system.run()
        assert to_seconds(found[-1]) == pytest.approx(6.0, abs=0.02)
        assert not [p for p in system.ros.publishers if p.topic.name == "/clock" and p.link is not system.robot.link]


def test_a_simulation_that_starts_anew_is_told() -> None:
    clock = ManualClock()
    tally = Tally(clock, LOG)
    times = TimeSource(clock, "follow", tally)
    times.hear(100.0, clock.now())
    assert times.to_graph(100.0) == pytest.approx(clock.now()) and times.to_ros(clock.now()) == pytest.approx(100.0)
    times.hear(100.001, clock.now())
    assert times.to_graph(100.0) == pytest.approx(clock.now()), "a late message does not move stamps"
    times.hear(2.0, clock.now())
    assert tally.counts["clock set back"] == 1 and "/clock went back" in tally.trouble
    assert times.to_graph(2.0) == pytest.approx(clock.now())
    clock.advance(20.0)
    assert tally.trouble == ""
    assert not TimeSource(WallClock(), "auto", tally).publishes


def test_the_bridge_may_write_what_it_receives_and_no_more() -> None:
    plain = RosBridge.configured({"receive": {"joints": {}}}).writes
    assert not plain.includes("joint_positions") and not plain.includes("camera") and plain.includes("RT")
    assert RosBridge.configured({}).writes == RosBridge.writes
    assert RosBridge.writes.includes("joint_positions")
    camera = RosBridge.configured({"receive": {"cameras": {"eye": {"color": "/a/b"}}}}).writes
    assert camera.includes("distortion") and not camera.includes("perceived")
    assert RosBridge.configured({"receive": {"detections": {"/a": {}}}}).writes.includes("perceived")
    assert RosBridge.configured({"types": {"cup": "cup"}}).writes.includes("cup")
    assert RosBridge.configured({"nonsense": 1}) is RosBridge
    assert RosBridge.writes.includes("intention")
    assert not RosBridge.configured({"send": {"services": ""}}).writes.includes("intention")


def test_problems_that_last_are_logged_once_while_they_last(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Who runs `dsr ros run` sees its log only; at first there is no connection yet."""
    problems: list[str] = []
    monkeypatch.setattr(LocalLink, "problems", lambda self: list(problems))
    with bridged() as system:
        problems.append("no router: 1 try")
        system.run(1.0)
        problems.clear()
        system.run(2.0)
        assert "no router" not in caplog.text and system.trouble == ""
        for number in range(5):
            problems[:] = [f"no router: {number} tries"]
            system.run(1.0)
        assert caplog.text.count("no router") == 1 and "no router: 4 tries" in system.trouble
        problems.clear()
        system.run(2.0)
        problems.append("no router: 1 try")
        system.run(3.0)
        assert caplog.text.count("no router") == 2


def test_a_huge_message_is_dropped_and_told() -> None:
    with bridged() as system:
        system.robot.tf_cdr(bytes((1 << 22) + 1))
        system.robot.tf_cdr(encode_transforms([]))
        system.run()
        assert system.counts["too large"] == 1 and "4194305 bytes on /tf" in system.trouble
