"""The camera of a bag is a driver: what was seen then is seen now."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from agents.checked_frames import CheckedFrames
from agents.drivers import make_driver
from agents.fixed_camera.agent import FixedCamera
from agents.ros_bridge.bags import BagCamera
from agents.ros_bridge.mapping.images import IMAGE
from dsr.clock import ManualClock
from dsr.errors import ConfigError
from dsr.images.blobs import Frame
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.intrinsics import read_intrinsics
from tests.agents.ros_bridge.bags.made import BEGIN, COLOR, DEPTH, INTRINSICS, Message, color, depth, drive, mcap

NAME = "agents.ros_bridge.bags:BagCamera"
KEYS = Keys("bags")


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[ManualClock]:
    clock = ManualClock()
    monkeypatch.setattr(BagCamera, "clock", clock)
    yield clock


def camera(bag: Path, **options: object) -> BagCamera:
    made = make_driver(NAME, LocalNetwork().connect("camera"), KEYS, bag=str(bag), **options)
    assert isinstance(made, BagCamera)
    return made


def watch(clock: ManualClock, driver: BagCamera, seconds: float) -> list[Frame]:
    found = []
    for _ in range(round(seconds / 0.02)):
        clock.advance(0.02)
        frame = driver.frame()
        if frame is not None:
            found.append(frame)
    return found


def test_images_come_when_they_came_with_depth_intrinsics_and_stamps_of_now(clock: ManualClock, bag: Path) -> None:
    driver, began = camera(bag, loop=False), clock.now()
    frames = watch(clock, driver, 5.0)
    assert len(frames) == 40
    for number, frame in enumerate(frames):
        assert frame.stamp - began == pytest.approx(0.1 * number, abs=1e-6)
        np.testing.assert_array_equal(frame.arrays["color"], color(number))
        np.testing.assert_allclose(frame.arrays["depth"], depth(number) / 1000.0, rtol=1e-6)
        assert frame.meta == {"fx": INTRINSICS.fx, "fy": INTRINSICS.fy, "cx": INTRINSICS.cx, "cy": INTRINSICS.cy}
    driver.close()
    driver.close()
    assert driver.frame() is None


def test_a_bag_that_is_taken_away_is_told_and_nobody_dies(clock: ManualClock, bag: Path, tmp_path: Path) -> None:
    copied = tmp_path / bag.name
    copied.write_bytes(bag.read_bytes())
    frames = CheckedFrames(camera(copied), clock, logging.getLogger("test"), "cam")
    clock.advance(0.2)
    assert frames.frame() is not None
    copied.unlink()
    for _ in range(500):
        clock.advance(0.02)
        frames.frame()
    assert "cannot be read" in frames.trouble and frames.counts["failed"] > 0


def test_a_bag_begins_where_told_runs_as_fast_as_told_and_again(clock: ManualClock, bag: Path) -> None:
    driver, began = camera(bag, color=COLOR, begin=2.0, speed=2.0), clock.now()
    frames = watch(clock, driver, 2.5)
    numbers = [next(n for n in range(40) if (frame.arrays["color"] == color(n)).all()) for frame in frames]
    assert numbers[:20] == list(range(20, 40)) and numbers[20:40] == list(range(20, 40))
    assert [frame.stamp - began for frame in frames[:20]] == pytest.approx([0.05 * n for n in range(20)], abs=1e-6)
    stamps = [frame.stamp for frame in frames]
    assert stamps == sorted(stamps) and len(set(stamps)) == len(stamps) and "depth" not in frames[0].arrays


def test_agents_see_it_in_lockstep(clock: ManualClock, bag: Path) -> None:
    config = {
        "node": "eye", "driver": NAME, "options": {"bag": str(bag), "color": COLOR, "depth": DEPTH},
        "mount": {"position": [0.0, 0.0, 1.0], "look_at": [1.0, 0.0, 0.0]},
    }  # fmt: skip
    with Lockstep([AgentSpec("fixed_camera", FixedCamera, config)], graph="bags", clock=clock) as lockstep:
        frames = lockstep.memory.frames("eye")
        lockstep.run_for(1.0)
        frame = frames.latest()
        assert frame is not None and 0.0 <= clock.now() - frame.stamp < 0.15
        assert read_intrinsics(lockstep.memory.node("eye")) == INTRINSICS


def test_what_cannot_be_is_refused(clock: ManualClock, bag: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"no topic /nope; there are .*{COLOR}"):
        camera(bag, color="/nope")
    with pytest.raises(ConfigError, match=r"begin 9\.0: expected 0 to"):
        camera(bag, begin=9.0)
    with pytest.raises(ConfigError, match="speed 0"):
        camera(bag, speed=0)
    with pytest.raises(ConfigError, match="no such file"):
        camera(tmp_path / "none.mcap")
    two = [one for one in drive() if one.topic == COLOR]
    two += [Message(one.time, "/rear/image_raw", one.type, one.cdr) for one in two]
    several = mcap(tmp_path / "a.mcap", sorted(two, key=lambda one: one.time), CompressionType.NONE)
    with pytest.raises(ConfigError, match=r"which camera\?.*/camera/color/image_raw.*/rear/image_raw"):
        camera(several)


def test_a_malformed_image_is_counted_and_the_next_one_seen(clock: ManualClock, tmp_path: Path) -> None:
    images = [one for one in drive() if one.topic in (COLOR, DEPTH)]
    images.insert(20, Message(images[20].time, COLOR, IMAGE, b"\0\1\0\0\xff"))
    driver = camera(mcap(tmp_path / "a.mcap", images, CompressionType.NONE), loop=False)
    assert len(watch(clock, driver, 5.0)) == 40
    assert driver.tally.counts["malformed"] == 1 and "image_raw was dropped" in driver.tally.told[0]


def test_a_bag_of_one_image_is_shown_again_and_again(clock: ManualClock, tmp_path: Path) -> None:
    first = next(one for one in drive() if one.topic == COLOR)
    driver = camera(mcap(tmp_path / "a.mcap", [first], CompressionType.NONE))
    assert first.time - BEGIN == pytest.approx(0.005, abs=1e-6)
    assert 5 <= len(watch(clock, driver, 1.0)) <= 11
