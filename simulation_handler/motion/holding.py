"""Objects in a gripper: their bodies go where it goes, whatever they meet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from dsr.math3d.transforms import Pose
from simulation_handler.state.bodies import Bodies
from simulation_handler.state.objects import BelievedObject


class GripperGrasp(NamedTuple):
    """An object in a gripper."""

    gripper: str
    """Name of the gripper."""
    world_from_gripper: Pose
    """Present pose of the gripper."""
    gripper_from_object: Pose | None = None
    """As the gripper knows it; None for where the object is believed to be when it is grasped."""


class HeldObjects:
    """Attaches bodies to grippers."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._gripper_from_object: dict[str, Pose] = {}

    def update(self, grasps: Mapping[str, GripperGrasp]) -> None:
        """Hold these objects, by name, and no others: each body goes with its gripper."""
        for item in self._bodies.objects.values():
            grasp = grasps.get(item.name)
            if grasp is None or item.name not in self._bodies.sim:
                self._release(item)
            else:
                self._carry(item, grasp)

    def forget(self, name: str) -> None:
        """Forget an object that is no more."""
        self._gripper_from_object.pop(name, None)

    def _carry(self, item: BelievedObject, grasp: GripperGrasp) -> None:
        if item.holder != grasp.gripper:
            self._gripper_from_object[item.name] = grasp.gripper_from_object or (
                grasp.world_from_gripper.inverse() @ self._bodies.pose(item.name)
            )
            item.leave_to_physics()
            item.holder = grasp.gripper
            self._bodies.set_static(item, True)
        world_from_object = grasp.world_from_gripper @ self._gripper_from_object[item.name]
        if self._bodies.pose(item.name).distance(world_from_object) != (0.0, 0.0):
            self._bodies.put(item, world_from_object.t, world_from_object.q)

    def _release(self, item: BelievedObject) -> None:
        if not item.holder:
            return
        item.holder = ""
        self._gripper_from_object.pop(item.name, None)
        if item.name in self._bodies.sim:
            self._bodies.set_static(item, False)
