"""Has an arm look, with a camera that it carries: at one place, or wherever no fixed camera sees."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.intentions import DONE
from dsr.vocabulary.intrinsics import Intrinsics
from dsr.vocabulary.relations import read_relations
from planner.actions import other_action
from planner.arm import Arm, Script
from planner.carried import CarriedCamera, carried_cameras
from planner.config import PlannerConfig
from planner.errors import Setback
from planner.grounding import Skill, grid, within_reach
from planner.likely_places import APART
from planner.outlook import DOWN, expected_information
from planner.state import WorldState, read_state


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
        views = self._views()
        if not views:
            return
        told = f"looking around; {why}"
        yield from self._arm.rest(told)  # it may be in front of what is sought
        for eye, view in views:
            if not wanted() or self.problem:
                break
            yield from self.look_from(view, eye, wanted, told)
        yield from self._arm.rest(told)
        self._arm.actions.drop(ended_too=True)

    def _views(self) -> list[tuple[CarriedCamera, Pose]]:
        """Where to bring which camera. Sets `problem` if none can be brought anywhere."""
        eyes = self.eyes()
        if not eyes:
            return []
        views = viewpoints(read_state(self._memory, self._config), eyes, self._config)
        self.problem = "" if views else "all places within reach are in view already"
        return views

    def eyes(self) -> list[CarriedCamera]:
        """The cameras that arms can bring somewhere now; `problem` says why if there are none."""
        cameras = carried_cameras(self._memory, self._arm.arms)
        problems = [self._obstacle(camera) for camera in cameras]
        usable = [camera for camera, problem in zip(cameras, problems, strict=True) if not problem]
        self.problem = "" if usable else next(iter(problems), "the arm carries no camera that sends images")
        return usable

    def _obstacle(self, camera: CarriedCamera) -> str:
        """Why an arm cannot look with its camera; empty if it can."""
        arm = camera.carrier
        if arm.trouble or not self._arm.arms.runs(arm):
            return arm.trouble or "the arm controller does not run"
        if (busy := other_action(self._memory, "", arm.name)) is not None:
            return f"the arm is busy with {busy}"
        held = [thing for gripper, thing in read_relations(self._memory).grasping if gripper == arm.gripper]
        return f"the gripper holds {min(held)}" if held else ""

    def look_from(self, view: Pose, eye: CarriedCamera, wanted: Callable[[], bool], told: str) -> Script:
        """Bring a camera to `view` (world_from_camera), and stay there a while, as long as something is `wanted`."""
        skill = Skill("look", eye.name, target_pose=view, arm=eye.arm)
        try:
            progress = yield from self._arm.run_apart(skill, told)
        except Setback as setback:
            self.problem = str(setback)
            return
        if progress.status == DONE:
            self.places += 1
            yield from self._stay(wanted)

    def _stay(self, wanted: Callable[[], bool]) -> Script:
        began = self._now()
        while wanted() and self._now() - began < self._config.believed:
            yield


def viewpoints(
    state: WorldState, eyes: Sequence[CarriedCamera], config: PlannerConfig
) -> list[tuple[CarriedCamera, Pose]]:
    """Cameras, and world_from_camera of looks straight down on the table in reach where no fixed camera sees it.

    Each tells most of where a thing is that may be at any of those places or at none of them, all as probable, and was
    not shown by those before it. Beside the first there is none that would tell less than `config.least_information`,
    as far as it is probable that those before it show nothing.
    """
    table = state.solids.get(state.table or "")
    if table is None:
        return []
    places = grid(table, 0.0, APART)
    reached = np.array([within_reach(places, state, config, eye.arm) for eye in eyes])
    places, reached = places[reached.any(axis=0)], reached[:, reached.any(axis=0)]
    unseen = np.ones(len(places), bool)
    for view in state.views:
        unseen &= ~view.sees(np.column_stack([places, np.full(len(places), table.pose.t[2])]), 0.5 * APART)
    away = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    views = [(eye, place) for eye, within in zip(eyes, reached, strict=True) for place in np.flatnonzero(within)]
    shown = np.array([away[place] <= _radius(eye.intrinsics, config) for eye, place in views])
    height = table.pose.t[2] + config.look_height
    found: list[tuple[CarriedCamera, Pose]] = []
    sought = unseen.sum() + 1.0
    while unseen.any():
        told = expected_information(
            np.append(unseen, 1.0) / (unseen.sum() + 1.0), np.column_stack([shown, np.zeros(len(shown))])
        )
        best = int(np.round(told, 9).argmax())
        tells_little = (unseen.sum() + 1.0) / sought * told[best] < config.least_information
        if not (shown[best] & unseen).any() or (found and tells_little):  # one look is tried, however narrow
            break
        eye, place = views[best]
        found.append((eye, Pose((*places[place].tolist(), height), DOWN)))
        unseen &= ~shown[best]
    return found


def _radius(intrinsics: Intrinsics, config: PlannerConfig) -> float:
    """M about the middle of the image that it shows from the height of a look, however the camera is turned.

    What is there shows as a whole.
    """
    shown = config.look_height * min(intrinsics.width / intrinsics.fx, intrinsics.height / intrinsics.fy)
    return max(0.0, 0.5 * (shown - APART))
