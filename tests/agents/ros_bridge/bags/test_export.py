"""Exported bags hold what the recorded graph held: read by libraries that we did not write with, and played again.

With `DSR_FOXGLOVE` naming a folder in which `npm install @mcap/core @foxglove/rosmsg @foxglove/rosmsg2-serialization
fzstd` was done, Foxglove's own decoders read them, too.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from typer.testing import CliRunner

from agents.recorder.cli import app
from agents.recorder.export import ExportSelection
from agents.replay import ReplayedGraph
from agents.ros_bridge.bags.export import ExportedBag, export_bag
from dsr import Frame, Pose
from dsr.errors import ConfigError
from dsr.runtime.status import State, Status, encode_status
from tests.agents.recorder.world import KEYS, World

SECONDS = 6
FOXGLOVE = os.environ.get("DSR_FOXGLOVE", "")
MOUNT = Pose.from_rotvec((0.0, 0.1, 0.9), (3.0, 0.1, 0.0))
INTRINSICS = {"fx": 200.0, "fy": 201.0, "cx": 79.5, "cy": 59.5, "width": 160, "height": 120}
COVARIANCE = np.diag([1e-4, 4e-4, 9e-4, 1e-3, 2e-3, 3e-3])
TOPICS = {
    "/tf": "tf2_msgs/msg/TFMessage", "/tf_static": "tf2_msgs/msg/TFMessage",
    "/dsr/joint_states": "sensor_msgs/msg/JointState", "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/dsr/camera_top/image_raw/compressed": "sensor_msgs/msg/CompressedImage",
    "/dsr/camera_top/depth": "sensor_msgs/msg/Image", "/dsr/camera_top/camera_info": "sensor_msgs/msg/CameraInfo",
    "/dsr/markers": "visualization_msgs/msg/MarkerArray", "/dsr/beliefs": "vision_msgs/msg/Detection3DArray",
    "/dsr/events": "std_msgs/msg/String",
}  # fmt: skip


def seen(second: int, stamp: float) -> Pose:
    return Pose.from_rotvec((0.1 * second, -0.2, 0.3), (0.0, 0.1 * second, 0.2), stamp)


def believed(second: int, stamp: float) -> Pose:
    return Pose.from_rotvec((0.1 * second, -0.21, 0.3), (0.0, 0.0, 0.1), stamp, COVARIANCE)


def picture(second: int) -> np.ndarray:
    image = np.full((120, 160, 3), (10 * second, 90, 200), np.uint8)
    image[:40, :50] = (200, 20 * second, 0)
    return image


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A cube that is seen and believed, an arm, a camera, a status; the recording is closed."""
    world = World(tmp_path_factory.mktemp("run"))
    memory = world.memory
    memory.add_node("world", "world")
    memory.add_node("arm", "arm", joint_names="a,b", joint_positions=[0.0, 0.5], joint_velocities=[0.0, 0.0])
    memory.add_node("cube_3", "cube", size=(0.04, 0.05, 0.06), color=(1.0, 0.5, 0.0))
    memory.add_node("table", "table", size=(1.0, 0.8, 0.02))
    memory.add_node("camera_top", "camera", stream="top_images", **INTRINSICS)
    memory.add_edge("world", "camera_top", "RT", pose=MOUNT)
    memory.add_edge("world", "table", "RT", pose=Pose((0.0, 0.0, 0.0)))
    world.run(0.5)
    recorder = world.start_recorder(frames_hz=10.0, still_hz=10.0)
    world.run(0.5)
    for second in range(SECONDS):
        now = world.clock.now()
        memory.add_edge("world", "cube_3", "RT", pose=seen(second, now))
        memory.add_edge("world", "cube_3", "Virtual_RT", pose=believed(second, now))
        memory.update_node("arm", joint_positions=[0.1 * second, 0.2], joint_velocities=[0.1, 0.0])
        if second == 3:
            memory.update_node("cube_3", surprising=True)
        depth = np.full((120, 160), 0.5 + 0.1 * second, np.float32)
        memory.put_frame("top_images", Frame(now, {"color": picture(second), "depth": depth}, {"fx": 200.0}))
        status = Status(agent="planner", rid="planner-1", pid=7, state=State.DEGRADED, last_error="slow", stamp=now)
        memory.transport.publish(KEYS.status("planner"), encode_status(status))
        world.run(1.0)
    recorder.teardown()
    return world


def exported(run: World, path: Path, *topics: str, raw: bool = False, **selection: Any) -> ExportedBag:
    return export_bag(ReplayedGraph(run.folder), path, ExportSelection(**selection), topics, raw_images=raw)


@pytest.fixture(scope="module")
def bag(run: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("out") / "run.mcap"
    assert exported(run, path).malformed == 0
    return path


def by_mcap(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, decoded in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(decoded)
    return found


def by_rosbags(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


READERS = {"mcap-ros2-support": by_mcap, "rosbags": by_rosbags}


@pytest.fixture(params=READERS)
def read(request: pytest.FixtureRequest, bag: Path) -> dict[str, list[Any]]:
    return READERS[request.param](bag)


def stamp(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def transforms(messages: list[Any], child: str) -> Iterator[tuple[str, float, tuple[float, ...]]]:
    for message in messages:
        for one in message.transforms:
            if one.child_frame_id == child:
                t, q = one.transform.translation, one.transform.rotation
                yield one.header.frame_id, stamp(one), (t.x, t.y, t.z, q.x, q.y, q.z, q.w)


def test_two_readers_find_all_topics_with_their_types(bag: Path) -> None:
    with bag.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None and reader.get_header().profile == "ros2"
        schemas = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
        assert {topic: schema.name for topic, schema in schemas.items()} == TOPICS
        assert {schema.encoding for schema in schemas.values()} == {"ros2msg"}
        qos = {c.topic: YAML(typ="safe").load(c.metadata["offered_qos_profiles"])[0] for c in summary.channels.values()}
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
    assert qos["/tf_static"]["durability"] == 1 and qos["/tf"]["durability"] == 2
    assert {one["reliability"] for one in qos.values()} == {1}
    with AnyReader([bag]) as reader:
        assert {topic: info.msgtype for topic, info in reader.topics.items()} == TOPICS


def test_frames_are_those_of_the_graph(run: World, read: dict[str, list[Any]]) -> None:
    begin = ReplayedGraph(run.folder).index.begin
    found = list(transforms(read["/tf"], "cube_3"))
    assert len(found) == SECONDS
    for second, (parent, at, pose) in enumerate(found):
        expected = seen(second, at)
        assert parent == "world" and at - begin == pytest.approx(second + 0.5, abs=0.2)
        assert pose == pytest.approx((*expected.t, *expected.q), abs=1e-12)
    beliefs = [pose for _, _, pose in transforms(read["/tf"], "belief/cube_3")]
    assert beliefs == [pytest.approx((*p.t, *p.q), abs=1e-12) for p in (believed(n, 0.0) for n in range(SECONDS))]
    ((parent, at, pose),) = transforms(read["/tf_static"][-1:], "camera_top")
    assert (parent, at) == ("world", 0.0) and pose == pytest.approx((*MOUNT.t, *MOUNT.q), abs=1e-12)


def test_joints_images_and_camera_infos_are_those_of_the_graph(read: dict[str, list[Any]]) -> None:
    states = read["/dsr/joint_states"]
    assert [list(state.name) for state in states] == [["a", "b"]] * len(states)
    assert [list(state.position) for state in states[-SECONDS:]] == [[0.1 * n, 0.2] for n in range(SECONDS)]
    colors, depths = read["/dsr/camera_top/image_raw/compressed"], read["/dsr/camera_top/depth"]
    assert len(colors) == len(depths) == SECONDS
    infos = read["/dsr/camera_top/camera_info"]
    for second, (color, depth, info) in enumerate(zip(colors, depths, infos, strict=True)):
        decoded = cv2.imdecode(np.frombuffer(bytes(color.data), np.uint8), cv2.IMREAD_COLOR)[:, :, ::-1]
        assert np.abs(decoded.astype(int) - picture(second)).mean() < 3.0 and color.format == "jpeg"
        metres = np.frombuffer(bytes(depth.data), np.float32).reshape(depth.height, depth.width)
        np.testing.assert_allclose(metres, 0.5 + 0.1 * second, atol=1e-4)
        assert stamp(color) == stamp(depth) == stamp(info) and color.header.frame_id == "camera_top"
        assert list(info.k) == [200.0, 0.0, 79.5, 0.0, 201.0, 59.5, 0.0, 0.0, 1.0]


def test_beliefs_diagnostics_and_events_are_those_of_the_graph(read: dict[str, list[Any]]) -> None:
    (detection,) = read["/dsr/beliefs"][-1].detections
    assert (detection.id, detection.results[0].hypothesis.class_id) == ("cube_3", "cube")
    size, centre = detection.bbox.size, detection.bbox.center.position
    assert (size.x, size.y, size.z) == (0.04, 0.05, 0.06)
    expected = believed(SECONDS - 1, 0.0)
    assert (centre.x, centre.y, centre.z) == pytest.approx(expected.t)
    turned = expected.rotation_matrix @ COVARIANCE[:3, :3] @ expected.rotation_matrix.T
    covariance = np.reshape(detection.results[0].pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance[:3, :3], turned, atol=1e-12)
    markers = {(marker.ns, marker.type) for marker in read["/dsr/markers"][-1].markers}
    assert {("cube_3", 1), ("cube_3", 9), ("cube_3", 2), ("table", 1)} <= markers  # cube, text, ellipsoid
    (status,) = read["/diagnostics"][-1].status
    level = status.level[0] if isinstance(status.level, bytes) else status.level
    assert (level, status.message) == (1, "slow") and status.name.endswith("planner")
    events = [json.loads(message.data) for message in read["/dsr/events"]]
    assert any(event["kind"] == "surprised" and event["participants"] == ["cube_3"] for event in events)


@pytest.mark.skipif(not FOXGLOVE, reason="DSR_FOXGLOVE names no folder with Foxglove's decoders")
def test_foxglove_reads_the_same(bag: Path) -> None:
    script = Path(__file__).with_name("foxglove.mjs")
    done = subprocess.run(["node", script, bag, FOXGLOVE], capture_output=True, text=True, check=True, timeout=60)
    found, expected = json.loads(done.stdout), by_rosbags(bag)
    assert {topic: len(messages) for topic, messages in found.items()} == {t: len(m) for t, m in expected.items()}
    pairs = [(one["transforms"], other.transforms) for one, other in zip(found["/tf"], expected["/tf"], strict=True)]
    for theirs, ours in ((a, b) for one, other in pairs for a, b in zip(one, other, strict=True)):
        assert theirs["child_frame_id"] == ours.child_frame_id
        assert theirs["transform"]["translation"]["x"] == ours.transform.translation.x
    image, other = found["/dsr/camera_top/depth"][-1], expected["/dsr/camera_top/depth"][-1]
    assert (image["encoding"], image["data"]) == ("32FC1", other.data.tolist())
    assert found["/dsr/beliefs"][-1]["detections"][0]["id"] == "cube_3"
    assert [one["data"] for one in found["/dsr/events"]] == [one.data for one in expected["/dsr/events"]]


def test_a_folder_has_the_metadata_that_rosbag2_asks_for(run: World, tmp_path: Path) -> None:
    counts = exported(run, tmp_path / "bag").messages
    assert sorted(file.name for file in (tmp_path / "bag").iterdir()) == ["bag.mcap", "metadata.yaml"]
    told = YAML(typ="safe").load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (told["storage_identifier"], told["relative_file_paths"]) == ("mcap", ["bag.mcap"])
    assert told["message_count"] == sum(counts.values())
    topics = {one["topic_metadata"]["name"]: one for one in told["topics_with_message_count"]}
    assert {name: one["message_count"] for name, one in topics.items()} == counts
    assert topics["/tf"]["topic_metadata"]["type_description_hash"].startswith("RIHS01_")
    assert {topic: len(messages) for topic, messages in by_rosbags(tmp_path / "bag").items()} == counts
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]


def test_nodes_topics_and_times_can_be_chosen(run: World, tmp_path: Path) -> None:
    exported(run, tmp_path / "a.mcap", "/tf*", nodes=["cube_*"], since=2.0, until=4.2)
    found = by_rosbags(tmp_path / "a.mcap")
    assert found.keys() == {"/tf"}
    xs = [pose[0] for _, _, pose in transforms(found["/tf"], "cube_3")]
    assert xs == pytest.approx([0.1, 0.2, 0.3], abs=1e-9)  # what is known at the beginning comes first
    assert {one.child_frame_id for m in found["/tf"] for one in m.transforms} == {"cube_3", "belief/cube_3"}
    exported(run, tmp_path / "b.mcap", nodes=["arm"])
    arm = by_rosbags(tmp_path / "b.mcap")
    assert "/tf" not in arm and "/dsr/joint_states" in arm and not arm["/dsr/beliefs"][-1].detections
    exported(run, tmp_path / "c.mcap", "/dsr/camera_top/*", raw=True)
    images = by_rosbags(tmp_path / "c.mcap")
    image = images["/dsr/camera_top/image_raw"][-1]
    assert (image.encoding, image.height, image.width) == ("rgb8", 120, 160)
    assert np.abs(image.data.reshape(120, 160, 3).astype(int) - picture(SECONDS - 1)).mean() < 3.0


@pytest.mark.parametrize(
    ("topics", "selection", "said"),
    [
        (["/nope"], {}, "--topic /nope: no such topic"),
        ([], {"nodes": ["cup_*"]}, r"--node cup_\*: no such node"),
        ([], {"since": 99.0}, "--from 99: expected at most"),
        (["/dsr/camera_top/*"], {"nodes": ["arm"]}, "no such topic|nothing to export"),
    ],
)
def test_a_choice_that_fits_nothing_is_told_and_leaves_nothing(
    run: World, tmp_path: Path, topics: list[str], selection: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        exported(run, tmp_path / "a.mcap", *topics, **selection)
    assert list(tmp_path.iterdir()) == []


def test_an_export_that_is_interrupted_leaves_nothing_and_what_is_there_is_kept(run: World, tmp_path: Path) -> None:
    def interrupt(time: float, end: float) -> None:
        assert 0.0 <= time <= end
        if time > 2.0:
            raise KeyboardInterrupt

    source = ReplayedGraph(run.folder)
    with pytest.raises(KeyboardInterrupt):
        export_bag(source, tmp_path / "a.mcap", ExportSelection(), on_progress=interrupt)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.mcap").write_text("mine")
    with pytest.raises(ConfigError, match="expected a file or folder that does not exist"):
        export_bag(source, tmp_path / "a.mcap", ExportSelection())
    assert (tmp_path / "a.mcap").read_text() == "mine"


def test_a_cut_recording_is_exported_up_to_the_cut(run: World, tmp_path: Path) -> None:
    whole = (run.folder / "recording.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: int(0.6 * len(whole))])
    source = ReplayedGraph(cut)
    done = export_bag(source, tmp_path / "out.mcap", ExportSelection())
    assert done.problems and "never closed or cut off" in done.problems[0]
    poses = list(transforms(by_rosbags(tmp_path / "out.mcap")["/tf"], "cube_3"))
    assert 0 < len(poses) < SECONDS


def test_what_is_exported_is_played_again_as_it_was(run: World, bag: Path) -> None:
    recorded, replayed = ReplayedGraph(run.folder), ReplayedGraph(bag)
    for time in (1.7, 3.7, 5.7):
        before, after = recorded.at(time), replayed.at(time)
        for parent, child in (("world", "cube_3"), ("world", "camera_top"), ("camera_top", "cube_3")):
            metres, radians = before.transform(parent, child).distance(after.transform(parent, child))
            assert metres < 1e-9 and radians < 1e-9
        assert after.node("robot")["joint_positions"] == before.node("arm")["joint_positions"]
        assert all(after.node("camera_top")[name] == value for name, value in INTRINSICS.items())


def test_the_command_writes_a_bag_and_tells_what_is_in_it(run: World, tmp_path: Path) -> None:
    target = tmp_path / "a.mcap"
    arguments = ["export", str(run.folder), "--ros2", str(target), "--topic", "/tf", "--topic", "/tf_static"]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    assert told["messages"].keys() == {"/tf", "/tf_static"} and told["path"] == str(target) and not told["malformed"]
    again = CliRunner().invoke(app, arguments)
    assert isinstance(again.exception, ConfigError)
    for wrong, said in (
        ([], "to what"), (["--csv", "x", "--ros2", "y"], "to what"), (["--ros2", "y", "--table", "poses"], "--csv"),
        (["--csv", "x", "--topic", "/tf"], "--ros2"), (["--csv", "x", "--raw-images"], "--ros2"),
    ):  # fmt: skip
        refused = CliRunner().invoke(app, ["export", str(run.folder), *wrong])
        assert isinstance(refused.exception, ConfigError) and said in str(refused.exception)
