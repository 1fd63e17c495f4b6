"""The cameras that arms carry, and which arm brings each of them somewhere."""

from __future__ import annotations

from typing import NamedTuple

from dsr.memory import Memory
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.perceived import camera_nodes
from planner.arms import Arms, PlannedArm


class CarriedCamera(NamedTuple):
    """A camera that is fixed to a gripper and sends images."""

    name: str
    intrinsics: Intrinsics
    carrier: PlannedArm
    arm: str = ""
    """Name of the carrier; empty for the only arm"""


def carried_cameras(memory: Memory, arms: Arms) -> list[CarriedCamera]:
    """All of them, by name. What hangs on a gripper that no arm tells is carried by the first arm."""
    grippers, carriers = {node.name for node in memory.nodes("gripper")}, arms.all()
    found = []
    for camera in camera_nodes(memory):
        on = grippers & {edge.src for edge in memory.edges("RT", dst=camera.name)}
        intrinsics = read_intrinsics(camera)
        if intrinsics is not None and on:
            carrier = next((arm for arm in carriers if arm.gripper in on), carriers[0])
            name = carrier.name if len(carriers) > 1 else ""
            found.append(CarriedCamera(camera.name, intrinsics, carrier, name))
    return found
