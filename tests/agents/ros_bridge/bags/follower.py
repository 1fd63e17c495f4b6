"""An agent that looks at each image of a camera, and asks where the camera was."""

from __future__ import annotations

from typing import ClassVar

from dsr.agent import Access, Agent
from tests.agents.ros_bridge.bags.made import color


class Follower(Agent):
    """Notes what it sees."""

    name = "follower"
    rate_hz = 50.0
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    seen: ClassVar[list[tuple[float, int, float]]] = []
    """Stamp (s) of each image, its number, and x (m) of the camera in `odom` then"""

    def setup(self) -> None:
        self._frames = self.memory.frames("camera")

    def tick(self, now: float) -> None:
        frame = self._frames.latest()
        if frame is None:
            return
        numbers = [number for number in range(40) if (frame.arrays["color"] == color(number)).all()]
        pose = self.memory.get_transform("odom", "camera", at=frame.stamp)
        if pose is not None:
            self.seen.append((frame.stamp, numbers[0], pose.t[0]))

    def teardown(self) -> None:
        self._frames.close()
