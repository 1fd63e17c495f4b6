"""`sensor_msgs/JointState` and the joints of a node."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeVar

from agents.ros_bridge.errors import RosMessageError
from agents.ros_bridge.mapping.stamps import to_header, to_seconds
from agents.ros_bridge.messages.types import RosTypes

JOINT_STATE = "sensor_msgs/msg/JointState"
_T = TypeVar("_T")
_LONGEST = 128
"""Characters of a joint's name, as of a node's"""
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
    unknown: tuple[str, ...] = ()
    """Further joints, whose positions are not numbers: ros2_control tells joints without a position sensor so"""


def read_joints(message: Any) -> JointSample:
    """Read a JointState.

    Raises:
        RosMessageError: if positions are missing, or none is finite; if names are twice, empty or too long.
    """
    names = tuple(message.name)
    positions = tuple(message.position.tolist())
    if len(positions) != len(names) or len(names) > MOST_JOINTS:
        raise RosMessageError(f"a JointState of {len(names)} names and {len(positions)} positions")
    if len(set(names)) != len(names) or any("," in name or not 0 < len(name) <= _LONGEST for name in names):
        raise RosMessageError(f"a JointState with names twice, empty, too long or with a comma: {names!s:.200}")
    known = [index for index, position in enumerate(positions) if math.isfinite(position)]
    if names and not known:
        raise RosMessageError("a JointState without any position that is finite")
    velocities, efforts = (_or_zeros(values.tolist(), len(names)) for values in (message.velocity, message.effort))
    return JointSample(
        to_seconds(message.header.stamp), _chosen(names, known), _chosen(positions, known),
        _chosen(velocities, known), _chosen(efforts, known),
        tuple(name for name, position in zip(names, positions, strict=True) if not math.isfinite(position)),
    )  # fmt: skip


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
        self._values: dict[str, tuple[float, float, float]] = {}

    def add(self, sample: JointSample) -> None:
        """Take the values of a sample. Raises `RosMessageError` if there were too many joints then."""
        if len(self._values.keys() | set(sample.names)) > MOST_JOINTS:
            raise RosMessageError(f"more than {MOST_JOINTS} joints")
        values = zip(sample.positions, sample.velocities, sample.efforts, strict=True)
        self._values.update(zip(sample.names, values, strict=True))

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
    if len(values) != count:
        return (0.0,) * count
    return tuple(value if math.isfinite(value) else 0.0 for value in values)


def _chosen(values: tuple[_T, ...], indexes: list[int]) -> tuple[_T, ...]:
    return values if len(indexes) == len(values) else tuple(values[index] for index in indexes)
