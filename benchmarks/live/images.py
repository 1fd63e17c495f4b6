"""What images of a camera cost by how much is in them: the plant that draws them, the estimator that reads them.

Processor time, which other work on the machine changes little: so it tells how many cores each would need to keep the
rate of a camera, also where there are not so many.
"""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import process_time

from rich.console import Console
from rich.table import Table

from agents.plant.config import PlantConfig
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ
from agents.scenario.format.scenario import load_scenario
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.search import PERIOD
from agents.scene_estimator.sighting import FrameSource
from benchmarks.live.crowd import write_crowd
from dsr.math3d.transforms import Pose
from dsr.runtime.resources import keep_freed_memory

COUNTS = (1, 4, 10, 20, 50, 100)
"""Cubes on the table"""
_STEPS = 24  # of physics, a tenth of a second
_NUDGE = Pose((1e-5, 0.0, 0.0))  # m, of the camera
_SECONDS = 60.0  # of the scenario, of which nothing is played


@dataclass(frozen=True)
class ImageCost:
    """s of processor time: medians of what moves, and means of what stands still, in which a search of all counts."""

    objects: int
    found: int
    """Tags that were read"""
    second: float
    """A second of physics"""
    drawn: float
    """An image, with its depth and noise"""
    read: float
    """The same image, to the poses of what is in it"""
    drawn_still: float
    """An image of what stands before a camera that does: its noise is new"""
    read_still: float
    """The same image, to the poses of what is in it"""

    def cores(self, hz: float, cameras: int) -> tuple[float, float]:
        """Cores that plant and estimator need for so many `cameras` of `hz` frames a second, while all moves."""
        return self.second + hz * cameras * self.drawn, hz * cameras * self.read

    def cores_still(self, hz: float, cameras: int) -> tuple[float, float]:
        """The same while nothing moves."""
        return self.second + hz * cameras * self.drawn_still, hz * cameras * self.read_still


class _Images:
    """Draws and reads images, and tells the processor time of each.

    Args:
        reality: with cubes.
        hz: of its camera.
    """

    def __init__(self, reality: Reality, hz: float) -> None:
        config = SceneEstimatorConfig()
        size = load_scenario("hovering").objects[0].size
        self._reality = reality
        self._reader = FrameSource(lambda _marker: size, config.tag_ratio, config.noise)
        self._period = 1.0 / hz
        self._count = 0
        self.found = 0
        """Tags in the last one."""

    def next(self) -> tuple[float, float]:
        """How long the next one took to draw, and to read, s."""
        begin = process_time()
        frame = self._reality.frame(self._count * self._period)
        drawn = process_time()
        self.found = len(self._reader.read(frame)[0])
        self._count += 1
        return drawn - begin, process_time() - drawn


def measure(objects: int, repeat: int) -> ImageCost:
    """Draw and read images of so many cubes: `repeat` of a moving camera, and a second of one that stands still."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_crowd(Path(folder), objects, _SECONDS, _SECONDS)
        reality = Reality(load_scenario(file), PlantConfig(scenario=str(file)), 0)
    try:
        hz = PlantConfig().camera_hz
        images, steps, moving = _Images(reality, hz), [], []
        for _ in range(repeat + 1):  # the first of them fills caches
            begin = process_time()
            for _ in range(_STEPS):
                reality.step(None)
            steps.append(process_time() - begin)
            reality.camera.bump(_NUDGE)  # what looks as before is not drawn again
            moving.append(images.next())
        still = [images.next() for _ in range(math.ceil(PERIOD * hz))]
        drawn, read = (median(times) for times in zip(*moving[1:], strict=True))
        means = (sum(times) / len(times) for times in zip(*still, strict=True))
        return ImageCost(objects, images.found, median(steps[1:]) * RATE_HZ / _STEPS, drawn, read, *means)
    finally:
        reality.close()


def main(repeat: int, plot: Path | None) -> None:
    """Measure all counts, print them, and draw them."""
    hz = PlantConfig().camera_hz
    keep_freed_memory()  # as processes of agents do
    costs = [measure(count, repeat) for count in COUNTS]
    table = Table(title=f"processor time of images; cores for two cameras of {hz:g} Hz")
    for heading in ("cubes", "the camera", "tags read", "drawn, ms", "read, ms", "plant, cores", "estimator, cores"):
        table.add_column(heading, justify="right")
    for cost in costs:
        for how, drawn, read, cores in (
            ("moves", cost.drawn, cost.read, cost.cores(hz, 2)),
            ("stands", cost.drawn_still, cost.read_still, cost.cores_still(hz, 2)),
        ):
            times = (f"{value * 1e3:.1f}" for value in (drawn, read))
            table.add_row(str(cost.objects), how, str(cost.found), *times, *(f"{value:.2f}" for value in cores))
    Console().print(table)
    if plot:
        draw(costs, hz, plot)


def draw(costs: list[ImageCost], hz: float, file: Path) -> None:
    """Draw the cores by the number of cubes into a PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(7, 4.2))
    counts = [cost.objects for cost in costs]
    for index, (name, color) in enumerate((("plant", "#1f4e79"), ("scene estimator", "#c8102e"))):
        axis.plot(counts, [cost.cores(hz, 2)[index] for cost in costs], "o-", color=color, label=f"{name}, all moves")
        still = [cost.cores_still(hz, 2)[index] for cost in costs]
        axis.plot(counts, still, "o--", color=color, label=f"{name}, nothing moves")
    axis.set(xlabel="cubes in the image", ylabel="cores, of processor time", title=f"Two cameras of {hz:g} Hz")
    axis.axhline(1.2, color="black", linestyle=":", label="60 % of two cores")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    figure.savefig(file, bbox_inches="tight", dpi=110)
    plt.close(figure)
