"""Finds the bars of a gripper's linkage: joints that mimic what also moves the link on which they are."""

from __future__ import annotations

from typing import NamedTuple

from agents.arm_controller.model.arm_model import ArmModel
from agents.arm_controller.model.urdf import Joint


class Bar(NamedTuple):
    """A joint whose position follows from that of a joint above it in the same finger."""

    joint: str
    above: str
    factor: float
    offset: float
    """rad or m; position = factor * position above + offset"""


def bars_of(model: ArmModel) -> list[Bar]:
    """The bars of all fingers. In each finger the first joint is none: it is moved for itself."""
    found = []
    for joint in model.robot.joints:
        above = _above(model, joint)
        if joint.name not in model.gripper.names or joint.mimic is None or above is None:
            continue
        if above.name == joint.mimic.joint:
            found.append(Bar(joint.name, above.name, joint.mimic.multiplier, joint.mimic.offset))
        elif above.mimic is not None and above.mimic.joint == joint.mimic.joint and above.mimic.multiplier:
            factor = joint.mimic.multiplier / above.mimic.multiplier
            found.append(Bar(joint.name, above.name, factor, joint.mimic.offset - factor * above.mimic.offset))
    return found


def _above(model: ArmModel, joint: Joint) -> Joint | None:
    """The next joint above in the same finger that moves; None for the first one."""
    parents, link = model.robot.parents, joint.parent
    while link != model.palm and link in parents:
        if parents[link].name in model.gripper.names:
            return parents[link]
        link = parents[link].parent
    return None
