"""Blocks on a table before a rendered camera: stood where a test wants them, and looked at."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.frame_images import images
from agents.scenario.format.scenario import ObjectSpec, TableSpec
from agents.scene_estimator.blocks import Block, BlockFinder, Cluster, Support
from agents.scene_estimator.fitting import FrameView
from agents.scene_estimator.pose import NoiseModel
from benchmarks.color_scene import AWAY, ColorScene
from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.math3d import transforms

RED, BLUE = (0.85, 0.2, 0.15), (0.15, 0.3, 0.9)
ABOVE = transforms.looking_at((0.35, 0.0, 0.65), (0.35, 0.0, 0.0))
TABLE = Support("table", Pose(TableSpec().position), TableSpec().size[0], TableSpec().size[1])


class Exposure(NamedTuple):
    """What a camera sees at once."""

    view: FrameView
    color: NDArray[np.uint8]
    clusters: list[Cluster]


class BlockScene(ColorScene):
    """Blocks by their names; all are away until they are stood somewhere."""

    def __init__(self, specs: Mapping[str, ObjectSpec]) -> None:
        super().__init__([], np.random.default_rng(0), specs.values())
        self.specs = specs

    def begin(self, noise: int) -> None:
        """Empty the table, and let the noise of the camera begin anew.

        Args:
            noise: its seed.
        """
        self.draw_noise_from(np.random.default_rng(noise))
        for name in self.specs:
            self.put(name, AWAY)

    def stand(self, name: str, x: float, y: float, yaw: float = 0.0, base: float = 0.0) -> Block:
        """Put a block on the table, or `base` m above; returns how it truly is."""
        spec = self.specs[name]
        truth = Block("cylinder" if spec.shape else "box", x, y, yaw, spec.size, base)
        self.put(name, Pose.from_rotvec(truth.centre, (0.0, 0.0, yaw)))
        return truth

    def look(self, camera: Pose, nearer: Mapping[str, float] | None = None) -> Exposure:
        color, depth, intrinsics = images(self.frame(camera, nearer))
        assert depth is not None
        view = FrameView(depth, intrinsics, camera)
        return Exposure(view, color, BlockFinder(NoiseModel()).clusters(view, color, [TABLE]))


def table_memory() -> Memory:
    """The memory of a scene estimator by itself, with a world and a table."""
    clock = ManualClock()
    memory = Memory("test", "scene_estimator", transport=LocalNetwork(clock).connect("scene_estimator"), clock=clock)
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=TableSpec().size)
    memory.add_edge("world", "table", "RT", pose=TABLE.pose)
    return memory
