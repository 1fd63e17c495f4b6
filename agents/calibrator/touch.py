"""What a gripper feels: it finds objects where they are believed to be only if the camera is where that is believed."""

from __future__ import annotations

import math

from agents.calibrator.decision import Decision
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.intentions import DONE, FAILED, NOTHING_GRASPED

_FAR = 0.025  # m that an object would be elsewhere, for a grasp of it to tell


class Touch:
    """Follows attempts to pick up objects that were either moved, all alike, or seen by a camera that was.

    Args:
        memory: holds the actions; what was tried before does not count.
        believed: world_from_object, where the objects are if it was the camera.
        moved: world_from_world, their common motion if it was they.
    """

    def __init__(self, memory: Memory, believed: dict[str, Pose], moved: Pose) -> None:
        self._memory = memory
        self._names = {name for name, pose in believed.items() if math.dist((moved @ pose).t, pose.t) > _FAR}
        self._earlier = {(name, status) for name, _, status, _ in self._attempts()}

    def decide(self) -> Decision | None:
        """What the newest attempt tells; None without one."""
        for name, target, status, why in self._attempts():
            if (name, status) in self._earlier or target not in self._names:
                continue
            if status == DONE:
                return Decision(True, False, f"the gripper has found {target} where it was believed to be")
            if status == FAILED and why == NOTHING_GRASPED:
                return Decision(False, False, f"the gripper has found nothing where {target} was believed to be")
        return None

    def _attempts(self) -> list[tuple[str, str, str, str]]:
        """Name, target, status and explanation of the actions `pick`."""
        return [
            (node.name, node.get("target", ""), node.get("status", ""), node.get("explanation", ""))
            for node in sorted(self._memory.nodes("action"), key=lambda node: node.name)
            if node.get("skill") == "pick"
        ]
