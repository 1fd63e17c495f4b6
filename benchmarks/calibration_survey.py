"""An agent that asks for a calibration, then looks from four other arm poses at how far cubes are from beliefs."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any

import msgspec
import numpy as np

from benchmarks.calibration_scene import EVALUATED_FROM
from dsr.agent import Access, Agent
from dsr.math3d.transforms import Pose
from dsr.vocabulary.calibration import ANSWERED, CALIBRATION, request_calibration
from dsr.vocabulary.intentions import DONE, ENDED, PLANNED, RUN

_LOOK = 1.0  # s at each pose
_CAMERA, _GRIPPER = "camera_wrist", "gripper"
_GRIPPER_FROM_TOOL = Pose((0.0, 0.0, 0.12))
_MIDDLE = (0.36, 0.0, 0.02)
_ROUNDS = 3  # in which the aim converges


class SurveyConfig(msgspec.Struct, frozen=True):
    """When it begins."""

    begin: float = 5.0
    """s after it was started"""
    method: str = "robust"


class Surveyor(Agent):
    """One session of calibration with its evaluation; what it found is in `Surveyor.found`."""

    name = "surveyor"
    rate_hz = 10.0
    reads = Access(nodes=("*",), edges=("*",), attributes=("*",))
    writes = Access(
        nodes=("mind", "action", CALIBRATION),
        edges=("has",),
        attributes=("skill", "target_pose", "status", "request", "target", "method", "forced", "views"),
    )
    Config = SurveyConfig
    config: SurveyConfig

    found: dict[str, Any]
    """Of the newest one in this process: m, `before` and `after` the calibration, a list for each."""

    def setup(self) -> None:
        """Nothing is found yet."""
        Surveyor.found = {"before": [], "after": [], "status": ""}
        self._began = self.clock.now()
        self._script: Generator[None, None, None] | None = self._session()

    def tick(self, now: float) -> None:
        """Go on."""
        if self._script is not None:
            try:
                next(self._script)
            except StopIteration:
                self._script = None

    def _session(self) -> Generator[None, None, None]:
        while self.clock.now() - self._began < self.config.begin:
            yield
        mount = self.memory.edge(_GRIPPER, _CAMERA, "RT")["pose"]
        request = request_calibration(self.memory, _CAMERA, method=self.config.method, force=True)
        while (node := self.memory.get_node(request)) is not None and node.get("status") not in ANSWERED:
            yield
        Surveyor.found["status"] = "" if node is None else node.get("explanation", "")
        began = self.clock.now()
        while self.clock.now() - began < _LOOK:
            yield
        down = self.memory.transform("world", _GRIPPER)
        for number, place in enumerate(EVALUATED_FROM):
            if (yield from self._moved(number, _aimed(down, mount, place))):
                yield from self._look(mount)

    def _moved(self, number: int, tool: Pose) -> Generator[None, None, bool]:
        name = f"action_survey_{number}"
        self.memory.add_node(name, "action", skill="move", target_pose=tool, status=PLANNED, request=RUN)
        while (node := self.memory.node(name)).get("status") not in ENDED:
            yield
        if node.get("status") != DONE:
            self.log.warning("cannot look from pose %d: %s", number, node.get("explanation"))
        return bool(node.get("status") == DONE)

    def _look(self, mount: Pose) -> Generator[None, None, None]:
        """Average over a second; `mount` is what the calibration replaced."""
        began, arrived = self.clock.now(), self.clock.now()
        errors: dict[str, list[tuple[float, float]]] = {}
        stamps: dict[str, float] = {}
        while self.clock.now() - began < _LOOK:
            for edge in self.memory.edges("RT", src=_CAMERA):
                seen, belief = edge["pose"], self.memory.get_edge("world", edge.dst, "Virtual_RT")
                if belief is None or seen.stamp <= arrived or stamps.get(edge.dst) == seen.stamp:
                    continue
                stamps[edge.dst] = seen.stamp
                world_from_gripper = self.memory.transform("world", _GRIPPER, at=seen.stamp)
                now = self.memory.edge(_GRIPPER, _CAMERA, "RT")["pose"]
                off = [math.dist((world_from_gripper @ one @ seen).t, belief["pose"].t) for one in (mount, now)]
                errors.setdefault(edge.dst, []).append((off[0], off[1]))
            yield
        for pairs in errors.values():
            before, after = np.mean(pairs, axis=0).tolist()
            Surveyor.found["before"].append(before)
            Surveyor.found["after"].append(after)


def _aimed(world_from_gripper: Pose, gripper_from_camera: Pose, place: tuple[float, float, float]) -> Pose:
    """world_from_tool with the gripper at `place` (m), turned as it was, its camera looking at the middle.

    It is not the gripper that points there: its fingers would hide the cubes.
    """
    right = world_from_gripper.rotation_matrix[:, 0]
    rotation = world_from_gripper.rotation_matrix
    for _ in range(_ROUNDS):
        forward = np.subtract(_MIDDLE, place) - rotation[:, 1] * gripper_from_camera.t[1]
        forward /= np.linalg.norm(forward)
        side = right - (right @ forward) * forward
        side /= np.linalg.norm(side)
        rotation = np.column_stack([side, np.cross(forward, side), forward])
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = place
    return Pose.from_matrix(matrix) @ _GRIPPER_FROM_TOOL
