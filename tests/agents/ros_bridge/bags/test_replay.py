"""A bag is replayed: frames, joints and images of somebody else's robot arrive in the graph, live and in lockstep."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from typer.testing import CliRunner

from agents.replay import ReplayedGraph
from agents.replay.anew import run_anew
from agents.replay.cli import app
from agents.replay.player import Player
from agents.ros_bridge.mapping.images import IMAGE
from dsr import Memory
from dsr.clock import ManualClock
from dsr.config import plugins
from dsr.errors import ConfigError
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.intrinsics import read_intrinsics
from tests.agents.ros_bridge.bags.follower import Follower
from tests.agents.ros_bridge.bags.made import (
    BEGIN,
    COLOR,
    DEPTH,
    FORMATS,
    INTRINSICS,
    MOUNT,
    SECONDS,
    TYPES,
    Message,
    color,
    depth,
    drive,
    driven,
    joints,
    mcap,
)

STEP = 0.02
DRIVE = drive()


class Theatre:
    """A replay on a network in memory, and somebody who follows it."""

    def __init__(self, path: Path, **options: Any) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.audience, self.stage = self._join("audience"), self._join("replay")
        self.frames = self.audience.frames("camera")
        self.source = ReplayedGraph(path)
        self.player = Player(self.source, self.stage, **options)
        self._deliver()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.player.step(self.clock.monotonic())
            self._deliver()
            self.clock.advance(STEP)

    def seek(self, time: float) -> None:
        self.player.seek(time)
        self._deliver()

    def _join(self, name: str) -> Memory:
        memory = Memory("replay", name, transport=self.network.connect(name), clock=self.clock)
        memory.replica.synchroniser.joined = True
        return memory

    def _deliver(self) -> None:
        self.stage.flush()
        self.network.deliver()
        self.audience.poll()


def check(memory: Memory, time: float) -> None:
    """The graph is that of `time` (s since the beginning), up to two steps of the bridge."""
    pose = memory.edge("world", "base_link", "RT")["pose"]
    since = round((pose.stamp - BEGIN) * 50) / 50
    assert 0.0 <= time - since <= 3.0 * STEP
    metres, radians = driven(since).distance(pose)
    assert metres < 1e-9 and radians < 1e-9
    metres, radians = MOUNT.distance(memory.transform("base_link", "eye"))
    assert metres < 1e-9 and radians < 1e-9
    robot = memory.node("robot")
    assert robot["joint_names"] == "a,b"
    assert robot["joint_positions"] == pytest.approx(joints(since), abs=0.2 * STEP)


@pytest.mark.parametrize("format", ["mcap folder, chunks of zstd", "db3 folder", "ROS 1"])
def test_frames_joints_and_images_of_a_bag_arrive(format: str, tmp_path: Path) -> None:
    theatre = Theatre(FORMATS[format](tmp_path, DRIVE))
    for _ in range(3):
        theatre.run(1.0)
        time = theatre.player.time
        check(theatre.audience, time)
        frame = theatre.frames.latest()
        assert frame is not None
        number = round((frame.stamp - BEGIN) * 10)
        assert 0.0 <= time - number / 10 < 0.15
        np.testing.assert_array_equal(frame.arrays["color"], color(number))
        np.testing.assert_allclose(frame.arrays["depth"], depth(number) / 1000.0, rtol=1e-6)
        assert frame.meta["fx"] == INTRINSICS.fx
    camera = theatre.audience.node("camera")
    assert camera["stream"] == "camera" and read_intrinsics(camera) == INTRINSICS
    assert theatre.audience.transform("base_link", "camera").distance(MOUNT) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert theatre.source.index.findings() == []


def test_a_bag_pauses_seeks_and_changes_its_speed(bag: Path) -> None:
    theatre = Theatre(bag, speed=2.0, pause_at=1.5)
    theatre.run(1.0)
    assert theatre.player.time == pytest.approx(1.5) and not theatre.player.playing
    check(theatre.audience, 1.5)
    for time in (3.5, 0.5, 2.5, 3.9):
        theatre.seek(time)
        check(theatre.audience, time)
    theatre.seek(1.0)
    theatre.player.resume()
    theatre.run(0.5)
    assert theatre.player.time == pytest.approx(2.0, abs=0.1)
    check(theatre.audience, theatre.player.time)
    theatre.run(2.0)
    assert theatre.player.ended


def test_going_back_is_quick_and_leads_to_the_same_graph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.ros_bridge.bags.index._SNAPSHOTS", 1.0)
    path = mcap(tmp_path / "drive.mcap", DRIVE, CompressionType.ZSTD)
    straight, leaping = ReplayedGraph(path), ReplayedGraph(path)
    leaping.at(SECONDS)
    for time in (3.7, 0.4, 3.2, 1.1, 3.7):
        check(straight.at(time), time)
        memory = leaping.at(time)
        check(memory, time)
        assert {node.name for node in memory.nodes()} == {node.name for node in straight.memory.nodes()}
        assert {edge.key for edge in memory.edges()} == {edge.key for edge in straight.memory.edges()}
    assert leaping.index.skips_to(3.9, 0.0)
    first = next(iter(leaping.index.read_for(3.9)))
    assert first.topic == "snapshot" and first.time == pytest.approx(1.0, abs=0.05)


def test_an_agent_runs_on_a_bag_in_lockstep(bag: Path, tmp_path: Path) -> None:
    system = tmp_path / "robot.toml"
    system.write_text(
        "graph = 'robot'\n"
        "[[agent]]\nname = 'follower'\nclass = 'tests.agents.ros_bridge.bags.follower:Follower'\n"
        "[[agent]]\nname = 'ros_bridge'\nclass = 'agents.ros_bridge:RosBridge'\n"
        "[agent.config]\nworld_frame = 'map'\n",
        encoding="utf-8",
    )
    runs = []
    for _ in range(2):
        Follower.seen.clear()
        outcome = run_anew(bag, ["follower"], system=str(system))
        assert outcome.failures == [] and any("its frame 'map' is the world" in note for note in outcome.notes)
        runs.append(list(Follower.seen))
    assert runs[0] == runs[1] and len(runs[0]) == pytest.approx(SECONDS / 0.1, abs=2)
    for stamp, number, x in runs[0]:
        assert number == round((stamp - BEGIN) * 10)
        assert x == pytest.approx((driven(number / 10) @ MOUNT).t[0], abs=1e-6)  # a float has stamps of 0.24 us


def test_the_settings_of_the_bridge_say_how_a_bag_is_understood(bag: Path) -> None:
    cameras = {"eye_left": {"color": COLOR, "depth": DEPTH}}
    receive = {"tf": True, "joints": {"/joint_states": "arm"}, "cameras": cameras}
    source = ReplayedGraph(bag, {"ros_bridge": {"world_frame": "map", "receive": receive}})
    memory = source.at(2.0)
    assert "odom" in memory and memory.get_edge("odom", "base_link", "RT") is not None
    assert "joint_names" in memory.node("arm") and "eye_left" in memory
    with pytest.raises(ConfigError, match=r"no topic /nope; there are /camera/color/camera_info, "):
        ReplayedGraph(bag, {"ros_bridge": {"receive": {"cameras": {"eye": {"color": "/nope"}}}}})
    with pytest.raises(ConfigError, match="settings of ros_bridge"):
        ReplayedGraph(bag, {"ros_bridge": {"wordl_frame": "map"}})


def test_what_cannot_be_read_is_counted_and_told_and_the_rest_is_played(tmp_path: Path) -> None:
    broken = b"\0\1\0\0\xff\xff\xff\xff"
    mess = [
        Message(BEGIN + 1.0, "/tf", "tf2_msgs/msg/TFMessage", broken),
        Message(BEGIN + 1.1, "/joint_states", "sensor_msgs/msg/JointState", b""),
        Message(BEGIN + 1.2, COLOR, "sensor_msgs/msg/Image", broken),
        Message(BEGIN + 1.3, "/strange", "my_msgs/msg/Own", broken),
        Message(BEGIN + 1.4, "/tf", "tf2_msgs/msg/TFMessage", broken[:3]),
    ]
    path = mcap(tmp_path / "drive.mcap", sorted([*DRIVE, *mess], key=lambda one: one.time), CompressionType.ZSTD)
    source = ReplayedGraph(path)
    check(source.at(3.5), 3.5)
    source.at(source.duration)
    source.restart()
    found = source.index.findings()
    assert found[0] == "left out: 4 malformed"
    assert len(found) == 4 and any("JointState" in text for text in found)
    assert any("/strange (my_msgs/msg/Own: its type is not known)" in note for note in source.index.notes)


def test_a_gap_of_years_takes_no_time(tmp_path: Path) -> None:
    years = 3e8  # s
    later = [one._replace(time=one.time + years) for one in DRIVE[-8:] if one.topic == "/joint_states"]
    source = ReplayedGraph(mcap(tmp_path / "a.mcap", [*DRIVE, *later], CompressionType.ZSTD))
    assert source.duration > years and len(list(source.index.read_for(0.0))) < 2000
    memory = source.at(source.duration)
    assert memory.node("robot").written_at("joint_positions") == pytest.approx(BEGIN + years + SECONDS, abs=0.2)


def test_the_root_of_the_frames_is_the_world_and_depth_that_is_not_aligned_a_camera_of_its_own(tmp_path: Path) -> None:
    moved = [one for one in DRIVE if one.topic != DEPTH]
    for number in range(3):
        image = TYPES.decode(IMAGE, next(one.cdr for one in DRIVE if one.topic == DEPTH))
        image.header.frame_id = "depth_optical"
        moved.append(Message(BEGIN + 0.1 * number, DEPTH, IMAGE, TYPES.encode(IMAGE, image)))
    path = mcap(tmp_path / "a.mcap", sorted(moved, key=lambda one: one.time), CompressionType.NONE)
    notes = ReplayedGraph(path).index.notes
    assert "its frame 'odom' is the world" in notes[0]
    assert f"camera 'camera' from {COLOR}," in notes[0]
    assert f"camera 'camera_depth_image_raw' from {DEPTH}" in notes[0]


@pytest.mark.parametrize(
    ("image", "camera"),
    [("/cam/0/image", "cam"), ("image", "image"), ("/a b/\x1b[31mü/image", "a-20-b"), ("/a.b/image", "a-2e-b")],
)
def test_topics_may_have_names_that_ros_2_has_not(tmp_path: Path, image: str, camera: str) -> None:
    """Bags of ROS 1, and files that others write."""
    drive = [one._replace(topic=image) if one.topic == COLOR else one for one in DRIVE]
    odd = [one._replace(topic=name) for one in DRIVE if one.topic == COLOR for name in ("", "/", "/" + "x" * 200)]
    theatre = Theatre(mcap(tmp_path / "a.mcap", [*drive, *odd[:3]], CompressionType.NONE))
    theatre.run(0.5)
    check(theatre.audience, 0.5)
    assert theatre.audience.node(camera).type == "camera"
    assert "its name is none that a topic can have" in theatre.source.index.notes[1]


def test_the_command_plays_a_bag(bag: Path) -> None:
    options = ["--graph", f"bag_{os.getpid()}", "--speed", "max", "--no-stay", "--set", "ros_bridge.world_frame=odom"]
    done = CliRunner().invoke(app, [str(bag), *options])
    assert done.exit_code == 0, done.output
    assert "taken from the bag" in done.output and "not taken: /note (std_msgs/msg/String)" in done.output


def test_settings_of_an_agent_that_does_not_run_are_refused(bag: Path) -> None:
    done = CliRunner().invoke(app, [str(bag), "--set", "surprise.x=1"])
    assert isinstance(done.exception, ConfigError) and "--set surprise: no such agent runs" in str(done.exception)


def test_without_the_extra_it_is_told_what_to_install(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Missing:
        names = ("ros",)
        value = "agents.ros_bridge.bags.index:BagIndex"

        def __init__(self, **which: str) -> None:
            self._which = which

        def __iter__(self) -> Any:
            return iter([self])

        def load(self) -> None:
            raise ModuleNotFoundError("No module named 'rosbags'", name="rosbags")

    monkeypatch.setattr(plugins, "entry_points", Missing)
    with pytest.raises(ConfigError, match=r"pip install 'dsr-memory\[ros\]'"):
        ReplayedGraph(bag)
