"""`dsr ros run` and the system file `ros`: real processes, a real router, and a node of ROS behind it."""

from __future__ import annotations

import json
import secrets
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

import pytest
from typer.testing import CliRunner

from agents.ros_bridge import RosBridge
from agents.ros_bridge.bridge.topics import receive
from agents.ros_bridge.cli import app
from agents.ros_bridge.errors import RosLinkError
from agents.ros_bridge.link.link import LinkConfig, Qos, Topic
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, decode_transforms, encode_transforms
from agents.ros_bridge.run_cli import find_types
from dsr import Pose
from dsr import connect as join
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.memory import Memory
from dsr.network.rendezvous import endpoints
from dsr.runtime.system import load_system
from dsr.security.policy import system_grants
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.robot import TYPES
from tests.agents.ros_bridge.told import eventually

TRIGGER = "std_srvs/srv/Trigger"
LATCHED = Qos(transient_local=True, depth=10)
A, B = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)), Pose((0.0, 0.5, 0.0))
Connect = Callable[..., ZenohLink]


@pytest.fixture
def memory(router: Router, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Memory]:
    """A replica of the graph of a bridge that runs as a process."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    graph = f"ros_{secrets.token_hex(4)}"
    code = "from agents.ros_bridge.cli import app; app()"
    options = ["--ros-router", router.endpoint, "--graph", graph, "--world-frame", "map"]
    command = [sys.executable, "-c", code, "run", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        eventually(lambda: endpoints(graph), seconds=30.0)
        with join(graph, agent="observer") as found:
            yield found
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=20)
        assert process.returncode == 0, said
        assert "bridging ROS (domain 0, zenoh)" in said and "Traceback" not in said
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def test_a_robot_joins_without_a_system_file(memory: Memory, connect: Connect, router: Router) -> None:
    robot = connect("/robot")
    statics = robot.publisher(Topic("/tf_static", TF_MESSAGE, LATCHED))
    moving = robot.publisher(Topic("/tf", TF_MESSAGE, Qos(depth=100)))
    heard: dict[str, Pose] = {}

    def listen(message: object) -> None:
        for one in decode_transforms(message.cdr):  # type: ignore[attr-defined]
            heard[one.child] = Pose(one.pose[:3], one.pose[3:])

    robot.subscribe(Topic("/tf", TF_MESSAGE, Qos(depth=100)), listen)
    statics.send(encode_transforms([to_stamped("base_link", "lidar", 0.0, B)]))

    def goes_on() -> bool:
        moving.send(encode_transforms([to_stamped("map", "base_link", WALL_CLOCK.now(), A)]))
        return memory.get_transform("world", "lidar") is not None

    eventually(goes_on, seconds=20.0)
    assert memory.transform("world", "lidar").distance(A @ B) == pytest.approx((0.0, 0.0), abs=1e-9)

    memory.add_node("cube_1", "cube", size=(0.04, 0.04, 0.04))
    memory.add_edge("world", "cube_1", "Virtual_RT", pose=A.with_stamp(WALL_CLOCK.now()))

    def is_believed() -> bool:
        memory.update_edge("world", "cube_1", "Virtual_RT", pose=A.with_stamp(WALL_CLOCK.now()))
        return "belief/cube_1" in heard

    eventually(is_believed, seconds=20.0)
    assert heard["belief/cube_1"].distance(A) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert "base_link" not in heard, "nothing of ours comes back"

    request = TYPES.encode(f"{TRIGGER}_Request", TYPES.new(f"{TRIGGER}_Request"))
    response = TYPES.decode(f"{TRIGGER}_Response", robot.call("/dsr/objects", TRIGGER, request, 10.0))
    assert [one["name"] for one in json.loads(response.message)] == ["cube_1"]

    router.stop()
    router.start()
    turned = A @ B

    def is_back() -> bool:
        moving.send(encode_transforms([to_stamped("map", "base_link", WALL_CLOCK.now(), turned)]))
        return memory.transform("world", "base_link").distance(turned)[0] < 1e-9

    eventually(is_back, seconds=30.0)


def test_topics_are_found_by_their_types(connect: Connect, topic: str) -> None:
    robot, us = connect("/robot"), connect("/look")
    robot.publisher(Topic(topic, "sensor_msgs/msg/PointCloud2"))
    assert find_types(us, [topic], 10.0) == {topic: "sensor_msgs/msg/PointCloud2"}
    with pytest.raises(ConfigError, match=f"nobody publishes {topic}x.*{topic}"):
        find_types(us, [topic, f"{topic}x"], 0.3)


def test_what_is_received_follows_from_names_and_types() -> None:
    image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
    found = receive({
        "/tf": TF_MESSAGE, "/joint_states": "sensor_msgs/msg/JointState", "/points": "sensor_msgs/msg/PointCloud2",
        "/cam/color/image_raw": image, "/cam/depth/image_rect": image, "/cam/color/camera_info": info,
        "/other/a/image": image, "/other/b/image/compressed": "sensor_msgs/msg/CompressedImage",
        "/found": "vision_msgs/msg/Detection3DArray",
    })  # fmt: skip
    assert found == {
        "tf": True,
        "joints": {"/joint_states": "robot"},
        "clouds": {"points": "/points"},
        "detections": {"/found": {}},
        "cameras": {
            "cam": {
                "color": "/cam/color/image_raw", "depth": "/cam/depth/image_rect", "info": "/cam/color/camera_info"
            },
            "other": {"color": "/other/a/image"},
            "other_b_image_compressed": {"color": "/other/b/image/compressed"},
        },
    }  # fmt: skip
    with pytest.raises(ConfigError, match="RosTags"):
        receive({"/tags": "apriltag_msgs/msg/AprilTagDetectionArray"})
    with pytest.raises(ConfigError, match="is not bridged"):
        receive({"/odom": "nav_msgs/msg/Odometry"})


def test_the_command_tells_what_is_wrong(router: Router) -> None:
    assert "--topics" in CliRunner().invoke(app, ["run", "--help"]).output
    refused = CliRunner().invoke(app, ["run", "--topics", "/tf", "--transport", "pigeon"])
    assert refused.exit_code == 2 and "'pigeon' is not one of" in refused.output


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--distro", "hamble"], "did you mean 'humble'?"),
        (["--ros-router", "tcp/192.0.2.7:7447"], "say --beyond-loopback"),
        (["--ros-router", "robot"], "expected PROTOCOL/HOST:PORT"),
        (["--world-frame", ""], "a frame without a name"),
    ],
)
def test_options_that_make_no_sense_get_a_reason_and_no_traceback(
    options: list[str], reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    found = CliRunner().invoke(app, ["run", "--graph", f"ros_{secrets.token_hex(4)}", "--for", "5", *options])
    assert isinstance(found.exception, ConfigError) and reason in str(found.exception)
    assert not any(record.exc_info for record in caplog.records)


def test_the_environment_of_ros_is_that_of_each_command(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    """`ROS_DOMAIN_ID` and `ROS_DISTRO` are set where ROS is."""
    asked: list[LinkConfig] = []

    def refuse(link: LinkConfig, node: str) -> NoReturn:
        asked.append(link)
        raise RosLinkError("seen")

    monkeypatch.setattr(RosBridge, "connect", staticmethod(refuse))
    monkeypatch.setattr("agents.ros_bridge.looking_cli.open_link", refuse)
    for command in (["run", "--topics", "/tf"], ["list"], ["check"]):
        CliRunner().invoke(app, command, env={"ROS_DOMAIN_ID": "7", "ROS_DISTRO": "humble"})
    assert [(link.domain, link.distro) for link in asked] == [(7, "humble")] * 3


def test_the_system_file_is_a_whole_system() -> None:
    system = load_system("ros")
    names = {spec.name for spec in system.agents}
    assert names >= {"ros_bridge", "scene_estimator", "simulation_handler", "surprise", "recorder"}
    bridge = next(spec for spec in system.agents if spec.name == "ros_bridge")
    assert bridge.kind.writes.includes("camera") and not bridge.kind.writes.includes("perceived")
    grant = system_grants(system)["ros_bridge"]
    assert "joint_positions" in grant.writes.attributes and "perceived" not in grant.writes.attributes
