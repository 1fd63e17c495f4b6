"""A bridge in a secured graph: with its certificate and grant, with less of a grant than it needs, and without."""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from agents.ros_bridge.link.link import Qos, Topic
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from agents.ros_bridge.mapping.joints import JOINT_STATE, to_joint_state
from agents.ros_bridge.mapping.transforms import to_stamped
from agents.ros_bridge.messages.transforms import TF_MESSAGE, encode_transforms
from dsr import Pose, connect
from dsr.clock import WALL_CLOCK
from dsr.memory import Memory
from dsr.network.keys import Keys
from dsr.runtime.status import StatusBoard
from tests.agents.ros_bridge.conftest import Router
from tests.agents.ros_bridge.live import READY, Run
from tests.agents.ros_bridge.robot import TYPES
from tests.agents.ros_bridge.told import eventually

SYSTEM = """graph = "{graph}"
[[agent]]
name = "ros_bridge"
class = "agents.ros_bridge:RosBridge"
[agent.config]
link = {{ router = "{router}" }}
receive = {{ joints = {joints} }}
"""
JOINTS = '{ "/joint_states" = "robot" }'
HERE = Pose((1.0, 2.0, 3.0))
Connect = Callable[..., ZenohLink]
pytestmark = pytest.mark.timeout(240)


class Secured:
    """A folder with keys for a bridge that receives no joints, and systems that do and that do not."""

    def __init__(self, folder: Path, router: Router) -> None:
        self.folder, self.keys, self.graph = folder, folder / "keys", f"ros_{secrets.token_hex(4)}"
        self.files = {}
        for name, joints in (("without", "{}"), ("with", JOINTS)):
            file = self.files[name] = folder / f"{name}_joints.toml"
            file.write_text(SYSTEM.format(graph=self.graph, router=router.endpoint, joints=joints))
        self.command("security", "init", str(self.keys), "--system", str(self.files["without"]))

    def command(self, *arguments: str, expect: int = 0, **environment: str) -> str:
        """What a command says that ends by itself."""
        run = Run(list(arguments), self.folder, environment)
        try:
            assert run.process.wait(60) == expect, run.said
            return run.said
        finally:
            run.kill()

    @contextmanager
    def running(self, name: str) -> Iterator[tuple[Run, Memory]]:
        """The system, and a replica of one who may read only."""
        place = self.folder / f"run_{name}"
        run = Run(["run", str(self.files[name]), "--security", str(self.keys), "--folder", str(place)], self.folder)
        try:
            run.wait_for(READY)
            with connect(self.graph, agent="dsr", security=self.keys) as memory:
                yield run, memory
            assert run.interrupt() == 0 and run.processes() == []
        finally:
            run.kill()

    def log(self, name: str) -> str:
        """What the bridge logged in a run."""
        return (self.folder / f"run_{name}" / "ros_bridge.log").read_text()


@pytest.fixture
def secured(tmp_path: Path, router: Router, monkeypatch: pytest.MonkeyPatch) -> Secured:
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    for name in ("DSR_SECURITY", "DSR_GRAPH"):
        monkeypatch.delenv(name, raising=False)
    return Secured(tmp_path, router)


def speak(robot: ZenohLink) -> Callable[[], None]:
    """Makes a function that tells tf and joints once."""
    tf = robot.publisher(Topic("/tf", TF_MESSAGE, Qos(depth=100)))
    joints = robot.publisher(Topic("/joint_states", JOINT_STATE))

    def tell() -> None:
        now = WALL_CLOCK.now()
        tf.send(encode_transforms([to_stamped("world", "base", now, HERE)]))
        joints.send(TYPES.encode(JOINT_STATE, to_joint_state(TYPES, now, ["a"], [0.5])))

    return tell


def test_a_bridge_writes_what_its_grant_allows_and_says_that_ros_proves_nothing(
    secured: Secured, connect: Connect, router: Router
) -> None:
    tell = speak(connect("/robot"))
    with secured.running("without") as (_, memory):

        def is_there() -> Any:
            tell()
            return memory.get_transform("world", "base")

        assert eventually(is_there).t == HERE.t
        said = secured.log("without")
        assert f"this graph is secured, and ROS is not: whoever reaches the Zenoh router {router.endpoint}" in said
        assert "security policy" not in said


def test_what_the_grant_does_not_allow_is_not_written_and_told(secured: Secured, connect: Connect) -> None:
    """The keys were made before the bridge was to receive joints."""
    tell = speak(connect("/robot"))
    with secured.running("with") as (_, memory):
        board = StatusBoard(memory.transport, Keys(secured.graph), WALL_CLOCK)

        def trouble() -> str:
            tell()
            heard = board.get("ros_bridge")
            return heard.status.last_error if heard is not None and "not written" in heard.status.last_error else ""

        said = eventually(trouble)
        assert "the joints of 'robot' were not written" in said and "in the security policy" in said
        eventually(lambda: memory.get_transform("world", "base"))
        assert "robot" not in memory
        board.close()


def test_without_a_grant_the_bridge_is_refused(secured: Secured, router: Router) -> None:
    policy = secured.keys / "policy.json"
    rules = json.loads(policy.read_text())
    del rules["agents"]["ros_bridge"]
    policy.write_text(json.dumps(rules))
    keys, place = str(secured.keys), ["--ros-router", router.endpoint, "--graph", secured.graph]
    for arguments, code, environment in (
        (["run", str(secured.files["without"]), "--security", keys], 1, {}),
        (["ros", "run", *place], 2, {"DSR_SECURITY": keys}),
    ):
        said = " ".join(secured.command(*arguments, expect=code, **environment).split())
        assert "agent 'ros_bridge' has no certificate" in said and "dsr security add" in said, said
        assert "Traceback" not in said
