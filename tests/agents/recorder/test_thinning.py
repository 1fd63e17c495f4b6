"""Images of a still scene are kept less often, never twice, and with every bit on request."""

from __future__ import annotations

import numpy as np
import pytest

from agents.recorder.images import pack, unpack
from dsr import Frame
from dsr.images.blobs import decode_frame, encode_frame
from tests.agents.recorder.world import World

SHAPE = (240, 320)


class Scene:
    """A camera that sees a dark square on a grey table, with the noise of a sensor."""

    def __init__(self, world: World, noise: float = 4.0) -> None:
        self._world = world
        self._noise = noise
        self._rng = np.random.default_rng(0)

    def frame(self, column: int) -> Frame:
        color = np.full((*SHAPE, 3), 120, np.uint8)
        color[100:120, column : column + 20] = 60
        noisy = color + self._rng.normal(0.0, self._noise, (*SHAPE, 1))
        depth = np.full(SHAPE, 0.8, np.float32)
        return Frame(self._world.clock.now(), {"color": noisy.clip(0, 255).astype(np.uint8), "depth": depth}, {})

    def run(self, seconds: float, column: int) -> None:
        for _ in range(round(seconds * 10)):
            self._world.memory.put_frame("camera", self.frame(column))
            self._world.step()


def stamps(world: World) -> list[float]:
    return [decode_frame(record.payload).stamp for record in world.records() if record.topic == "blob/camera"]


def test_a_still_scene_is_kept_less_often_and_what_moves_at_once(world: World) -> None:
    recorder = world.start_recorder(frames_hz=2.0, still_hz=0.2)
    scene = Scene(world)
    begun = world.clock.now()
    scene.run(20.0, column=100)
    still = len(stamps(world))
    moved = world.clock.now()
    scene.run(2.0, column=103)
    recorder.teardown()
    assert 3 <= still <= 6
    after = [stamp for stamp in stamps(world) if stamp >= moved]
    assert after and after[0] - moved <= 0.11, "3 px are seen at once"
    assert len(after) == 1, "and once"
    assert stamps(world)[0] == pytest.approx(begun, abs=0.11)


def test_what_moves_all_the_time_is_kept_at_the_full_rate(world: World) -> None:
    recorder = world.start_recorder(frames_hz=2.0, still_hz=0.2)
    scene = Scene(world)
    for step in range(100):
        scene.run(0.1, column=step)
    recorder.teardown()
    assert abs(len(stamps(world)) - 20) <= 1


def test_still_scenes_are_seen_without_the_graph_too(world: World) -> None:
    recorder = world.start_recorder(only=["images"], still_hz=0.2)
    Scene(world).run(20.0, column=100)
    recorder.teardown()
    assert 3 <= len(stamps(world)) <= 6


@pytest.mark.parametrize("still_hz", [2.0, 30.0])
def test_nothing_is_thinned_out_if_both_rates_are_one(world: World, still_hz: float) -> None:
    recorder = world.start_recorder(frames_hz=2.0, still_hz=still_hz)
    Scene(world).run(10.0, column=100)
    recorder.teardown()
    assert abs(len(stamps(world)) - 20) <= 1


def test_without_a_rate_for_still_scenes_only_changes_are_kept(world: World) -> None:
    recorder = world.start_recorder(still_hz=0.0, snapshot_period=1000.0)
    scene = Scene(world)
    scene.run(1.0, column=100)
    scene.run(1.0, column=100)
    before = stamps(world)
    scene.run(8.0, column=100)
    moved = world.clock.now()
    scene.run(5.0, column=150)
    recorder.teardown()
    assert stamps(world) == [*before, moved]


def test_a_frame_published_again_is_not_recorded_again(world: World) -> None:
    recorder = world.start_recorder(frames_hz=5.0, still_hz=5.0)
    frame = Scene(world).frame(100)
    for _ in range(50):
        world.memory.put_frame("camera", frame)
        world.step()
    recorder.teardown()
    assert stamps(world) == [frame.stamp]


def test_a_frame_without_colour_is_never_taken_for_still(world: World) -> None:
    recorder = world.start_recorder(frames_hz=2.0, still_hz=0.0)
    for _ in range(100):
        world.memory.put_frame("camera", Frame(world.clock.now(), {"depth": np.ones(SHAPE, np.float32)}, {}))
        world.step()
    recorder.teardown()
    assert abs(len(stamps(world)) - 20) <= 1


def test_after_each_snapshot_there_is_an_image(world: World) -> None:
    recorder = world.start_recorder(still_hz=0.0, snapshot_period=3.0)
    Scene(world).run(10.0, column=100)
    recorder.teardown()
    topics = [record.topic for record in world.records() if record.topic in ("snapshot", "blob/camera")]
    assert topics.count("snapshot") >= 3
    assert abs(topics.count("snapshot") - topics.count("blob/camera")) <= 1


def test_a_lossless_recording_has_every_bit(world: World) -> None:
    recorder = world.start_recorder(lossless=True, still_hz=0.0, snapshot_period=1000.0)
    frame = Scene(world).frame(100)
    frame.arrays["depth"][:] = np.random.default_rng(1).uniform(0.3, 2.0, SHAPE)
    world.memory.put_frame("camera", frame)
    world.run(1.0)
    recorder.teardown()
    (payload,) = [record.payload for record in world.records() if record.topic == "blob/camera"]
    found = unpack(decode_frame(payload))
    for name, image in frame.arrays.items():
        np.testing.assert_array_equal(found.arrays[name], image)
    assert found.meta == frame.meta and set(found.arrays) == set(frame.arrays)


def test_a_lossless_image_is_smaller_than_a_raw_one(world: World) -> None:
    frame = Scene(world, noise=1.0).frame(100)
    assert len(encode_frame(pack(frame, None))) < len(encode_frame(frame))
