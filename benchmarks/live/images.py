"""What images of a camera cost by how much is in them: the plant that draws them, the estimator that reads them.

Processor time, which other work on the machine changes little: so it tells how many cores each would need to keep the
rate of a camera, also where there are not so many.
"""

from __future__ import annotations

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
from agents.scene_estimator.sighting import FrameSource
from benchmarks.live.crowd import write_crowd
from dsr.math3d.transforms import Pose

COUNTS = (1, 4, 20, 50, 100)
"""Cubes on the table"""
_STEPS = 24  # of physics, a tenth of a second
_NUDGE = Pose((1e-5, 0.0, 0.0))  # m, of the camera
_SECONDS = 60.0  # of the scenario, of which nothing is played


@dataclass(frozen=True)
class ImageCost:
    """s of processor time, medians."""

    objects: int
    found: int
    """Tags that were read"""
    second: float
    """A second of physics"""
    drawn: float
    """An image, with its depth and noise"""
    read: float
    """The same image, to the poses of what is in it"""

    def cores(self, hz: float, cameras: int) -> tuple[float, float]:
        """Cores that plant and estimator need for so many `cameras` of `hz` frames a second."""
        return self.second + hz * cameras * self.drawn, hz * cameras * self.read


def measure(objects: int, repeat: int) -> ImageCost:
    """Draw and read images of so many cubes."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_crowd(Path(folder), objects, _SECONDS, _SECONDS)
        reality = Reality(load_scenario(file), PlantConfig(scenario=str(file)), 0)
    try:
        config = SceneEstimatorConfig()
        size = load_scenario("hovering").objects[0].size
        reader = FrameSource(lambda _marker: size, config.tag_ratio, config.noise)
        steps, drawn, read, found = [], [], [], 0
        for stamp in range(repeat + 1):  # the first of them fills caches
            begin = process_time()
            for _ in range(_STEPS):
                reality.step(None)
            stepped = process_time()
            reality.camera.bump(_NUDGE)  # what looks as before is not drawn again
            frame = reality.frame(float(stamp))
            pictured = process_time()
            found = len(reader.read(frame)[0])
            read.append(process_time() - pictured)
            drawn.append(pictured - stepped)
            steps.append(stepped - begin)
        second = median(steps[1:]) * RATE_HZ / _STEPS
        return ImageCost(objects, found, second, median(drawn[1:]), median(read[1:]))
    finally:
        reality.close()


def main(repeat: int, plot: Path | None) -> None:
    """Measure all counts, print them, and draw them."""
    hz = PlantConfig().camera_hz
    costs = [measure(count, repeat) for count in COUNTS]
    table = Table(title=f"processor time of images; cores for two cameras of {hz:g} Hz")
    for heading in ("cubes", "tags read", "drawn, ms", "read, ms", "plant, cores", "estimator, cores"):
        table.add_column(heading, justify="right")
    for cost in costs:
        plant, estimator = cost.cores(hz, 2)
        numbers = (cost.drawn * 1e3, cost.read * 1e3, plant, estimator)
        texts = [f"{number:.0f}" for number in numbers[:2]] + [f"{number:.2f}" for number in numbers[2:]]
        table.add_row(str(cost.objects), str(cost.found), *texts)
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
        for cameras, style in ((1, "o--"), (2, "o-")):
            label = f"{name}, {cameras} camera{'s' if cameras > 1 else ''}"
            axis.plot(counts, [cost.cores(hz, cameras)[index] for cost in costs], style, color=color, label=label)
    axis.set(xlabel="cubes in the image", ylabel="cores, of processor time", title=f"Cameras of {hz:g} Hz")
    axis.axhline(1.2, color="black", linestyle=":", label="60 % of two cores")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    figure.savefig(file, bbox_inches="tight", dpi=110)
    plt.close(figure)
