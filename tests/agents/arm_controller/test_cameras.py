"""Camera frames: forwarded unchanged, once, with their intrinsics in the graph."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dsr import Frame

from .conftest import HOME, Bench

LENS: dict[str, float | int | str] = {"fx": 600.0, "fy": 601.0, "cx": 319.5, "cy": 239.5}


def frame(stamp: float, **meta: float | int | str) -> Frame:
    return Frame(stamp, {"color": np.full((48, 64, 3), 7, np.uint8)}, {**LENS, **meta})


@pytest.fixture
def bench(make_bench: Callable[..., Bench]) -> Bench:
    return make_bench(cameras={"camera_overhead": {"driver": "fake:Camera", "name": "overhead"}})


def test_each_frame_arrives_once_and_unchanged(bench: Bench) -> None:
    reader = bench.memory.frames("camera_overhead")
    bench.cameras["overhead"].next = sent = frame(12.5)
    bench.run(0.04)
    received = reader.latest()
    assert received is not None
    assert (received.stamp, received.meta) == (12.5, sent.meta)
    assert np.array_equal(received.arrays["color"], sent.arrays["color"])
    bench.run(0.04)
    assert reader.latest() is None
    reader.close()


def test_intrinsics_are_written_when_they_change(bench: Bench) -> None:
    camera, node = bench.cameras["overhead"], bench.memory.node("camera_overhead")
    watch = bench.memory.watch(node_type="camera", attribute="fx")
    for stamp, focal in ((1.0, 600.0), (2.0, 600.0), (3.0, 900.0)):
        camera.next = frame(stamp, fx=focal)
        bench.run(0.02)
        assert bool(watch.poll()) == (stamp != 2.0)
        assert node["fx"] == focal
    assert [node[name] for name in ("fy", "cx", "cy", "width", "height")] == [601.0, 319.5, 239.5, 64, 48]
    assert node["stream"] == "camera_overhead"


def test_a_frame_without_intrinsics_is_forwarded_with_one_complaint(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    reader = bench.memory.frames("camera_overhead")
    for stamp in (1.0, 2.0):
        bench.cameras["overhead"].next = frame(stamp, fx="wide")
        bench.run(0.02)
        assert reader.latest() is not None
    assert "fx" not in bench.memory.node("camera_overhead")
    assert len([record for record in caplog.records if "no agent can measure" in record.message]) == 1
    assert "fx missing" in bench.agent.degraded


def test_a_driver_of_a_camera_that_fails_does_not_stop_the_arm(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> Frame:
        raise RuntimeError("the library is gone")

    monkeypatch.setattr(bench.cameras["overhead"], "frame", fail)
    bench.memory.update_node("arm", target_joints=tuple(np.array(HOME) + 0.2), target_speed=0.8)
    bench.run(1.1)
    assert bench.status == "reached" and "the library is gone" in bench.agent.degraded


def test_a_camera_that_is_gone_is_told_and_the_arm_still_moves(bench: Bench) -> None:
    camera = bench.cameras["overhead"]
    camera.trouble, camera.counts = "unplugged", {"lost": 1}  # type: ignore[attr-defined]
    bench.run(0.1)
    assert bench.agent.degraded == "camera 'camera_overhead': unplugged"
    assert bench.agent.counts == {"camera_overhead lost": 1}
    bench.memory.update_node("arm", target_joints=tuple(np.array(HOME) + 0.2), target_speed=0.8)
    bench.run(1.1)
    assert bench.status == "reached"
    camera.trouble = ""  # type: ignore[attr-defined]
    bench.run(0.1)
    assert bench.agent.degraded == ""


def test_cameras_go_on_while_the_arm_is_silent(bench: Bench) -> None:
    reader = bench.memory.frames("camera_overhead")
    bench.run(1.0, silent=True)
    bench.cameras["overhead"].next = frame(1.0)
    bench.run(0.02, silent=True)
    assert reader.latest() is not None


def test_devices_are_released_at_the_end(bench: Bench) -> None:
    bench.run(0.1)
    bench.runner.teardown()
    assert bench.arm.closed
    assert bench.cameras["overhead"].closed
