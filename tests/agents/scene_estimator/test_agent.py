"""The scene estimator as others see it: percepts come and age, whatever the cameras send."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.drivers import TagReading, TagReadings
from agents.scene_estimator import SceneEstimator
from agents.scene_estimator.color_reader import ColorReader
from agents.scene_estimator.colored import ColoredObject, ColorSighting
from dsr import Frame, Pose
from dsr.errors import AgentError, ConfigError
from dsr.network.transport import Qos
from dsr.vocabulary.intrinsics import Intrinsics

from .conftest import AGE, MARKER, OVERHEAD, PERIOD, SENSORS, Bench, FakeSensor, covariance

CUBE = (MARKER, 0.03, -0.02)
NAME = f"cube_{MARKER}"


@pytest.fixture
def cube(bench: Bench) -> Frame:
    """A picture of a cube that is known."""
    bench.memory.add_node(NAME, "cube", marker_id=MARKER, size=(0.04, 0.04, 0.04))
    return bench.picture(CUBE)


def test_a_percept_has_the_time_of_its_frame_and_a_covariance(bench: Bench, cube: Frame) -> None:
    stamp = bench.clock.now()
    bench.show(cube)
    pose = bench.memory.edge("camera_overhead", NAME, "RT").pose
    assert pose.stamp == stamp
    assert pose.translation == pytest.approx([0.03, -0.02, 0.4], abs=0.003)
    assert np.linalg.eigvalsh(covariance(pose)).min() > 0.0
    assert bench.memory.transform("world", NAME).translation == pytest.approx([0.03, 0.02, 0.0], abs=0.003)
    assert bench.memory.node(NAME)["last_seen"] == stamp
    assert bench.perceived(NAME)


def test_unknown_cubes_appear_once_they_were_seen_steadily(bench: Bench) -> None:
    picture = bench.picture(CUBE, (9, -0.06, 0.0))
    bench.show(picture, ticks=3)
    assert bench.memory.nodes("cube") == []
    bench.show(picture)
    assert [node.name for node in bench.memory.nodes("cube")] == [NAME, "cube_9"]
    assert bench.memory.get_edge("camera_overhead", "cube_9", "RT") is not None


def test_what_left_is_not_perceived_any_more_but_remembered(bench: Bench, cube: Frame) -> None:
    bench.show(cube)
    last = bench.memory.edge("camera_overhead", NAME, "RT").pose
    empty = bench.picture()
    bench.show(empty, ticks=round(AGE / PERIOD) - 1)
    assert bench.perceived(NAME)
    bench.show(empty, ticks=3)
    assert bench.perceived(NAME) is False
    assert bench.memory.edge("camera_overhead", NAME, "RT").pose == last
    bench.show(cube)
    assert bench.perceived(NAME)


def test_percepts_age_when_the_camera_falls_silent(bench: Bench, cube: Frame) -> None:
    bench.show(cube)
    bench.run(AGE - PERIOD)
    assert bench.perceived(NAME)
    bench.run(3 * PERIOD)
    assert bench.perceived(NAME) is False


@pytest.mark.parametrize("pause", [0.0, 5.0])
def test_another_run_takes_over(bench: Bench, cube: Frame, pause: float) -> None:
    bench.show(cube)
    bench.stop()
    bench.clock.advance(pause)
    bench.start()
    bench.run(PERIOD)
    assert bench.perceived(NAME) is (pause == 0.0)
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived(NAME) is False
    bench.show(cube)
    assert bench.perceived(NAME)


def test_a_percept_nobody_knows_the_time_of_gets_a_fresh_start(bench: Bench) -> None:
    bench.memory.add_node("cup", "cup", marker_id=1, perceived=True)
    bench.run(AGE - PERIOD)
    assert bench.perceived("cup")
    bench.run(4 * PERIOD)
    assert bench.perceived("cup") is False


def test_two_cameras_see_one_cube(bench: Bench, cube: Frame) -> None:
    """It is perceived while one of them does."""
    bench.add_camera("camera_wrist", OVERHEAD)
    bench.show(cube, "camera_overhead", "camera_wrist")
    assert {edge.src for edge in bench.memory.edges("RT", dst=NAME)} == {"camera_overhead", "camera_wrist"}
    bench.show(cube, "camera_wrist", ticks=round(2 * AGE / PERIOD))
    assert bench.perceived(NAME)
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived(NAME) is False


def test_nothing_is_published_while_the_camera_moves(bench: Bench, cube: Frame) -> None:
    for step in range(10):
        bench.memory.add_edge("world", "camera_overhead", "RT", pose=moved(bench, 0.01 * step))
        if step < 2:
            bench.run(PERIOD)
        else:
            bench.show(cube)
    assert bench.memory.get_edge("camera_overhead", NAME, "RT") is None
    assert bench.agent.skipped == {"camera moved": 8}
    for _ in range(4):
        bench.memory.add_edge("world", "camera_overhead", "RT", pose=moved(bench, 0.09))
        bench.show(cube)
    assert bench.perceived(NAME)


def moved(bench: Bench, x: float) -> Pose:
    return Pose((x, *OVERHEAD.translation[1:]), OVERHEAD.rotation, bench.clock.now())


def test_nothing_is_published_while_the_camera_has_an_unknown_place(bench: Bench, cube: Frame) -> None:
    """The arm fell silent: its last state is too old to tell."""
    for _ in range(2):
        bench.memory.add_edge("world", "camera_overhead", "RT", pose=moved(bench, 0.0))
        bench.run(PERIOD)
    bench.run(1.0)
    bench.show(cube)
    assert bench.agent.skipped == {"camera moved": 1}
    assert bench.perceived(NAME) is False


def test_frames_of_a_camera_that_is_no_node_yet_are_counted(bench: Bench, cube: Frame) -> None:
    bench.show(cube, "camera_wrist", ticks=2)
    assert bench.agent.skipped == {"no camera node yet": 2}
    bench.add_camera("camera_wrist", OVERHEAD)
    bench.show(cube, "camera_wrist")
    assert bench.perceived(NAME)


def test_bad_frames_are_counted_and_complained_of_once(
    bench: Bench, cube: Frame, caplog: pytest.LogCaptureFixture
) -> None:
    color = cube.arrays["color"]
    wrong: list[dict[str, Any]] = [
        {"arrays": {}},
        {"arrays": {"color": color[..., 0]}},
        {"meta": {}},
        {"meta": {**cube.meta, "fx": 1e300}},
    ]
    for changes in wrong:
        bench.show(msgspec.structs.replace(cube, **changes))
    bench.memory.transport.publish(bench.memory.keys.blob("camera_overhead"), b"\x01\x02", Qos.BULK)
    bench.run(PERIOD)
    assert bench.agent.skipped == {"malformed": len(wrong)}
    assert len([record for record in caplog.records if "skipped" in record.message]) == 1
    bench.show(cube)
    assert bench.perceived(NAME)


def test_a_camera_ahead_of_time_cannot_keep_its_percepts_from_ageing(bench: Bench, cube: Frame) -> None:
    ahead = msgspec.structs.replace(cube, stamp=bench.clock.now() + 1000.0)
    bench.memory.put_frame("camera_overhead", ahead)
    bench.run(PERIOD)
    assert bench.perceived(NAME)
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived(NAME) is False


@pytest.mark.parametrize("kind", ["box", "container", "cup", "ball"])
def test_whatever_object_carries_a_tag_is_tracked(bench: Bench, kind: str) -> None:
    bench.memory.add_node("thing", kind, marker_id=MARKER, size=(0.04, 0.04, 0.04))
    bench.show(bench.picture(CUBE))
    assert bench.perceived("thing")


def test_viewers_are_told_where_in_the_image_the_tags_are(bench: Bench, cube: Frame) -> None:
    shown = bench.memory.frames("camera_overhead/detections")
    stamp = bench.clock.now()
    bench.show(cube)
    found = shown.latest()
    shown.close()
    assert found is not None
    assert found.stamp == stamp
    assert found.arrays["ids"].tolist() == [MARKER]
    assert found.arrays["corners"].shape == (1, 4, 2)


def test_a_tag_sensor_does_without_images(make_bench: Callable[..., Bench], sensor: FakeSensor) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    reading = TagReading(MARKER, (0.0, 0.1, 0.4, 1.0, 0.0, 0.0, 0.0), 0.001, 0.01)
    for wrong in (-1, MARKER, MARKER, MARKER, MARKER):
        sensor.next = TagReadings(bench.clock.now(), [msgspec.structs.replace(reading, marker_id=wrong)])
        stamp = bench.clock.now()
        bench.run(PERIOD)
    assert bench.agent.skipped == {"malformed": 1}
    pose = bench.memory.edge("camera_overhead", NAME, "RT").pose
    assert pose.stamp == stamp
    assert pose.translation == pytest.approx([0.0, 0.1, 0.4])
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived(NAME) is False
    bench.runner.teardown()
    assert sensor.closed


def test_a_tag_sensor_tells_its_intrinsics(make_bench: Callable[..., Bench], sensor: FakeSensor) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    sensor.next = TagReadings(bench.clock.now(), [], Intrinsics(600.0, 601.0, 319.5, 239.5, 640, 480))
    bench.run(PERIOD)
    node = bench.memory.node("camera_overhead")
    assert [node[name] for name in ("fx", "fy", "cx", "cy", "width", "height")] == [600, 601, 319.5, 239.5, 640, 480]


def test_a_driver_that_does_not_exist_is_a_configuration_error(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    bench.stop()
    bench.config = {"tag_sensors": {"camera_overhead": {"driver": "nowhere:Sensor"}}}
    with pytest.raises(ConfigError, match="cannot be loaded"):
        bench.start()
    bench.runner.teardown()
    assert ["cannot be loaded" in record.message for record in caplog.records] == [True]


@pytest.mark.parametrize("wrong", [{"tag_ratio": 0.0}, {"max_age": -1.0}, {"noise": {"bias": 1.0}}, {"camera": "x"}])
def test_wrong_configurations_are_refused(make_bench: Callable[..., Bench], wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="scene_estimator"):
        make_bench(**wrong)


def test_it_writes_only_what_it_declares(bench: Bench) -> None:
    assert "Virtual_RT" not in SceneEstimator.writes.edges
    with pytest.raises(AgentError):
        bench.own.update_node("camera_overhead", surprising=True)


def test_where_tags_are_read_no_colour_is_fitted(bench: Bench, cube: Frame, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[list[str]] = []

    def read(_: ColorReader, __: Frame, objects: list[ColoredObject], ___: Pose) -> list[ColorSighting]:
        looked.append([known.name for known in objects])
        return []

    monkeypatch.setattr(ColorReader, "read", read)
    bench.memory.update_node(NAME, color=(0.9, 0.1, 0.1))
    bench.run(PERIOD)
    bench.show(cube, ticks=3)
    empty = bench.picture()
    bench.show(empty, ticks=round(AGE / PERIOD) - 1)
    assert looked == [], "it may be blurred, or a finger is on it"
    bench.show(empty, ticks=3)
    assert looked and {*map(tuple, looked)} == {(NAME,)}
    bench.show(cube, ticks=2)
    count = len(looked)
    bench.show(cube, ticks=3)
    assert len(looked) == count


def test_a_camera_without_depth_is_told_where_only_depth_would_show_a_thing(
    bench: Bench, cube: Frame, caplog: pytest.LogCaptureFixture
) -> None:
    flat = msgspec.structs.replace(cube, arrays={"color": cube.arrays["color"]})
    bench.show(flat, ticks=3)
    assert bench.agent.degraded == "" and bench.perceived(NAME)  # all that is known has a tag
    bench.memory.add_node("ball", "ball", size=(0.05, 0.05, 0.05), color=(0.9, 0.1, 0.1))
    bench.memory.put_frame("camera_overhead", msgspec.structs.replace(flat, stamp=bench.clock.now()))
    bench.exchange(0.0)
    bench.runner.tick(bench.clock.now())
    assert bench.agent.degraded == "no depth from camera_overhead: only tags are recognised there"
    assert bench.agent.skipped["no depth"] == 1 and "camera_overhead gives no depth" in caplog.text
    bench.memory.put_frame("camera_overhead", msgspec.structs.replace(cube, stamp=bench.clock.now()))
    bench.exchange(0.05)
    bench.runner.tick(bench.clock.now())
    assert bench.agent.degraded == ""
