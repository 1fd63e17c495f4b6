"""An agent that writes all the time, and leaves a list of what it wrote when."""

from __future__ import annotations

import time
from pathlib import Path

import msgspec

from dsr import main
from dsr.agent import Agent
from dsr.graph.access import Access
from dsr.math3d.transforms import Pose


class WriterConfig(msgspec.Struct, frozen=True):
    folder: str = "."


class Writer(Agent):
    """Counts on, from where the graph says that it was, in an attribute, in a pose and in nodes that come and go."""

    rate_hz = 50.0
    writes = Access(nodes=("world", "cube", "ball"), edges=("RT",), attributes=("seen",))
    Config = WriterConfig

    def setup(self) -> None:
        self.node = f"cube_{self.name}"
        self.memory.add_node("world", "world")
        self.memory.add_node(self.node, "cube")
        self.memory.add_edge("world", self.node, "RT", pose=Pose())
        self.count = self.memory.node(self.node).get("seen", 0)
        self.written = (Path(self.config.folder) / f"{self.name}.written").open("a", buffering=1)

    def tick(self, now: float) -> None:
        self.count += 1
        self.memory.update_node(self.node, seen=self.count)
        self.memory.update_edge("world", self.node, "RT", pose=Pose((float(self.count), 0.0, 0.0), stamp=now))
        self.memory.add_node(f"ball_{self.name}_{self.count}", "ball")
        self.memory.remove_node(f"ball_{self.name}_{self.count - 10}")
        self.written.write(f"{self.count} {time.monotonic()}\n")


if __name__ == "__main__":
    main(Writer)
