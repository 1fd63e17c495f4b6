"""Samples of a driver in the order of the kinematic chain, and commands back in the driver's order."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from agents.drivers import ArmState


class JointsError(ValueError):
    """A driver's sample that does not describe this arm."""


class Joints(msgspec.Struct, frozen=True):
    """One sample of the arm, joints in the order of the chain."""

    stamp: float
    """Time of the sample, s."""
    positions: tuple[float, ...]
    """Joint positions, rad."""
    velocities: tuple[float, ...]
    """Joint velocities, rad/s."""
    opening: float
    """m between the finger pads"""
    contact: bool
    """Whether both pads touch something."""
    efforts: tuple[float, ...] = ()
    """N m, N or A of each joint, as the driver tells it; empty if it tells none."""
    pressing: float | None = None
    """N or A with which the fingers press, as the driver tells it; None if it tells none."""


def read_joints(state: ArmState, names: Sequence[str]) -> Joints:
    """The sample of the joints called `names`. Raises `JointsError` if one is missing or not finite."""
    count = len(state.names)
    if len(state.positions) != count or len(state.velocities) != count:
        raise JointsError(f"{count} joint names, {len(state.positions)} positions, {len(state.velocities)} velocities")
    if len(state.efforts) not in (0, count):
        raise JointsError(f"{count} joint names, {len(state.efforts)} efforts")
    if twice := sorted({name for name in state.names if state.names.count(name) > 1}):
        raise JointsError(f"the driver tells joint {twice[0]!r} twice")
    if missing := set(names) - set(state.names):
        raise JointsError(f"the driver does not know joint {min(missing)!r}, only {', '.join(state.names)}")
    gripper = (state.gripper_opening, state.gripper_effort or 0.0)
    told = (state.stamp, *gripper, *state.positions, *state.velocities, *state.efforts)
    if not all(map(math.isfinite, told)):
        raise JointsError(f"not all numbers of the sample at {state.stamp} s are finite")
    order = [state.names.index(name) for name in names]
    return Joints(
        stamp=state.stamp,
        positions=tuple(state.positions[index] for index in order),
        velocities=tuple(state.velocities[index] for index in order),
        opening=state.gripper_opening,
        contact=state.gripper_contact,
        efforts=tuple(state.efforts[index] for index in order) if state.efforts else (),
        pressing=state.gripper_effort,
    )


def to_driver(positions: Sequence[float], names: Sequence[str], state: ArmState) -> tuple[float, ...]:
    """Positions of the joints `names` in the order of `state`; joints that are not among them stay."""
    wanted = dict(zip(names, positions, strict=True))
    return tuple(wanted.get(name, measured) for name, measured in zip(state.names, state.positions, strict=True))
