"""The system `ros` live, beside a robot that is nothing but a node of ROS: up, believed, told, shown, ended."""

from __future__ import annotations

import json
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil
import pytest
from typer.testing import CliRunner

from agents.ros_bridge.cli import app
from agents.ros_bridge.link.link import LinkConfig
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from agents.ros_bridge.services.questions import ASK, TRANSFORM
from agents.ros_bridge.watching import RosFindings, TopicSeen
from agents.viewer.window import free_port, page_url
from dsr import Pose, connect
from dsr.frames.tree import BELIEVED
from dsr.memory import Memory
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.live import READY, Run, agents_of, system_copy
from tests.agents.ros_bridge.sdk_types import ask, listen
from tests.agents.ros_bridge.simulated import COLOR, JOINTS, WORLD, Simulated, play, simulate
from tests.agents.ros_bridge.told import Told, eventually
from tests.agents.viewer import browser
from tests.agents.viewer.test_cli import AMBER, BLUE, shows

MARKERS, TF = "visualization_msgs/msg/MarkerArray", "tf2_msgs/msg/TFMessage"
NEAR = 0.01
"""m between a cube and the belief about it: its tag is some 20 px wide"""
pytestmark = pytest.mark.timeout(400)  # a whole system on a busy machine


class Live:
    """The robot, the system and a replica of its graph."""

    def __init__(
        self, robot: Simulated, sdk: Told, run: Run, file: Path, router: Router, memory: Memory, graph: str
    ) -> None:
        self.robot, self.sdk, self.run, self.file, self.router = robot, sdk, run, file, router
        self.memory, self.graph = memory, graph


@contextmanager
def started(folder: Path) -> Iterator[Live]:
    """A robot, and the system beside it once all is ready."""
    runtime = folder / "runtime"
    runtime.mkdir(mode=0o700)
    robot, router = simulate(), Router()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(runtime))
        for name in ("DSR_SECURITY", "DSR_GRAPH", "ROS_DOMAIN_ID", "ROS_DISTRO"):
            patch.delenv(name, raising=False)
        sdk = Told([sys.executable, str(Path(__file__).with_name("sdk_node.py")), str(router.port)])
        file, graph = system_copy(folder, router.endpoint, WORLD), f"ros_{secrets.token_hex(4)}"
        run = Run(["run", str(file), "--graph", graph, "--folder", str(folder / "run")], folder)
        try:
            play(sdk, robot, folder)
            run.wait_for(READY)
            with connect(graph, agent="observer") as memory:
                yield Live(robot, sdk, run, file, router, memory, graph)
        finally:
            run.kill()
            sdk.close()
            router.stop()


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    """One system for all tests that leave it as it is."""
    with started(tmp_path_factory.mktemp("live")) as found:
        yield found


def believed(live: Live, name: str) -> Any:
    return live.memory.get_transform("world", name, types=BELIEVED)


def test_all_agents_come_up_and_the_robot_is_in_the_memory(live: Live) -> None:
    names = agents_of(live.file)
    assert {name for name in names if f"{name}: ready" in live.run.said} == names
    eventually(lambda: live.memory.get_transform("world", "tool_link"))
    for link, pose in live.robot.links.items():
        assert live.memory.transform("world", link).distance(pose) == pytest.approx((0.0, 0.0), abs=1e-6), link
    positions = live.robot.messages[JOINTS].position
    joints = eventually(lambda: live.memory.get_node("robot"))
    assert list(joints["joint_positions"]) == pytest.approx(list(positions))


def test_what_its_camera_sees_is_believed(live: Live) -> None:
    for name, pose in live.robot.objects.items():

        def is_near(name: str = name, pose: Pose = pose) -> bool:
            found = believed(live, name)
            return found is not None and bool(found.distance(pose)[0] < NEAR)

        eventually(is_near, 60.0)
    assert live.memory.node("camera")["stream"] == "camera"


def test_the_belief_is_in_ros_as_tf_and_as_markers(live: Live) -> None:
    eventually(lambda: all(believed(live, name) for name in live.robot.objects), 60.0)
    listen(live.sdk, "/dsr/markers", MARKERS)
    listen(live.sdk, "/tf", TF)

    def told() -> dict[str, Any]:
        heard = [one for message in live.sdk.received(topic="/tf") for one in message["transforms"]]
        return {one["child_frame_id"]: one for one in heard if one["child_frame_id"].startswith("belief/")}

    for name, pose in live.robot.objects.items():

        def is_near(name: str = name, pose: Pose = pose) -> bool:
            one = told().get(f"belief/{name}")
            if one is None:
                return False
            place = [one["transform"]["translation"][axis] for axis in "xyz"]
            return bool(np.linalg.norm(np.subtract(place, pose.t)) < NEAR)

        eventually(is_near, 60.0)
    assert {one["header"]["frame_id"] for one in told().values()} == {WORLD}

    def labels() -> set[str]:
        got = live.sdk.received(topic="/dsr/markers")
        return {marker["text"] for message in got for marker in message["markers"]}

    eventually(lambda: set(live.robot.objects) <= labels())


def test_an_independent_client_asks_the_memory(live: Live) -> None:
    """Where a thing is, what would be, and for a mission: by services, from another process."""
    cube, pose = next(iter(live.robot.objects.items()))
    eventually(lambda: all(believed(live, name) for name in live.robot.objects), 60.0)
    now = {"sec": 0, "nanosec": 0}

    def where() -> Any:
        return ask(live.sdk, "/dsr/transform", TRANSFORM, target=WORLD, source=f"belief/{cube}", stamp=now)

    found = eventually(lambda: (told := where()) and told["success"] and told)
    place = found["pose"]["pose"]["pose"]["position"]
    assert np.linalg.norm(np.subtract([place[axis] for axis in "xyz"], pose.t)) < NEAR
    assert found["pose"]["header"]["frame_id"] == WORLD and any(found["pose"]["pose"]["covariance"])
    wrong = ask(live.sdk, "/dsr/transform", TRANSFORM, target=WORLD, source="nowhere", stamp=now)
    assert not wrong["success"] and "nowhere" in wrong["message"]

    question = {"seconds": 1.0, "changes": [{"object": cube, "action": "remove"}]}
    supposed = ask(live.sdk, "/dsr/what_if", ASK, question=json.dumps(question))
    assert supposed["success"], supposed
    assert json.loads(supposed["answer"])["poses"].keys() == live.robot.objects.keys() - {cube}

    mission = ask(live.sdk, "/dsr/mission", ASK, question=f"on({cube},table)")
    intention = json.loads(mission["answer"])["intention"]
    eventually(lambda: intention in live.memory)
    assert live.memory.node(intention)["goal"] == f"on({cube},table)"
    live.memory.remove_node(intention)


def test_the_commands_say_what_is_true(live: Live) -> None:
    place = ["--ros-router", live.router.endpoint, "--json"]
    listed = CliRunner().invoke(app, ["list", *place, "--for", "2"])
    rows = {row.name: row for row in msgspec.json.decode(listed.output, type=list[TopicSeen])}
    assert rows[COLOR].publishers == ["/talker"] and rows[COLOR].subscribers == ["/dsr_bridge"]
    assert 0.0 < (rows[COLOR].hz or 0.0) < 6.0 and 0.0 < (rows[JOINTS].hz or 0.0) < 22.0
    assert rows["/dsr/markers"].publishers == ["/dsr_bridge"] and rows["/dsr/objects"].service
    fine = CliRunner().invoke(app, ["check", COLOR, "/tf", "/dsr/markers", *place])
    found = msgspec.json.decode(fine.output, type=RosFindings)
    assert (fine.exit_code, found.problems) == (0, []) and {"/dsr_bridge", "/talker"} <= set(found.nodes)
    wrong = CliRunner().invoke(app, ["check", "/camera/nothing", *place])
    assert wrong.exit_code == 1 and "/camera/nothing: nobody has this topic" in wrong.output


@pytest.mark.skipif(browser.PROGRAM is None, reason="no chromium or google-chrome on the path")
def test_a_browser_shows_what_the_node_of_ros_alone_tells(live: Live, tmp_path: Path) -> None:
    """The cubes that are believed, in blue, and the edges of the robot's frames in the graph."""
    eventually(lambda: all(believed(live, name) for name in live.robot.objects), 60.0)
    ports = free_port(), free_port()
    view = Run(["view", "--serve", "-g", live.graph, "--port", str(ports[0]), "--web-port", str(ports[1])], tmp_path)
    try:
        view.wait_for("from elsewhere")
        with browser.Browser(page_url(*ports), tmp_path) as page:
            eventually(lambda: shows(page, BLUE, AMBER), 150.0)
        assert view.interrupt() == 0 and view.processes() == []
    finally:
        view.kill()


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    """No process of the system, and nothing of it in ROS."""
    with started(tmp_path) as live:
        link = ZenohLink(LinkConfig(router=live.router.endpoint), "/looking")
        try:
            eventually(lambda: "/dsr_bridge" in {one.node for one in link.endpoints()})
            pids = {one.pid for one in psutil.Process(live.run.process.pid).children(recursive=True)}
            assert len(pids) > 3
            assert live.run.interrupt() == 0, live.run.said
            assert live.run.processes() == [] and not {pid for pid in pids if psutil.pid_exists(pid)}
            assert "Traceback" not in live.run.said
            eventually(lambda: "/dsr_bridge" not in {one.node for one in link.endpoints()})
        finally:
            link.close()
