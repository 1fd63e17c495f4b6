"""Brings a camera that an arm carries to other places, by actions of the arm: a turned view tells more."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from itertools import count

from agents.calibrator.config import CalibratorConfig
from agents.calibrator.watch.decision import Decision
from dsr.errors import DsrError
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.vocabulary.arms import CONTROLLER, arm_nodes, arm_of_action, controller_of, first_arm, gripper_node_of
from dsr.vocabulary.intentions import DONE, ENDED, FAILED, HALT, NOTHING_GRASPED, PLANNED, RUN, RUNNING
from dsr.vocabulary.relations import nodes_by_name

Script = Generator[None, None, None]

SOURCE = "calibrator"
"""`source` of the action nodes."""
MOST_MOVES = 2
"""Number of places from which a camera looks besides its own, unless told otherwise."""
_TURNS = (0.9, -0.9, 0.6, -0.6, 1.5, -1.5)  # rad about the vertical
_TILTS = (0.0, math.pi, 0.5 * math.pi, -0.5 * math.pi)  # rad, directions in which it leans over the objects
_LEAN = 0.3  # rad
_NEARER = 0.9  # of the distance from which it looked
_FREE_WITHIN = 8.0  # s that others may take to give the arm free
_MOVED_WITHIN = 20.0  # s that a motion may take
_LINGER = 2.0  # s that it stays, so that what is seen from there can be explained
_SEEN_WITHIN = 1.5  # s beyond the span of a view


def can_look(memory: Memory, parent: str) -> bool:
    """Whether the frame that carries a camera is part of an arm that can be asked to move."""
    node = memory.get_node(parent)
    return node is not None and node.type == "gripper" and _has_controller(memory, parent)


class Looking:
    """The moves of an arm for one camera in doubt.

    Args:
        memory: the graph.
        parent: the gripper that carries the camera.
        camera: name of its node.
        middle: m, world: what to look at.
        views: says how many views there are by now.
        config: the gripper's tool point, and how long a view takes.
        most: from so many places, beside where it is.
    """

    def __init__(
        self,
        memory: Memory,
        parent: str,
        camera: str,
        middle: Vector3,
        views: Callable[[], int],
        config: CalibratorConfig,
        most: int = MOST_MOVES,
    ) -> None:
        self._most = most
        self._memory = memory
        self._parent = parent
        arm = _arm_with(memory, parent)
        self._arm = first_arm(memory) if arm is None else arm.name
        self._camera = camera
        self._middle = middle
        self._views = views
        self._config = config
        self._gripper_from_tool = Pose(config.gripper_from_tool)
        self._name = ""
        self._count = 0
        self._home: Pose | None = None
        self._script: Script | None = self._look_around()
        self.goes_home = False
        """Whether it is done with looking."""

    @property
    def is_over(self) -> bool:
        """Whether there is nowhere left to look from."""
        return self._script is None

    def update(self) -> None:
        """Continue the script of moves by one step."""
        if self._script is not None:
            try:
                next(self._script)
            except StopIteration:
                self._script = None

    def go_home(self) -> None:
        """Stop looking, because the decision is known, and go back unless somebody else works with the arm."""
        self.goes_home = True
        self._stop()
        self._script = self._return()

    def _look_around(self) -> Script:
        try:
            world_from_gripper = self._memory.transform(WORLD, self._parent)
            world_from_camera = self._memory.transform(WORLD, self._camera)
        except DsrError:
            return
        self._home = world_from_gripper @ self._gripper_from_tool
        found = 0
        for turn in _TURNS:
            for azimuth in _TILTS:
                if found >= self._most:
                    return
                there = _orbited(world_from_camera, self._middle, turn, azimuth)
                tool = there @ world_from_camera.inverse() @ self._home
                yield from self._free()
                before = self._views()
                if not (yield from self._run(tool)):
                    continue
                if (yield from self._seen(before)):
                    found += 1
                    break

    def _return(self) -> Script:
        began = self._now()
        while self._now() - began < _LINGER:
            yield
        if self._home is not None and self._count and not self._others():
            yield from self._run(self._home)
        self._drop()

    def _free(self) -> Script:
        """Wait until nobody else works with the arm: a plan halts while the camera is in doubt."""
        began = self._now()
        while self._others() and self._now() - began < _FREE_WITHIN:
            yield

    def _run(self, tool: Pose) -> Generator[None, None, bool]:
        """Bring the tool point there (world_from_tool); whether it came there."""
        self._drop()
        self._count += 1
        names = (f"action_look_{self._memory.rid}_{number}" for number in count(1))
        self._name = next(name for name in names if name not in self._memory)
        values = {"skill": "move", "status": PLANNED, "request": RUN, "source": SOURCE, "explanation": ""}
        values["arm"] = self._arm
        self._memory.add_node(self._name, "action", target_pose=tool, **values)
        began = self._now()
        while (node := self._memory.get_node(self._name)) is not None and node.get("status") not in ENDED:
            if self._now() - began > _MOVED_WITHIN:
                self._stop()
                return False
            yield
        return node is not None and node.get("status") == DONE

    def _seen(self, before: int) -> Generator[None, None, bool]:
        """Whether the camera sees enough from there."""
        began = self._now()
        while self._now() - began < self._config.span + _SEEN_WITHIN:
            if self._views() > before:
                return True
            yield
        return False

    def _others(self) -> bool:
        """Whether the arm does something for somebody else, or is about to."""
        return any(
            node.name != self._name
            and arm_of_action(self._memory, node) == self._arm
            and (node.get("status") == RUNNING or (node.get("status") == PLANNED and node.get("request") == RUN))
            for node in self._memory.nodes("action")
        )

    def _stop(self) -> None:
        node = self._memory.get_node(self._name) if self._name else None
        if node is not None and node.get("status") not in ENDED:
            self._memory.update_node(self._name, request=HALT)

    def _drop(self) -> None:
        if self._name:
            self._memory.remove_node(self._name)
            self._name = ""

    def _now(self) -> float:
        return self._memory.clock.now()


def _orbited(world_from_camera: Pose, middle: Vector3, turn: float, azimuth: float) -> Pose:
    """The camera turned about the vertical through `middle` (m), leaning over it in a direction, and a bit nearer."""
    about = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, turn))
    lean = Pose.from_rotvec((0.0, 0.0, 0.0), (_LEAN * math.cos(azimuth), _LEAN * math.sin(azimuth), 0.0))
    x, y, z = middle
    relative = Pose((-x, -y, -z)) @ world_from_camera
    nearer = Pose((_NEARER * relative.t[0], _NEARER * relative.t[1], _NEARER * relative.t[2]), relative.q)
    return Pose(middle) @ lean @ about @ nearer


def _arm_with(memory: Memory, gripper: str) -> Node | None:
    """The arm that moves a gripper."""
    return next((arm for arm in arm_nodes(memory) if gripper_node_of(arm) == gripper), None)


def _has_controller(memory: Memory, gripper: str) -> bool:
    arm = _arm_with(memory, gripper)
    agent = CONTROLLER if arm is None else controller_of(arm)
    return any(agent_of(rid) == agent for rid in memory.peers)


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
        """Decide by the newest attempt to grasp; None without one."""
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
            for node in nodes_by_name(self._memory, "action")
            if node.get("skill") == "pick"
        ]
