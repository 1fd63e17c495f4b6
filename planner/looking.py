"""Has the arm look, with a camera that it carries: at one place, or wherever no fixed camera sees."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.vocabulary.arms import arm_nodes, first_arm, gripper_node_of
from dsr.vocabulary.intentions import DONE
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.relations import nodes_by_name, read_relations
from planner.actions import other_action
from planner.arm import Arm, Script
from planner.config import PlannerConfig
from planner.errors import Setback
from planner.grounding import Skill, grid, within_reach
from planner.outlook import APART, DOWN, expected_information
from planner.state import KnownSolid, WorldState, read_state


class Search:
    """Looks for things that are nowhere, once.

    Args:
        memory: the graph.
        arm: carries the camera.
        config: heights and times.
        now: gives the time, s.
    """

    def __init__(self, memory: Memory, arm: Arm, config: PlannerConfig, now: Callable[[], float]) -> None:
        self._memory, self._arm, self._config, self._now = memory, arm, config, now
        self.problem = ""
        """Why it cannot look; empty if it can."""
        self.places = 0
        """From how many places it has looked."""

    def look(self, wanted: Callable[[], bool], why: str) -> Script:
        """Look around while something is still `wanted`, and let the arm rest then; `why` is told meanwhile."""
        self.places, self.problem = 0, ""
        camera, views = self._views()
        if not views:
            return
        told = f"looking around; {why}"
        yield from self._arm.rest(told)  # it may be in front of what is sought
        for view in views:
            if not wanted() or self.problem:
                break
            yield from self.look_from(view, camera, wanted, told)
        yield from self._arm.rest(told)
        self._arm.actions.drop(ended_too=True)

    def _views(self) -> tuple[str, list[Pose]]:
        """The camera that the arm carries, and where to bring it. Sets `problem` if it cannot look."""
        camera, intrinsics = carried_camera(self._memory)
        self.problem = self._obstacle(camera, intrinsics)
        if self.problem or intrinsics is None:
            return camera, []
        views = viewpoints(read_state(self._memory, self._config), intrinsics, self._config)
        self.problem = "" if views else "all places within reach are in view already"
        return camera, views

    def camera(self) -> str:
        """The camera that an arm can bring somewhere now; empty if none can, and then `problem` says why."""
        camera, intrinsics = carried_camera(self._memory)
        self.problem = self._obstacle(camera, intrinsics)
        return "" if self.problem else camera

    def _obstacle(self, camera: str, intrinsics: Intrinsics | None) -> str:
        """Why the arm cannot look; empty if it can."""
        if intrinsics is None:
            return "the arm carries no camera that sends images"
        if not self._arm.there:
            return "the arm controller does not run"
        if (busy := other_action(self._memory, "", carrier_of(self._memory, camera))) is not None:
            return f"the arm is busy with {busy}"
        held = read_relations(self._memory).held
        return f"the gripper holds {min(held)}" if held else ""

    def look_from(self, view: Pose, camera: str, wanted: Callable[[], bool], told: str) -> Script:
        """Bring the camera to `view` (world_from_camera), and stay there a while, as long as something is `wanted`."""
        arm = carrier_of(self._memory, camera) if len(self._arm.arms.all()) > 1 else ""
        try:
            progress = yield from self._arm.run_apart(Skill("look", camera, target_pose=view, arm=arm), told)
        except Setback as setback:
            self.problem = str(setback)
            return
        if progress.status == DONE:
            self.places += 1
            yield from self._stay(wanted)

    def _stay(self, wanted: Callable[[], bool]) -> Script:
        began = self._now()
        while wanted() and self._now() - began < self._config.look_for:
            yield


def carried_camera(memory: Memory) -> tuple[str, Intrinsics | None]:
    """The first camera by name that is fixed to a gripper, and how it takes images."""
    grippers = {node.name for node in memory.nodes("gripper")}
    for camera in nodes_by_name(memory, "camera"):
        intrinsics = read_intrinsics(camera)
        if intrinsics is not None and any(edge.src in grippers for edge in memory.edges("RT", dst=camera.name)):
            return camera.name, intrinsics
    return "", None


def carrier_of(memory: Memory, camera: str) -> str:
    """Name of the arm that carries a camera; the first arm for a camera that none carries."""
    grippers = {edge.src for edge in memory.edges("RT", dst=camera)}
    carrier = next((arm.name for arm in arm_nodes(memory) if gripper_node_of(arm) in grippers), None)
    return carrier or first_arm(memory)


def viewpoints(state: WorldState, intrinsics: Intrinsics, config: PlannerConfig) -> list[Pose]:
    """world_from_camera of looks straight down that show the table within reach, where no fixed camera sees it.

    Each tells most of where a thing is that may be at any of those places or at none of them, all as probable, and was
    not shown by those before it; at most `config.most_looks`.
    """
    table = state.solids.get(state.table or "")
    if table is None:
        return []
    places = _within_reach(table, state, config)
    unseen = np.ones(len(places), bool)
    for view in state.views:
        unseen &= ~view.sees(np.column_stack([places, np.full(len(places), table.pose.t[2])]), config.image_margin)
    shown = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) <= _radius(intrinsics, config)
    height = table.pose.t[2] + config.look_height
    seen = np.column_stack([shown, np.zeros(len(places))])
    found: list[Pose] = []
    while unseen.any() and len(found) < config.most_looks:
        told = expected_information(np.append(unseen, 1.0) / (unseen.sum() + 1.0), seen)
        best = int(np.round(told, 9).argmax())
        found.append(Pose((*places[best].tolist(), height), DOWN))
        unseen &= ~shown[best]
    return found


def _radius(intrinsics: Intrinsics, config: PlannerConfig) -> float:
    """M about the middle of the image that it shows from the height of a look, however the camera is turned."""
    margin = 1.0 - 2.0 * config.image_margin
    return config.look_height * margin * min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy) / 2.0


def _within_reach(table: KnownSolid, state: WorldState, config: PlannerConfig) -> Array:
    """(n, 2) places on the table, x and y in the world (m), where the arm can put something."""
    places = grid(table, 0.0, APART)
    near_enough: Array = places[within_reach(places, state, config)]
    return near_enough
