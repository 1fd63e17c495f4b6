"""The plant as an agent: it keeps to the clock, hears commands, and tells the truth to judges only."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from agents.drivers import make_driver
from agents.plant import Plant
from agents.plant.driver import PlantArm, PlantCamera, PlantPoses
from agents.plant.messages import Truth, arm_command_key, arm_state_key, frame_key, readings_key
from agents.plant.plant import MOST_STEPS
from agents.plant.world import STEP
from dsr.agent import make_agent
from dsr.clock import ManualClock
from dsr.errors import ConfigError
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalNetwork
from dsr.vocabulary.scenario_start import Start, start_key

SCENARIO = """
name = "test"
title = "Two cubes, one is moved"
duration = 5.0
[random]
position = 0.01
yaw = 3.14
[[object]]
name = "cube_3"
marker_id = 3
position = [0.42, 0.08, 0.02]
[[object]]
name = "cube_4"
marker_id = 4
position = [0.30, -0.08, 0.02]
[[event]]
at = 0.5
do = "place"
object = "cube_3"
position = [0.30, 0.10, 0.02]
"""


class Bench:
    """A plant in lockstep with one listener."""

    def __init__(self, folder: Path, seed: int, start: bool, config: dict[str, Any]) -> None:
        file = folder / "test.toml"
        file.write_text(SCENARIO)
        self.clock = ManualClock()
        self.begin = self.clock.now()
        self.network = LocalNetwork(self.clock)
        self.keys = Keys("test")
        self.bus = self.network.connect("listener")
        self.heard: list[tuple[str, bytes]] = []
        self.bus.subscribe(f"{self.keys.root}/**", lambda key, payload: self.heard.append((key, payload)))
        config = {"scenario": str(file), "sensor": "poses"} | config
        link = self.network.connect("plant")
        plant = make_agent(
            Plant, name="plant", config=config, bus=link, keys=self.keys, clock=self.clock, memory=None, seed=seed
        )
        assert isinstance(plant, Plant)
        self.plant = plant
        plant.setup()
        if start:
            self.send_start(self.begin)

    def send_start(self, stamp: float) -> None:
        self.bus.publish(start_key(self.keys), msgspec.msgpack.encode(Start(stamp)))

    def run(self, seconds: float, rate_hz: float = 60.0) -> Truth:
        """Tick, and return the truth at the end."""
        begin = self.clock.now()
        for tick in range(1, round(seconds * rate_hz) + 1):
            self.network.deliver()
            self.plant.tick(self.clock.now())
            self.network.deliver()
            self.clock.advance_to(begin + tick / rate_hz)
        return self.plant._reality.truth(self.plant.stamp)


MakeBench = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[MakeBench]:
    made: list[Bench] = []

    def make(seed: int = 0, start: bool = True, config_start: float = 0.0, **config: Any) -> Bench:
        config["start"] = config_start
        made.append(Bench(tmp_path, seed, start, config))
        return made[-1]

    yield make
    for one in made:
        one.plant.teardown()


def test_everything_is_published_at_its_rate(bench: MakeBench) -> None:
    one = bench(state_hz=50, truth_hz=20, camera_hz=10)
    one.run(2.0)
    counts = Counter(key for key, _ in one.heard)
    for key, expected in [
        (arm_state_key(one.keys), 100),
        (one.keys.truth(), 40),
        (readings_key(one.keys, "overhead"), 20),
    ]:
        assert abs(counts[key] - expected) <= 1, key


def test_ticks_that_come_early_or_late_lose_no_sample(bench: MakeBench) -> None:
    """Samples come with each tick of 60 a second. Ticks of a live machine are some ms early or late."""
    one = bench()
    for tick in range(120):
        one.clock.advance_to(one.begin + 0.01 + tick / Plant.rate_hz + 0.002 * (-1) ** tick)
        one.plant.tick(one.clock.now())
        one.network.deliver()
    assert sum(key == arm_state_key(one.keys) for key, _ in one.heard) == 120


def test_truth_tells_objects_robot_and_camera(bench: MakeBench) -> None:
    one = bench()
    one.run(0.2)
    payload = next(payload for key, payload in one.heard if key == one.keys.truth())
    truth = msgspec.msgpack.decode(payload)
    assert set(truth["objects"]) == {"cube_3", "cube_4"}
    assert len(truth["robot"]) == 7
    assert truth["camera"]["overhead"][:3] == pytest.approx([0.35, 0.0, 0.65])
    assert one.begin <= truth["stamp"] <= one.begin + 0.2


def test_equal_seeds_give_equal_runs_and_others_do_not(bench: MakeBench) -> None:
    one, same, other = bench(seed=1), bench(seed=1), bench(seed=2)
    for each in (one, same, other):
        each.run(1.0)
    assert one.heard == same.heard
    assert [payload for _, payload in one.heard] != [payload for _, payload in other.heard]


def test_images_repeat_with_the_seed(bench: MakeBench) -> None:
    small = {"sensor": "pixels", "renderer": "tiny", "width": 64, "height": 48}
    frames = []
    for seed in (1, 1, 2):
        one = bench(seed=seed, **small)
        one.run(0.2)
        frames.append([payload for key, payload in one.heard if key == frame_key(one.keys, "overhead")])
    assert len(frames[0]) == 2
    assert frames[0] == frames[1] != frames[2]


def test_timeline_waits_for_the_start(bench: MakeBench) -> None:
    one = bench(start=False)
    before = one.run(1.0).objects["cube_3"]
    one.send_start(one.clock.now())
    assert one.run(0.4).objects["cube_3"] == pytest.approx(before, abs=1e-4)
    assert one.run(0.4).objects["cube_3"][:2] == pytest.approx((0.30, 0.10), abs=1e-3)


def test_start_in_the_past_makes_up_for_what_was_missed(bench: MakeBench) -> None:
    one = bench(start=False)
    one.run(0.1)
    one.send_start(one.clock.now() - 3.0)
    assert one.run(0.1).objects["cube_3"][:2] == pytest.approx((0.30, 0.10), abs=1e-3)


def test_start_can_be_configured(bench: MakeBench) -> None:
    one = bench(start=False, config_start=ManualClock().now() - 0.3)
    before = one.run(0.1).objects["cube_3"]
    assert before[:2] != pytest.approx((0.30, 0.10), abs=1e-3)
    assert one.run(0.3).objects["cube_3"][:2] == pytest.approx((0.30, 0.10), abs=1e-3)


def test_late_plant_catches_up_within_bounds(bench: MakeBench) -> None:
    one = bench()
    one.run(0.1)
    reached = one.plant.stamp
    one.clock.advance(0.1)
    one.run(1 / 60)
    assert one.plant.stamp == pytest.approx(one.clock.now() - 1 / 60, abs=2 * STEP)
    one.clock.advance(10.0)
    steps = one.plant._steps
    one.run(1 / 60)
    assert one.plant._steps - steps == MOST_STEPS
    assert one.plant.stamp == pytest.approx(one.clock.now() - 1 / 60, abs=2 * STEP)
    assert reached < one.plant.stamp


def test_drivers_move_the_arm_and_see(bench: MakeBench) -> None:
    one = bench()
    arm = make_driver("agents.plant.driver:PlantArm", one.bus, one.keys)
    eyes = PlantPoses(one.bus, one.keys)
    assert isinstance(arm, PlantArm) and arm.state() is None
    one.run(0.2)
    state = arm.state()
    assert state is not None and state.names == tuple(f"joint_{i}" for i in range(1, 8))
    target = tuple(position + 0.1 for position in state.positions)
    arm.follow((0.5,), (target,))
    arm.move_gripper(0.02)
    for _ in range(75):
        one.run(0.02)
        arm.keep_alive()
    state = arm.state()
    assert state is not None and state.positions == pytest.approx(target, abs=2e-3)
    assert state.gripper_opening == pytest.approx(0.02, abs=1e-3)
    assert one.plant.stamp - state.stamp < 0.03
    readings = eyes.readings()
    assert readings is not None and {reading.marker_id for reading in readings.readings} == {3, 4}
    assert eyes.readings() is None
    arm.close()
    eyes.close()


def test_further_cameras_deliver_beside_the_scenarios(bench: MakeBench) -> None:
    one = bench(more_cameras=("wrist", "overhead"))
    overhead, wrist = (PlantPoses(one.bus, one.keys, name=name) for name in ("overhead", "wrist"))
    one.run(0.3)
    seen = [readings for eyes in (overhead, wrist) if (readings := eyes.readings()) is not None]
    assert len(seen) == 2 and seen[0].stamp == seen[1].stamp
    poses = [{reading.marker_id: reading.pose for reading in readings.readings} for readings in seen]
    assert poses[0].keys() == {3, 4} and poses[1] and poses[0] != poses[1]
    overhead.close()
    wrist.close()


def test_an_unknown_further_camera_is_refused(bench: MakeBench) -> None:
    with pytest.raises(ConfigError, match=r"no camera 'overhaed'.*overhead"):
        bench(more_cameras=("overhaed",))


def test_camera_driver_returns_each_frame_once(bench: MakeBench) -> None:
    one = bench(sensor="pixels", renderer="tiny", width=64, height=48)
    camera = PlantCamera(one.bus, one.keys, name="overhead")
    assert camera.frame() is None
    one.run(0.2)
    frame = camera.frame()
    assert frame is not None and frame.arrays["depth"].shape == (48, 64)
    assert np.median(frame.arrays["depth"]) == pytest.approx(0.65, abs=0.02)
    assert camera.frame() is None
    camera.close()


def test_malformed_messages_are_counted_and_dropped(bench: MakeBench, caplog: pytest.LogCaptureFixture) -> None:
    one = bench(start=False)
    for payload in (b"", b"\xc1", msgspec.msgpack.encode({"type": "follow", "times": [1.0], "positions": [[1.0]]})):
        one.bus.publish(arm_command_key(one.keys), payload)
    one.bus.publish(start_key(one.keys), b"soon")
    before = one.plant._reality.arm.positions
    one.run(0.5)
    assert one.plant.dropped == 4
    assert len([record for record in caplog.records if "dropped" in record.message]) == 1
    assert one.plant._reality.arm.positions == pytest.approx(before, abs=1e-3)


def test_driver_drops_malformed_messages(caplog: pytest.LogCaptureFixture) -> None:
    network, keys = LocalNetwork(), Keys("test")
    sender, link = network.connect("device"), network.connect("agent")
    arm, camera = PlantArm(link, keys), PlantCamera(link, keys)
    for _ in range(2):
        sender.publish(arm_state_key(keys), b"\xc1")
        sender.publish(frame_key(keys, "overhead"), b"\x00")
        network.deliver()
        assert arm.state() is None and camera.frame() is None
    assert len([record for record in caplog.records if "dropped" in record.message]) == 2


def test_unknown_scenario_is_refused_and_teardown_is_harmless(bench: MakeBench) -> None:
    with pytest.raises(ConfigError, match="unknown scenario"):
        bench(scenario="hoovering")


def test_drivers_do_without_the_physics_engine() -> None:
    code = "import sys, agents.plant.driver; sys.exit('pybullet' in sys.modules or 'cv2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
