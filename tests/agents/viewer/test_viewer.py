"""The viewer shows what is in the memory, on a manual clock, and its file can be read back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import numpy as np
import pytest

from agents.viewer import palette
from agents.viewer.blueprint import make_blueprint
from agents.viewer.places import TURN
from dsr import Alternative, Frame, Pose, Whereabouts
from dsr.believing.distribution import ATTRIBUTE as WHEREABOUTS
from dsr.believing.distribution import encoded
from dsr.clock import WALL_CLOCK
from dsr.runtime.logs import LogRecord
from dsr.runtime.status import State, Status, encode_status
from dsr.timeline import Chronicle
from dsr.vocabulary.perceived import MOST_CAMERAS
from dsr.vocabulary.scenario_start import Start, start_key


def rgba(color: palette.Color) -> int:
    red, green, blue = color
    return red << 24 | green << 16 | blue << 8 | 255


def send_noise(stage: Any, images: int) -> None:
    """Let the camera send images that take much room, and wait until each is in the file."""
    generator = np.random.default_rng(0)
    for _ in range(images):
        noise = generator.integers(0, 256, (480, 640, 3), dtype=np.uint8)
        stage.memory.put_frame("camera", Frame(stage.clock.now(), {"color": noise}, {}))
        before = written(stage.folder)
        stage.run(0.5)
        deadline = WALL_CLOCK.now() + 10.0
        while written(stage.folder) == before and WALL_CLOCK.now() < deadline:  # rerun writes from a thread of its own
            WALL_CLOCK.wait(threading.Event(), 0.01)


def written(folder: Path) -> list[tuple[str, int]]:
    """The files of the view with their sizes."""
    return sorted((file.name, file.stat().st_size) for file in folder.glob("*.rrd"))


def test_percepts_and_beliefs_are_drawn_apart(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run()
    shown = stage.finish()
    for what, height in (("percepts", 0.03), ("beliefs", 0.02)):
        centres = shown.values(f"/world/{what}", "Boxes3D:centers")[-1]
        np.testing.assert_allclose(centres, [(0, 0, height), (0.1, 0, height)], atol=1e-6)
    assert shown.values("/world/percepts", "Boxes3D:colors")[-1] == [rgba(palette.PERCEPT)] * 2
    assert shown.values("/world/beliefs", "Boxes3D:colors")[-1] == [rgba(palette.BELIEF)] * 2
    fills = [shown.values(f"/world/{what}", "Boxes3D:fill_mode")[-1] for what in ("percepts", "beliefs")]
    assert fills[0] != fills[1]


def test_where_things_could_be_otherwise_is_drawn_translucent(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    alternatives = (
        Alternative(weight=0.7, pose=Pose((0.0, 0.0, 0.02))),
        Alternative(weight=0.2, pose=Pose((0.3, 0.2, 0.02)), reason="taken", worlds=(1,)),
        Alternative(weight=0.1, pose=None, reason="gone", worlds=(2,)),
    )
    told = Whereabouts("cube_3", alternatives, ("cube_3",), (0.7, 0.2, 0.1))
    stage.memory.update_node("cube_3", **{WHEREABOUTS: encoded(told)})
    stage.run()
    stage.memory.update_node("cube_3", **{WHEREABOUTS: ""})
    stage.run()
    shown = stage.finish()
    centres = shown.values("/world/alternatives", "Boxes3D:centers")
    np.testing.assert_allclose(centres[-2], [(0.3, 0.2, 0.02)], atol=1e-6)
    assert len(centres[-1]) == 0, "nothing is left of what is not believed any more"
    (color,) = shown.values("/world/alternatives", "Boxes3D:colors")[-2]
    assert color >> 8 == rgba(palette.ALTERNATIVE) >> 8 and 0 < color & 255 < 128
    assert shown.values("/world/alternatives", "Boxes3D:labels")[-2] == ["cube_3 20 %"]
    assert len(shown.values("/world/beliefs", "Boxes3D:centers")[-1]) == 2


def test_a_percept_is_a_ghost_only_where_the_belief_differs(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.memory.add_edge("world", "cube_4", "Virtual_RT", pose=Pose((0.1, 0.0, 0.0305)))
    stage.run()
    shown = stage.finish()
    np.testing.assert_allclose(shown.values("/world/percepts", "Boxes3D:centers")[-1], [(0, 0, 0.03)], atol=1e-6)
    assert len(shown.values("/world/beliefs", "Boxes3D:centers")[-1]) == 2


def test_a_percept_without_a_belief_is_a_ghost(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.memory.remove_edge("world", "cube_3", "Virtual_RT")
    stage.run()
    assert len(stage.finish().values("/world/percepts", "Boxes3D:centers")[-1]) == 1


def test_what_is_surprising_is_marked_for_a_moment_longer(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run()
    stage.memory.update_node("cube_4", surprising=True)
    stage.run(0.3)
    stage.memory.update_node("cube_4", surprising=False)
    stage.run(3.0)
    marks = stage.finish().values("/world/surprising", "Boxes3D:centers")
    assert [len(boxes) for boxes in marks] == [0, 1, 0]
    np.testing.assert_allclose(marks[1], [(0.1, 0.0, 0.02)], atol=1e-6)


def test_what_is_held_and_where_the_arm_is_are_drawn(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    memory = stage.memory
    memory.add_node("gripper", "gripper", bounds=(-0.1, -0.2, 0.0, 0.3, 0.2, 0.1))
    memory.add_edge("world", "gripper", "RT", pose=Pose((0.0, 0.0, 1.0)))
    memory.add_edge("gripper", "cube_4", "grasping")
    stage.run()
    shown = stage.finish()
    colors = [rgba(palette.BELIEF), rgba(palette.HELD)]
    assert shown.values("/world/beliefs", "Boxes3D:colors")[-1] == colors
    np.testing.assert_allclose(shown.values("/world/robot/bounds", "Boxes3D:centers")[-1], [(0.1, 0, 1.05)], atol=1e-6)
    sizes = shown.values("/world/robot/bounds", "Boxes3D:half_sizes")[-1]
    np.testing.assert_allclose(sizes, [(0.2, 0.2, 0.05)], atol=1e-6)


def test_an_object_that_is_gone_is_not_drawn_any_more(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run()
    stage.memory.remove_node("cube_3")
    stage.run()
    assert [len(boxes) for boxes in stage.finish().values("/world/beliefs", "Boxes3D:centers")][-1] == 1


def test_the_table_lies_below_its_frame(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table()
    stage.run()
    shown = stage.finish()
    np.testing.assert_allclose(shown.values("/world/table", "Boxes3D:centers")[-1], [(0, 0, -0.02)], atol=1e-6)
    np.testing.assert_allclose(shown.values("/world/table", "Boxes3D:half_sizes")[-1], [(0.5, 0.4, 0.02)], atol=1e-6)


def test_links_of_the_robot_join_its_frames(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table()
    memory = stage.memory
    for name, kind in (("arm", "arm"), ("arm_link_1", "body"), ("gripper", "gripper")):
        memory.add_node(name, kind)
    memory.add_edge("world", "arm", "RT", pose=Pose())
    memory.add_edge("arm", "arm_link_1", "RT", pose=Pose((0.0, 0.0, 0.3)))
    memory.add_edge("arm_link_1", "gripper", "RT", pose=Pose((0.2, 0.0, 0.0)))
    memory.update_node("gripper", opening=0.06)
    stage.run()
    shown = stage.finish()
    assert sorted(shown.values("/world/robot/links", "Capsules3D:lengths")[-1]) == pytest.approx([0.2, 0.3])
    fingers = np.array(shown.values("/world/robot/grippers", "Boxes3D:centers")[-1])[1:]
    assert abs(fingers[0, 0] - fingers[1, 0]) == pytest.approx(0.072)


def test_the_graph_is_logged_only_when_it_changes(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run()
    for _ in range(5):
        stage.memory.update_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.2, 0.0, 0.02), stamp=stage.clock.now()))
        stage.run(0.2)
    stage.memory.add_edge("cube_3", "table", "on", source="contact", since=1.0)
    stage.run()
    shown = stage.finish()
    nodes = {entity.removeprefix("/graph/nodes/") for entity in shown.entities if entity.startswith("/graph/nodes/")}
    assert nodes == {"world", "table", "camera", "cube_3"}
    places = shown.values("/graph/nodes/cube_3", "Points2D:positions")
    assert len(places) <= 3  # what came before the first tick, the rest of the table, the relation
    assert len(shown.values("/graph/edges/on/ends", "Arrows2D:vectors")) == 1


def test_the_selected_node_tells_its_attributes_and_where_it_is(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run()
    for _ in range(20):
        stage.memory.update_edge("world", "cube_3", "Virtual_RT", pose=Pose((0.2, 0.0, 0.02), stamp=stage.clock.now()))
        stage.run(0.1)
    stage.memory.update_node("cube_3", perceived=False)
    stage.memory.remove_edge("world", "cube_3", "Virtual_RT")
    stage.run(2.0)
    shown = stage.finish()
    entity = "/graph/nodes/cube_3"
    assert shown.values(entity, "node:type")[-1] == ["cube"]
    assert shown.values(entity, "node:size")[-1] == ["0.04, 0.04, 0.04"]
    assert [told[0] for told in shown.values(entity, "node:perceived")][-1] == "False"
    places = [told[0] for told in shown.values(entity, "node:Virtual_RT in world [m]")]
    assert "0.200, 0.000, 0.020" in places and places[-1] == "" and len(places) <= 5


def test_what_left_the_graph_leaves_the_view(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run()
    stage.memory.remove_node("cube_3")
    stage.run()
    shown = stage.finish()
    assert shown.values("/graph/nodes/cube_3", "Clear:is_recursive")
    assert shown.values("/graph/edges/Virtual_RT", "Clear:is_recursive")


def test_images_and_detections_are_shown(stage: Any) -> None:
    stage.start_viewer(images_hz=5.0)
    stage.build_table()
    stage.run(0.5)
    corners = np.array([[[10, 10], [50, 10], [50, 50], [10, 50]]], np.float32)
    for grey in range(20):
        stage.memory.put_frame("camera", Frame(1.0, {"color": np.full((48, 64, 3), 10 * grey, np.uint8)}, {}))
        detections = {"corners": corners, "ids": np.array([3], np.int32)}
        stage.memory.put_frame("camera/detections", Frame(1.0, detections, {}))
        stage.run(0.1)
    shown = stage.finish()
    image = "/world/cameras/camera/image"
    images = shown.values(image, "EncodedImage:blob")
    assert 9 <= len(images) <= 11
    assert bytes(images[0][0])[:3] == b"\xff\xd8\xff"
    assert shown.values(f"{image}/detections/names", "Points2D:labels")[-1] == ["tag 3"]
    assert len(shown.values(f"{image}/detections", "LineStrips2D:strips")[-1]) == 1
    np.testing.assert_allclose(shown.values(image, "Pinhole:resolution")[-1], [(640, 480)])


@pytest.mark.parametrize(
    "arrays",
    [
        {"color": np.zeros((4, 4), np.uint8)},
        {"color": np.zeros((4, 4, 3), np.float32)},
        {"color": np.zeros((0, 4, 3), np.uint8)},
        {"color": np.zeros((66_000, 1, 3), np.uint8)},
        {},
    ],
)
def test_an_unusable_image_is_counted_and_left_out(stage: Any, arrays: dict[str, np.ndarray]) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    stage.run(0.5)
    stage.memory.put_frame("camera", Frame(1.0, arrays, {}))
    bad = {"corners": np.full((1, 4, 2), np.nan, np.float32), "ids": np.zeros(1, np.int32)}
    stage.memory.put_frame("camera/detections", Frame(1.0, bad, {}))
    stage.run(0.5)
    assert viewer._views.images.unusable == 2
    assert not stage.finish().values("/world/cameras/camera/image", "EncodedImage:blob")


def test_tags_that_are_too_many_are_left_out(stage: Any) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    stage.run(0.5)
    many = {"corners": np.zeros((10_000, 4, 2), np.uint8), "ids": np.zeros(10_000, np.uint8)}
    stage.memory.put_frame("camera/detections", Frame(1.0, many, {}))
    stage.run(0.5)
    assert viewer._views.images.unusable == 1


def test_made_up_cameras_take_no_room_from_those_that_send_images(stage: Any) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    stage.run(0.5)
    stage.memory.put_frame("camera", Frame(1.0, {"color": np.zeros((4, 4, 3), np.uint8)}, {}))
    stage.run(0.5)
    for number in range(200):
        stage.memory.add_node(f"a_{number}", "camera")
    stage.run(0.5)
    stage.memory.put_frame("camera", Frame(2.0, {"color": np.ones((4, 4, 3), np.uint8)}, {}))
    stage.run(0.5)
    images = viewer._views.images
    assert len(images._readers) <= 2 * MOST_CAMERAS and images.cameras == ["camera"]
    assert len(stage.finish().values("/world/cameras/camera/image", "EncodedImage:blob")) == 2


@pytest.mark.parametrize("first", ["honest", "fake"])
def test_all_cameras_of_one_stream_show_its_images_and_detections(stage: Any, first: str) -> None:
    viewer = stage.start_viewer()
    names = {
        "honest": stage.build_table,
        "fake": lambda: stage.memory.add_node("a", "camera", stream="camera"),
    }
    for name in sorted(names, key=lambda name: name != first):
        names[name]()
        stage.run(0.5)
    corners = np.array([[[10, 10], [50, 10], [50, 50], [10, 50]]], np.float32)
    for grey in range(4):
        stage.memory.put_frame("camera", Frame(1.0, {"color": np.full((4, 4, 3), 10 * grey, np.uint8)}, {}))
        stage.memory.put_frame(
            "camera/detections", Frame(1.0, {"corners": corners, "ids": np.array([3], np.int32)}, {})
        )
        stage.run(0.5)
    assert viewer._views.images.cameras == ["a", "camera"]
    shown = stage.finish()
    for name in ("a", "camera"):
        assert len(shown.values(f"/world/cameras/{name}/image", "EncodedImage:blob")) == 4
        assert shown.values(f"/world/cameras/{name}/image/detections/names", "Points2D:labels")[-1] == ["tag 3"]


def test_cameras_that_are_gone_leave_nothing(stage: Any) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    stage.run(0.5)
    stage.memory.put_frame("camera", Frame(1.0, {"color": np.zeros((4, 4, 3), np.uint8)}, {}))
    stage.run(0.5)
    images = viewer._views.images
    assert images._shown
    stage.memory.update_node("camera", stream="other")
    stage.run(0.5)
    assert set(images._readers) == {"other", "other/detections"}
    stage.memory.remove_node("camera")
    stage.run(0.5)
    assert not images.cameras and not images._shown and not images._readers


def test_a_camera_behind_many_made_up_ones_has_its_turn(stage: Any) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    for number in range(2 * MOST_CAMERAS):
        stage.memory.add_node(f"a_{number}", "camera")
    images = viewer._views.images
    for _ in range(round(3 * TURN / 0.5)):
        stage.memory.put_frame("camera", Frame(1.0, {"color": np.zeros((4, 4, 3), np.uint8)}, {}))
        stage.run(0.5)
        assert len(images._readers) <= 2 * MOST_CAMERAS
    assert images.cameras == ["camera"]


def test_a_camera_behind_as_many_as_have_places_that_sent_one_image_each_has_its_turn(stage: Any) -> None:
    viewer = stage.start_viewer()
    fakes = [f"a_{number}" for number in range(MOST_CAMERAS)]
    for name in fakes:
        stage.memory.add_node(name, "camera")
    stage.run(0.5)
    picture = Frame(1.0, {"color": np.zeros((4, 4, 3), np.uint8)}, {})
    for name in fakes:
        stage.memory.put_frame(name, picture)
    stage.run(0.5)
    images = viewer._views.images
    assert images.cameras == sorted(fakes)
    stage.build_table()
    for _ in range(round(3 * TURN / 0.5)):
        stage.memory.put_frame("camera", picture)
        stage.run(0.5)
    assert "camera" in images.cameras


@pytest.mark.parametrize("stream", ["**", "a//b", "#", "/", "a\x1b[2J", "x" * 1000])
def test_a_stream_that_is_no_name_is_counted_and_left_alone(stage: Any, stream: str) -> None:
    viewer = stage.start_viewer()
    stage.build_table()
    stage.memory.update_node("camera", stream=stream)
    stage.run(0.5)
    assert viewer._views.images.unusable > 0 and viewer._views.images._readers == {}


def test_distances_and_errors_are_in_millimetres(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run(0.5)
    truth = {"stamp": 1.0, "objects": {"cube_3": [0.0, 0.0, 0.021, 0.0, 0.0, 0.0, 1.0]}, "robot": []}
    stage.memory.transport.publish(stage.keys.truth(), msgpack.packb(truth))
    stage.run(0.5)
    shown = stage.finish()
    for entity, expected in (("percept_to_belief_mm", 10.0), ("error_mm/percept", 9.0), ("error_mm/belief", 1.0)):
        values = shown.values(f"/series/{entity}/cube_3", "Scalars:scalars")
        assert values[-1] == pytest.approx([expected], abs=1e-6)


def test_an_object_out_of_sight_has_no_percept_error(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.memory.update_node("cube_3", perceived=False)
    stage.run()
    shown = stage.finish()
    assert "/series/percept_to_belief_mm/cube_3" not in shown.entities
    assert shown.values("/world/percepts", "Boxes3D:colors")[-1] == [rgba(palette.UNSEEN_PERCEPT)]


def test_rates_and_log_lines_of_agents_are_shown(stage: Any) -> None:
    stage.start_viewer()
    status = Status(agent="arm", rid="arm-1", pid=1, state=State.READY, rate_hz=49.5)
    record = LogRecord(stage.clock.now(), "WARNING", "arm", "a joint is near its limit")
    stage.memory.transport.publish(stage.keys.status("arm"), encode_status(status))
    stage.memory.transport.publish(stage.keys.log("arm"), msgspec.msgpack.encode(record))
    stage.run()
    shown = stage.finish()
    assert shown.values("/series/rate_hz/arm", "Scalars:scalars") == [[49.5]]
    assert shown.texts("/log/arm") == ["arm: a joint is near its limit"]
    assert shown.values("/log/arm", "TextLog:level") == [["WARN"]]


@pytest.mark.parametrize("payload", [b"", b"\xc1", b"\x93\x01\x02\x03", b"\x80"])
def test_malformed_messages_are_counted_and_dropped(stage: Any, payload: bytes) -> None:
    viewer = stage.start_viewer()
    for key in (stage.keys.status("x"), stage.keys.log("x"), stage.keys.truth()):
        stage.memory.transport.publish(key, payload)
    stage.run(0.3)
    assert (viewer._views.series.malformed, viewer._views.events.malformed) == (2, 1)


@pytest.mark.parametrize("stamp", [float("nan"), float("inf"), 1e300])
def test_a_log_line_of_no_time_is_shown_all_the_same(stage: Any, stamp: float) -> None:
    stage.start_viewer()
    record = LogRecord(stamp, "INFO", "arm", "hello")
    stage.memory.transport.publish(stage.keys.log("arm"), msgspec.msgpack.encode(record))
    stage.run(0.3)
    shown = stage.finish()
    assert shown.values("/agents/arm", "TextLog:text") == [["at no time  arm: hello"]]


def test_only_warnings_of_agents_are_among_the_events(stage: Any) -> None:
    stage.start_viewer()
    for level in ("DEBUG", "INFO", "WARNING", "ERROR"):
        record = LogRecord(stage.clock.now(), level, "arm", f"a word of {level}")
        stage.memory.transport.publish(stage.keys.log("arm"), msgspec.msgpack.encode(record))
    stage.run()
    shown = stage.finish()
    assert shown.texts("/log/arm") == ["arm: a word of WARNING", "arm: a word of ERROR"]
    assert len(shown.texts("/agents/arm")) == 4


def test_an_odd_agent_name_is_shown_as_it_is(stage: Any) -> None:
    stage.start_viewer()
    record = LogRecord(stage.clock.now(), "LOUD", "an agent/of mine", "hello")
    status = Status(agent="an agent/of mine", rid="x", pid=1, state=State.READY)
    stage.memory.transport.publish(stage.keys.log("x"), msgspec.msgpack.encode(record))
    stage.memory.transport.publish(stage.keys.status("x"), encode_status(status))
    stage.run(0.3)
    entities = stage.finish().entities
    assert {r"/agents/an\ agent\/of\ mine", r"/series/rate_hz/an\ agent\/of\ mine"} <= entities


def test_what_happens_in_the_graph_is_told(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3", "cube_4")
    stage.run(1.5)
    stage.memory.add_edge("cube_3", "table", "on", source="contact", since=1.0)
    stage.memory.update_node("cube_3", plausible=False, perceived=True)
    stage.run(1.5)
    stage.memory.remove_edge("cube_3", "table", "on")
    stage.memory.remove_node("cube_4")
    stage.run(1.5)
    texts = stage.finish().texts()
    for line in ("cube_3 on table", "cube_3 no more on table", "cube_4 gone"):
        assert line in texts
    assert not any("plausible" in text or "perceived" in text for text in texts)


def test_what_flickers_is_not_told_and_what_just_came_is_told_at_the_end(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run(1.5)
    for _ in range(5):
        stage.memory.add_edge("cube_3", "table", "on", source="contact", since=1.0)
        stage.memory.add_node("finger", "finger")
        stage.run(0.3)
        stage.memory.remove_edge("cube_3", "table", "on")
        stage.memory.remove_node("finger")
        stage.run(0.3)
    stage.memory.add_node("cube_4", "cube")
    stage.run(0.3)
    texts = stage.finish().texts()
    assert not any(" on " in text or "finger" in text for text in texts)
    assert texts[-1] == "cube_4 appeared"


def test_a_view_of_what_runs_already_listens_before_its_first_look(stage: Any) -> None:
    """It counts from the start that is told, not from a look before."""
    stage.build_table("cube_3")
    stage.start_viewer(listens=1.5)
    stage.run(1.0)
    begun = stage.clock.now() - 40.0
    stage.memory.transport.publish(start_key(stage.keys), msgspec.msgpack.encode(Start(begun)))
    stage.run(2.0)
    times = stage.finish().times("/log/graph")
    assert times and min(times) >= 40.0


def test_a_view_looks_if_nobody_tells_a_start(stage: Any) -> None:
    stage.build_table("cube_3")
    stage.start_viewer(listens=1.5)
    stage.run(3.0)
    assert min(stage.finish().times("/log/graph")) == 0.0


def test_lines_stand_in_the_order_of_their_own_times(stage: Any) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run(1.5)
    Chronicle(stage.memory, "waiter").happened("Pick", ("cube_3", "hand"), stage.clock.now() - 0.7)
    stage.run(1.0)
    shown = stage.finish()
    [time] = shown.times("/log/waiter")
    [text] = [value[0] for value in shown.values("/log/waiter", "TextLog:text")]
    assert text == f"{time:6.1f} s  waiter: Pick cube_3, hand"


def test_a_restart_writes_a_new_file_of_the_same_recording(stage: Any, tmp_path: Path) -> None:
    stage.start_viewer()
    stage.build_table("cube_3")
    stage.run()
    stage.start_viewer()
    stage.run()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["recording-2.rrd", "recording.rrd"]


def test_the_file_holds_the_arrangement(stage: Any) -> None:
    stage.start_viewer()
    stage.run()
    assert stage.finish().blueprints >= 1
    for cameras in ([], ["camera_overhead"], ["camera_overhead", "camera_wrist"]):
        for with_truth in (True, False):
            make_blueprint(cameras, with_truth)


def test_without_a_display_the_file_is_written_all_the_same(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    stage.start_viewer(spawn=True)
    stage.build_table("cube_3")
    stage.run()
    assert "/world/beliefs" in stage.finish().entities


SERVER = """
import os, socket, sys, threading, time
server = socket.create_server(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1])))
"""


def use_program(monkeypatch: pytest.MonkeyPatch, folder: Path, code: str) -> None:
    """Let a Python program stand in for the rerun viewer."""
    fake = folder / "fake_rerun"
    fake.write_text(f"#!{sys.executable}\n{code}")
    fake.chmod(0o755)
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr("agents.viewer.window.native_viewer", lambda: fake)


def test_a_window_that_does_not_start_does_not_matter(
    stage: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    use_program(monkeypatch, tmp_path, "raise SystemExit(3)")
    viewer = stage.start_viewer(spawn=True)
    stage.build_table("cube_3")
    stage.run()
    assert viewer._window is None
    assert "/world/beliefs" in stage.finish().entities


def test_a_window_that_is_closed_does_not_matter(stage: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    accepting = "connections = [server.accept() for _ in range(2)]"
    use_program(
        monkeypatch, tmp_path, f"{SERVER}{accepting}\nwhile not os.path.exists({str(closed)!r}): time.sleep(0.02)"
    )
    viewer = stage.start_viewer(spawn=True)
    stage.build_table("cube_3")
    stage.run()
    assert viewer._window is not None
    closed.touch()
    viewer._window._process.wait(60.0)
    stage.run()
    assert viewer._window is None
    assert "/world/beliefs" in stage.finish().entities


def test_a_window_that_hangs_holds_nothing_up(stage: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    use_program(monkeypatch, tmp_path, f"{SERVER}time.sleep(1000)")
    viewer = stage.start_viewer(spawn=True)
    stage.build_table("cube_3")
    stage.run(3.0)
    assert viewer._window is not None and viewer._window.exit_code is None
    assert "/world/beliefs" in stage.finish().entities
    assert viewer._window.exit_code is not None


def test_a_full_file_goes_on_while_a_window_hangs(
    stage: Any, shown: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rerun lets nothing follow before the window has all that went before; the agent does not wait for that."""
    monkeypatch.setattr("agents.viewer.agent._PIECES", 0.01)
    stage.build_table("cube_3")
    viewer = stage.start_viewer(keep_mb=20.0)
    answers, begin = threading.Event(), viewer._recording.set_sinks
    monkeypatch.setattr(viewer._recording, "set_sinks", lambda *sinks: answers.wait(60.0) and begin(*sinks))
    send_noise(stage, 14)
    stage.memory.add_node("cube_9", "cube", size=(0.04, 0.04, 0.04))
    stage.run(0.5)
    assert viewer._switching is not None and viewer._switching.is_alive()
    answers.set()
    viewer._switching.join(60.0)
    stage.run(0.5)
    assert viewer._switching is None
    viewer.teardown()
    files = ("recording.rrd", "recording-2.rrd")
    assert all("/graph/nodes/cube_9" in shown(stage.folder / name).entities for name in files)


def test_a_killed_viewer_leaves_a_readable_file(tmp_path: Path, shown: Callable[[Path], Any]) -> None:
    script = textwrap.dedent("""
        import sys, time
        from pathlib import Path
        sys.path.insert(0, sys.argv[2])
        from conftest import Stage
        stage = Stage(Path(sys.argv[1]))
        stage.start_viewer()
        stage.build_table("cube_3")
        for step in range(10_000):
            stage.run(0.1)
            time.sleep(0.02)
            if step == 100:  # after 2 s; the file is written once a second
                print("running", flush=True)
    """)
    command = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parent)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"running\n"
        os.kill(process.pid, signal.SIGKILL)
    assert {"/graph/nodes/cube_3", "/world/percepts", "/world/beliefs"} <= shown(tmp_path / "recording.rrd").entities


def test_the_view_takes_no_more_room_than_it_may(
    stage: Any, shown: Callable[[Path], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is full is followed by another one, which shows all that is there; the oldest go."""
    monkeypatch.setattr("agents.viewer.agent._PIECES", 0.01)
    stage.build_table("cube_3", "cube_4")
    Chronicle(stage.memory, "writer").begin("on", ["cube_3", "table"])
    viewer = stage.start_viewer(keep_mb=8.0)
    send_noise(stage, 60)
    viewer.teardown()
    files = sorted(stage.folder.glob("*.rrd"), key=lambda file: file.stat().st_mtime)
    assert stage.folder / "recording.rrd" not in files
    assert 2 < len(files) <= 8
    assert sum(file.stat().st_size for file in files) <= 9e6  # the last file may be larger by what was under way
    newest = shown(files[-1])
    assert newest.blueprints
    assert len(newest.values("/world/beliefs", "Boxes3D:centers")[-1]) == 2
    assert newest.values("/graph/nodes/cube_3", "Points2D:labels") == [["cube_3"]]
    assert newest.values("/timeline/on/cube_3", "StateChange:state") == [["table"]]
    assert newest.values("/world/cameras/camera/image", "EncodedImage:blob")
    assert newest.texts() == []


def test_a_picture_that_stays_the_same_is_written_once(stage: Any) -> None:
    stage.build_table()
    stage.start_viewer()
    stage.memory.update_node("camera", stream="camera")
    for grey in (10, 10, 10, 20):
        color = np.full((48, 64, 3), grey, dtype=np.uint8)
        stage.memory.put_frame("camera", Frame(stage.clock.now(), {"color": color}, {}))
        stage.run(0.5)
    assert len(stage.finish().values("/world/cameras/camera/image", "EncodedImage:blob")) == 2
