"""The robot in the graph: its nodes, the RT edges of its kinematic chain, and its measured joints."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from agents.arm_controller.config import ArmControllerConfig, CameraConfig
from agents.arm_controller.joints import Joints
from agents.arm_controller.model.arm_model import ArmModel
from agents.arm_controller.model.shapes import bounds
from agents.arm_controller.model.urdf import Joint
from dsr import Memory
from dsr.errors import ConfigError, suggest
from dsr.math3d.transforms import Pose
from dsr.vocabulary.arms import CONTROLLER

STILL = 1e-4
"""rad or m; a joint that moved less stands still"""
STILL_OPENING = 1e-4
"""m of opening, below which the gripper counts as still"""
REFRESH = 0.05
"""s after which the edge of a joint that stands still is written again"""


@dataclass(frozen=True)
class _Segment:
    """A moving RT edge: fixed joints folded into one pose, then the joint."""

    parent: str
    child: str
    fixed: Pose
    joint: Joint

    def pose(self, position: float, stamp: float) -> Pose:
        """parent_from_child at joint `position` (rad or m) and time `stamp` (s)."""
        return (self.fixed @ self.joint.pose(position)).with_stamp(stamp)


@dataclass
class _Plan:
    """What belongs into the graph."""

    nodes: dict[str, str] = field(default_factory=dict)
    """Type by name."""
    fixed: dict[tuple[str, str], Pose] = field(default_factory=dict)
    """RT edges of the robot's own construction."""
    mounts: dict[tuple[str, str], Pose] = field(default_factory=dict)
    """RT edges that a calibration may know better: written only where there is none."""
    segments: list[_Segment] = field(default_factory=list)
    bounds: dict[str, tuple[float, ...]] = field(default_factory=dict)
    """Box around what a node stands for, in its frame."""


class RobotNodes:
    """Writes one robot into the memory.

    Args:
        memory: where to.
        model: the robot and its arm.
        config: names, mounts and cameras. Raises `ConfigError` for links and parents that do not exist.
        agent: which moves the arm, as its node tells.
    """

    def __init__(
        self, memory: Memory, model: ArmModel, config: ArmControllerConfig, agent: str = CONTROLLER
    ) -> None:
        self._memory = memory
        self._agent = agent
        self._config = config
        self._chain = model.chain
        self._plan = _plan(model, config)
        self._written: list[tuple[float, float]] = []  # position and stamp of each segment's edge
        self._moves = True  # as the joint values in the graph say
        self._opening = math.inf
        self._contact: bool | None = None
        self._forget()
        self._joint_names = ",".join(model.chain.names)

    def write(self, joints: Joints) -> None:
        """Write one sample as a bundle: the moving edges with its stamp, and the measured attributes.

        What stands still is written every `REFRESH` s only: a pose holds for longer than that after its stamp.
        """
        config, memory = self._config, self._memory
        if not self._is_complete():
            self.build()
        segments, stamp = self._plan.segments, joints.stamp
        moves = refreshed = False
        positions = self._chain.all_positions(joints.positions).tolist()
        with memory.batch():
            for index, (segment, position) in enumerate(zip(segments, positions, strict=True)):
                last, at = self._written[index]
                still = abs(position - last) <= STILL
                if still and stamp - at < REFRESH:
                    continue
                memory.add_edge(segment.parent, segment.child, "RT", pose=segment.pose(position, stamp))
                self._written[index] = position, stamp
                moves, refreshed = moves or not still, True
            if moves or (refreshed and self._moves):
                memory.update_node(config.arm, joint_positions=joints.positions, joint_velocities=joints.velocities)
                self._moves = moves
            if abs(joints.opening - self._opening) > STILL_OPENING or joints.contact != self._contact:
                memory.update_node(config.gripper, opening=joints.opening, contact=joints.contact)
                self._opening, self._contact = joints.opening, joints.contact

    def build(self) -> None:
        """Put all nodes and fixed edges in place; mounts that are there already are left as they are."""
        memory, config, plan = self._memory, self._config, self._plan
        with memory.batch():
            for name, kind in plan.nodes.items():
                memory.add_node(name, kind)
            memory.update_node(
                config.arm, joint_names=self._joint_names, controller=self._agent, gripper=config.gripper
            )
            for name, box in plan.bounds.items():
                memory.update_node(name, bounds=box)
            for part in ("body", "mind"):
                memory.add_edge(config.robot, part, "has")
            for (parent, child), pose in plan.fixed.items():
                memory.add_edge(parent, child, "RT", pose=pose)
            for (parent, child), pose in plan.mounts.items():
                if memory.get_edge(parent, child, "RT") is None:
                    memory.add_edge(parent, child, "RT", pose=pose)
        self._forget()

    def _forget(self) -> None:
        """Write everything with the next sample."""
        self._written = [(math.inf, -math.inf)] * len(self._plan.segments)
        self._moves = True
        self._opening, self._contact = math.inf, None

    def _is_complete(self) -> bool:
        """Whether nobody removed a part since `build`."""
        memory, plan = self._memory, self._plan
        edges = (*plan.fixed, *plan.mounts)
        return all(name in memory for name in plan.nodes) and all(memory.get_edge(*edge, "RT") for edge in edges)


def _plan(model: ArmModel, config: ArmControllerConfig) -> _Plan:
    plan = _Plan(nodes={"world": "world", config.robot: "robot", "body": "body", "mind": "mind", config.arm: "arm"})
    plan.mounts["world", config.robot] = config.mount.pose()
    plan.mounts[config.robot, config.arm] = config.arm_mount.pose()
    parent, fixed = config.arm, Pose.identity()
    links = {config.arm: model.base}
    for joint in model.robot.between(model.base, model.palm):
        if joint.moves:
            link = f"{config.arm}_link_{len(plan.segments) + 1}"
            plan.nodes[link] = "body"
            plan.segments.append(_Segment(parent, link, fixed, joint))
            links[link] = joint.child
            parent, fixed = link, Pose.identity()
        else:
            fixed = fixed @ joint.origin
    plan.nodes[config.gripper] = "gripper"
    plan.fixed[parent, config.gripper] = fixed
    plan.bounds = _bounds(model, config, links)
    for name, camera in config.cameras.items():
        parent, pose = _camera_mount(name, camera, model, config, plan.nodes)
        plan.nodes[name] = "camera"
        plan.mounts[parent, name] = pose
    return plan


def _bounds(model: ArmModel, config: ArmControllerConfig, links: dict[str, str]) -> dict[str, tuple[float, ...]]:
    """Boxes around the link of each node and what is fixed to it; for the gripper around palm and open fingers."""
    robot, palm, gripper = model.robot, model.palm, model.gripper
    boxes = {node: robot.rigid(link, without=palm) for node, link in links.items() if link != palm}
    boxes[config.gripper] = (*robot.rigid(palm), *gripper.boxes(gripper.widest))
    return {node: box for node in boxes if (box := bounds(boxes[node])) is not None}


def _camera_mount(
    name: str, camera: CameraConfig, model: ArmModel, config: ArmControllerConfig, nodes: dict[str, str]
) -> tuple[str, Pose]:
    """The node that carries a camera, and parent_from_camera."""
    if camera.link:
        pose = Pose.identity()
        for joint in model.robot.between(model.palm, camera.link):
            if joint.moves:
                raise ConfigError(
                    f"camera {name!r}: joint {joint.name!r} moves link {camera.link!r}; expected a fixed one"
                )
            pose = pose @ joint.origin
        return config.gripper, pose
    if camera.parent not in nodes:
        raise ConfigError(
            f"camera {name!r}: its parent {camera.parent!r} is no node of the robot; {suggest(camera.parent, nodes)}"
        )
    return camera.parent, camera.mount.pose()
