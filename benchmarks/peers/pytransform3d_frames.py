"""pytransform3d: a manager of named frames, with the same chain and as many frames around it."""

from __future__ import annotations

import itertools

import numpy as np
from pytransform3d.transform_manager import TransformManager

from benchmarks import workload


class Frames:
    """A chain of `depth` edges below `world`, and `others` frames directly below it."""

    def __init__(self, others: int, depth: int) -> None:
        self._manager = TransformManager(check=False)
        self._depth = depth
        self._steps = itertools.count()
        for index in range(others):
            self._manager.add_transform(workload.name(index), "world", np.eye(4))
        for _ in range(depth):
            self.change()

    def change(self) -> None:
        """Give the next edge of the chain a new pose."""
        step = next(self._steps)
        index = step % self._depth
        parent = f"link_{index - 1}" if index else "world"
        self._manager.add_transform(f"link_{index}", parent, workload.pose(step).matrix)

    def ask(self) -> None:
        """Where the last frame of the chain is."""
        self._manager.get_transform(f"link_{self._depth - 1}", "world")
