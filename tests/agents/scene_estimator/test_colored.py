"""Objects recognised by their colour: who is known, what a reading of a sensor becomes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from agents.drivers import ColorReading, TagReadings
from agents.scene_estimator.colored import LEANING, TURNED, ColoredObjects
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.math3d.shapes import Part, to_numbers
from dsr.vocabulary.bodies import MOST_BODIES

from .conftest import AGE, PERIOD, SENSORS, Bench, FakeSensor, covariance

RED = (0.9, 0.1, 0.1)
SIZE = (0.06, 0.06, 0.06)
BALL = to_numbers((Part("sphere", SIZE),))


def tell(bench: Bench, sensor: FakeSensor, *readings: ColorReading) -> None:
    sensor.next = TagReadings(bench.clock.now(), [], colors=list(readings))
    bench.run(PERIOD)


def test_a_known_colour_is_perceived_upright_with_any_rotation(
    make_bench: Callable[..., Bench], sensor: FakeSensor
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("ball", "ball", size=SIZE, color=RED, shape=BALL)
    bench.run(PERIOD)
    tell(bench, sensor, ColorReading((0.45, 0.05, 0.05), (0.0, 0.1, 0.4), 0.002))
    pose = bench.memory.edge("camera_overhead", "ball", "RT").pose
    assert pose.translation == pytest.approx([0.0, 0.1, 0.4])
    assert bench.perceived("ball") is True
    upright = bench.memory.transform("world", "ball")
    assert upright.distance(Pose(upright.t))[1] < 1e-9
    assert covariance(pose)[3:, 3:] == pytest.approx(math.pi**2 * np.eye(3))
    assert np.linalg.eigvalsh(covariance(pose)[:3, :3])[:2] == pytest.approx([0.002**2] * 2, rel=1e-3)
    bench.run(AGE + 2 * PERIOD)
    assert bench.perceived("ball") is False


@pytest.mark.parametrize(("tilt", "told", "yaw_sigma"), [(0.1, 0.0, math.pi), (0.8, 0.8, LEANING), (2.4, 2.4, LEANING)])
def test_a_sensor_may_tell_how_something_leans(
    make_bench: Callable[..., Bench], sensor: FakeSensor, tilt: float, told: float, yaw_sigma: float
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("ball", "ball", size=SIZE, color=RED, shape=BALL)
    bench.run(PERIOD)
    up = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, tilt, 0.0)).rotation_matrix[:, 2]
    x, y, z = bench.memory.transform("camera_overhead", "world").rotation_matrix @ up
    tell(bench, sensor, ColorReading(RED, (0.0, 0.1, 0.4), 0.002, (x, y, z)))
    turned = bench.memory.transform("world", "ball")
    assert turned.distance(Pose.from_rotvec(turned.t, (0.0, told, 0.0)))[1] < 1e-9
    sigmas = np.sqrt(np.diag(covariance(bench.memory.edge("camera_overhead", "ball", "RT").pose))[3:])
    assert sigmas == pytest.approx([LEANING, LEANING, yaw_sigma])


def test_what_is_upside_down_has_no_heading_that_noise_makes(
    make_bench: Callable[..., Bench], sensor: FakeSensor
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("ball", "ball", size=SIZE, color=RED, shape=BALL)
    bench.run(PERIOD)
    seen = []
    for angle in (0.0, 1.0, 2.5, 4.0):
        up = Pose.from_rotvec((0.0, 0.0, 0.0), (0.02 * math.cos(angle), math.pi - 0.02, 0.02 * math.sin(angle)))
        x, y, z = bench.memory.transform("camera_overhead", "world").rotation_matrix @ up.rotation_matrix[:, 2]
        tell(bench, sensor, ColorReading(RED, (0.0, 0.1, 0.4), 0.002, (x, y, z)))
        seen.append(bench.memory.transform("world", "ball"))
    assert max(pose.distance(seen[0])[1] for pose in seen) < 1e-9
    assert seen[0].rotation_matrix[2, 2] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    ("turned", "told"), [(0.3, 0.3), (0.3 + math.pi / 2, 0.3), (-0.7, -0.7), (0.9, 0.9 - math.pi / 2)]
)
def test_a_sensor_may_tell_how_something_is_turned(
    make_bench: Callable[..., Bench], sensor: FakeSensor, turned: float, told: float
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("lid", "box", size=(0.1, 0.1, 0.02), color=RED)
    bench.run(PERIOD)
    tell(bench, sensor, turned_reading(bench, turned))
    seen = bench.memory.transform("world", "lid")
    assert seen.distance(Pose.from_rotvec(seen.t, (0.0, 0.0, told)))[1] < 1e-6
    sigmas = np.sqrt(np.diag(covariance(bench.memory.edge("camera_overhead", "lid", "RT").pose))[3:])
    assert sigmas == pytest.approx([LEANING, LEANING, TURNED])


def test_of_turns_that_look_alike_a_sensor_means_the_one_near_the_last(
    make_bench: Callable[..., Bench], sensor: FakeSensor
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("lid", "box", size=(0.1, 0.1, 0.02), color=RED)
    bench.run(PERIOD)
    for turned in (0.0, 0.3, 0.6, 0.9, 1.2 - math.pi / 2):
        tell(bench, sensor, turned_reading(bench, turned))
    seen = bench.memory.transform("world", "lid")
    assert seen.distance(Pose.from_rotvec(seen.t, (0.0, 0.0, 1.2)))[1] < 1e-6


def test_what_is_not_seen_to_be_turned_is_guessed_to_be_turned_as_before(
    make_bench: Callable[..., Bench], sensor: FakeSensor
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("lid", "box", size=(0.1, 0.1, 0.02), color=RED)
    bench.run(PERIOD)
    tell(bench, sensor, turned_reading(bench, 0.3))
    tell(bench, sensor, ColorReading(RED, (0.0, 0.1, 0.4), 0.002))
    seen = bench.memory.transform("world", "lid")
    assert seen.distance(Pose.from_rotvec(seen.t, (0.0, 0.0, 0.3)))[1] < 1e-6
    sigmas = np.sqrt(np.diag(covariance(bench.memory.edge("camera_overhead", "lid", "RT").pose))[3:])
    assert sigmas == pytest.approx([math.pi] * 3)


def test_nothing_tells_how_what_is_round_is_turned(make_bench: Callable[..., Bench], sensor: FakeSensor) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("ball", "ball", size=SIZE, color=RED, shape=BALL)
    bench.run(PERIOD)
    tell(bench, sensor, turned_reading(bench, 0.3))
    pose = bench.memory.edge("camera_overhead", "ball", "RT").pose
    assert covariance(pose)[5, 5] == pytest.approx(math.pi**2)


def turned_reading(bench: Bench, yaw: float) -> ColorReading:
    """What stands upright, turned."""
    axes = bench.memory.transform("camera_overhead", "world") @ Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, yaw))
    ahead, _, up = (tuple(axis) for axis in axes.rotation_matrix.T.tolist())
    return ColorReading(RED, (0.0, 0.1, 0.4), 0.002, up, ahead)


def test_other_colours_and_tagged_objects_are_not_meant(make_bench: Callable[..., Bench], sensor: FakeSensor) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("cube_3", "cube", size=SIZE, color=RED, marker_id=3)
    bench.memory.add_node("ball", "ball", size=SIZE, color=(0.1, 0.9, 0.1))
    bench.run(PERIOD)
    tell(bench, sensor, ColorReading(RED, (0.0, 0.1, 0.4), 0.002))
    assert bench.perceived("cube_3") is False
    assert bench.perceived("ball") is False


@pytest.fixture
def memory() -> Memory:
    memory = Memory("test", "me", transport=LocalNetwork(ManualClock()).connect("me"), clock=ManualClock())
    memory.add_node("world", "world")
    memory.add_node("tagged", "cube", size=SIZE, color=RED, marker_id=3)
    memory.add_node("bare", "ball", size=SIZE, color=(0.1, 0.9, 0.1))
    return memory


def names(objects: ColoredObjects, stamp: float) -> list[str]:
    return [colored.name for colored in objects.looked_for(stamp)]


def test_what_has_a_tag_is_looked_for_by_colour_as_long_as_no_camera_reads_the_tag(memory: Memory) -> None:
    objects = ColoredObjects(memory, AGE)
    objects.update()
    assert names(objects, 1.0) == ["bare", "tagged"]
    objects.note_read(["tagged", "unknown"], 1.0)
    objects.note_read(["tagged"], 0.5)
    assert names(objects, 1.0) == names(objects, 1.0 + 0.9 * AGE) == ["bare"]
    assert names(objects, 1.0 + 1.1 * AGE) == ["bare", "tagged"]
    memory.update_node("bare", size=(0.05, 0.05, 0.05))
    objects.update()
    assert names(objects, 1.0) == ["bare"]


@pytest.mark.parametrize("other", [{"marker_id": 4}, {}, {"source": "depth"}])
def test_a_colour_that_others_have_tells_nothing_of_what_has_a_tag(memory: Memory, other: dict[str, Any]) -> None:
    memory.add_node("other", "cube", size=SIZE, color=(0.9, 0.15, 0.1), **other)
    objects = ColoredObjects(memory, AGE)
    objects.update()
    assert names(objects, 0.0) == ["bare"] + ["other"] * (not other)


@pytest.mark.parametrize(
    "wrong",
    [
        ColorReading(RED, (0.0, 0.0, math.nan), 0.002),
        ColorReading(RED, (0.0, 0.0, 1.0), 0.002, (0.0, 0.0, 1.0), (0.0, 0.0, 2.0)),
        ColorReading(RED, (0.0, 0.0, 1.0), 0.002, (0.0, 0.0, 1.0), (0.0, math.nan, 0.0)),
        ColorReading(RED, (0.0, 0.0, 1e200), 0.002),
        ColorReading(RED, (0.0, 0.0, 0.0), 0.002),
        ColorReading(RED, (0.0, 0.0, 1.0), -1.0),
        ColorReading((math.inf, 0.0, 0.0), (0.0, 0.0, 1.0), 0.002),
    ],
)
def test_readings_that_cannot_be_are_counted(
    make_bench: Callable[..., Bench], sensor: FakeSensor, wrong: ColorReading
) -> None:
    bench = make_bench(tag_sensors=SENSORS)
    bench.memory.add_node("ball", "ball", size=SIZE, color=RED)
    bench.run(PERIOD)
    tell(bench, sensor, wrong)
    assert bench.agent.skipped == {"malformed": 1}
    assert bench.perceived("ball") is False


def test_however_many_coloured_things_somebody_makes_up_few_are_looked_for_and_those_of_others_stay() -> None:
    """Of 3000, each image took minutes."""
    network = LocalNetwork(ManualClock())
    liar, honest = (Memory("g", name, transport=network.connect(name), clock=network.clock) for name in ("liar", "me"))
    honest.add_node("world", "world")
    for _ in range(3):
        for memory in (honest, liar):
            memory.flush()
            network.deliver()
            memory.poll()
    looked_for = ColoredObjects(liar, AGE)
    liar_made = [liar.add_node(f"a_{number}", "cube", size=SIZE, color=RED) for number in range(2 * MOST_BODIES)]
    honest.add_node("z", "cube", size=SIZE, color=RED)
    for _ in range(3):
        for memory in (honest, liar):
            memory.flush()
            network.deliver()
            memory.poll()
    looked_for.update()
    assert len(liar_made) > len(looked_for.known) == MOST_BODIES
    assert "z" in {one.name for one in looked_for.known}
