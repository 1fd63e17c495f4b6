"""What a description of an arm holds, and what is doubtful in it, before anything moves."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec
import numpy as np

from agents.arm_controller.model.arm_model import ArmModel, load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import Joint
from agents.xacro_file import Value


class JointReport(msgspec.Struct, frozen=True):
    """A joint that moves."""

    name: str
    kind: str
    moves: str
    """The link that it moves."""
    role: str
    """`arm` or `fingers`"""
    mimics: str
    """Name of the joint that it follows; empty for one that is moved for itself"""
    lower: float | None
    """rad or m, its least position; None without limit"""
    upper: float | None
    """rad or m, its greatest position; None without limit"""
    velocity: float | None
    """rad/s or m/s; None if not given"""
    effort: float | None
    """N m or N; None if not given"""


class ArmReport(msgspec.Struct, frozen=True):
    """An arm as it would be used."""

    file: str
    robot: str
    base: str
    palm: str
    tool: str
    widest: float
    """m, the largest opening; 0 without fingers"""
    home: list[float]
    """rad or m; empty if nobody says"""
    joints: list[JointReport]
    boxes: dict[str, int]
    """How many boxes stand for the collision shapes of each link."""
    doubts: list[str]
    """What may be meant, and may not."""


def report_on(file: Path, args: Mapping[str, Value] | None = None) -> ArmReport:
    """What the description in `file` holds, with these arguments of its macros.

    Raises `ConfigError` for one that no arm controller would take.
    """
    model = load_arm(file, args=args)
    figure = Figure(model)
    names = {joint.name for joint in model.chain.moving}
    moving = [joint for joint in model.robot.joints if joint.name in names or joint.name in model.gripper.names]
    return ArmReport(
        file=str(file),
        robot=model.robot.name,
        base=model.base,
        palm=model.palm,
        tool=model.tool,
        widest=model.gripper.widest,
        home=list(model.home),
        joints=[_joint(joint, "arm" if joint.name in names else "fingers") for joint in moving],
        boxes={link: len(boxes) for link, boxes in model.robot.boxes.items()},
        doubts=list(_doubts(model, figure)),
    )


def _joint(joint: Joint, role: str) -> JointReport:
    return JointReport(
        name=joint.name,
        kind=joint.kind,
        moves=joint.child,
        role=role,
        mimics="" if joint.mimic is None else joint.mimic.joint,
        lower=_finite(joint.lower),
        upper=_finite(joint.upper),
        velocity=_finite(joint.velocity),
        effort=_finite(joint.effort),
    )


def _doubts(model: ArmModel, figure: Figure) -> Iterator[str]:
    chain = model.chain
    if drawn := model.robot.drawn_only:
        yield f"drawn without a <collision>, so the arm meets nothing with: {', '.join(drawn)}"
    for what in ("velocity", "effort"):
        if without := [joint.name for joint in chain.moving if not math.isfinite(getattr(joint, what))]:
            yield f"no limit of {what}: {', '.join(without)}"
    if not model.gripper.driven:
        yield f"no joint moves below {model.palm!r}: a gripper without fingers cannot pick"
    if not model.home:
        yield "no home posture: give observe_joints, or the state `home` in an SRDF file"
        return
    outside = (np.array(model.home) < chain.lower) | (np.array(model.home) > chain.upper)
    if outside.any():
        yield f"at home these joints are beyond their limits: {', '.join(np.array(chain.names)[outside])}"
    if figure.meets_itself(figure.boxes(np.array([model.home]), model.gripper.widest), 0.0).any():
        yield "at home the boxes around its shapes meet each other: the arm would not move"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
