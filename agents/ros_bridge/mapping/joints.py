"""`sensor_msgs/JointState` and the joints of a node."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header, to_seconds
from agents.ros_bridge.messages.types import RosTypes

JOINT_STATE = "sensor_msgs/msg/JointState"
MOST_JOINTS = 512
"""Joints of one robot, of hands and faces, too: what has more is no robot but an attack on memory."""


class JointSample(NamedTuple):
    """What one message says of some joints."""

    stamp: float
    """s; 0 if it does not say"""
    names: tuple[str, ...]
    positions: tuple[float, ...]
    """rad or m"""
    velocities: tuple[float, ...]
    """rad/s or m/s, 0 where the message does not say"""
    efforts: tuple[float, ...]
    """N m or N, 0 where the message does not say"""


def read_joints(message: Any) -> JointSample:
    """Read a JointState. Raises `RosMessageError` if positions are missing or not finite, or names occur twice."""
    names = tuple(message.name)
    positions = tuple(message.position.tolist())
    if len(positions) != len(names) or len(names) > MOST_JOINTS:
        raise RosMessageError(f"a JointState of {len(names)} names and {len(positions)} positions")
    if len(set(names)) != len(names) or any("," in name or not name for name in names):
        raise RosMessageError(f"a JointState with names twice, empty or with a comma: {names!s:.200}")
    if not all(map(math.isfinite, positions)):
        raise RosMessageError("a JointState with a position that is not finite")
    velocities, efforts = (_or_zeros(values.tolist(), len(names)) for values in (message.velocity, message.effort))
    return JointSample(to_seconds(message.header.stamp), names, positions, velocities, efforts)


def to_joint_state(
    types: RosTypes, stamp: float, names: Sequence[str], positions: Sequence[float], velocities: Sequence[float] = ()
) -> Any:
    """A JointState; `velocities` may be empty."""
    return types.new(
        JOINT_STATE, header=to_header(types, stamp, ""), name=list(names), position=positions, velocity=velocities
    )


class JointTable:
    """The newest values of all joints of a robot, whose parts tell theirs one by one."""

    def __init__(self) -> None:
        self.stamp = 0.0
        """s, of the newest sample"""
        self._values: dict[str, tuple[float, float, float]] = {}

    def add(self, sample: JointSample) -> None:
        """Take the values of a sample. Raises `RosMessageError` if there were too many joints then."""
        if len(self._values.keys() | set(sample.names)) > MOST_JOINTS:
            raise RosMessageError(f"more than {MOST_JOINTS} joints")
        values = zip(sample.positions, sample.velocities, sample.efforts, strict=True)
        self._values.update(zip(sample.names, values, strict=True))
        self.stamp = max(self.stamp, sample.stamp)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, in the order in which they were first heard of."""
        return tuple(self._values)

    @property
    def positions(self) -> tuple[float, ...]:
        """Rad or m, in the order of `names`"""
        return tuple(position for position, _, _ in self._values.values())

    @property
    def velocities(self) -> tuple[float, ...]:
        """rad/s or m/s, in the order of `names`"""
        return tuple(velocity for _, velocity, _ in self._values.values())

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> tuple[float, float, float]:
        """Position, velocity and effort of a joint. Raises `KeyError`."""
        return self._values[name]


def _or_zeros(values: list[float], count: int) -> tuple[float, ...]:
    return tuple(values) if len(values) == count and all(map(math.isfinite, values)) else (0.0,) * count
