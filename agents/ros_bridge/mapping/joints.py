"""`sensor_msgs/JointState` and the joints of a node."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
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
    """rad/s or m/s, not a number where the message does not say"""
    efforts: tuple[float, ...]
    """N m or N, not a number where the message does not say"""
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
    velocities, efforts = (_all_or_none(values.tolist(), len(names)) for values in (message.velocity, message.effort))
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


_SPAN = 0.1
"""s over which a velocity is measured that is not told: of shorter ones, steps of encoders would look like motion"""
_PIECES = 5
"""Positions that are kept of such a span: a device may tell a thousand a second"""
_LOST = 1.0
"""s without a sample after which nothing is known of a joint's velocity"""


class JointTable:
    """The newest values of all joints of a robot, whose parts tell theirs one by one.

    Many robots tell no velocities. Theirs are measured by their positions.
    """

    def __init__(self) -> None:
        self._values: dict[str, tuple[float, float, float]] = {}
        self._stamps: dict[str, float] = {}
        self._passed: dict[str, deque[tuple[float, float]]] = {}
        """Of joints whose velocity is not told: when (s) they were at which positions of late"""

    def add(self, sample: JointSample, at: float) -> None:
        """Take the values of a sample of time `at` (s). Raises `RosMessageError` if there were too many joints then."""
        if len(self._values.keys() | set(sample.names)) > MOST_JOINTS:
            raise RosMessageError(f"more than {MOST_JOINTS} joints")
        for name, position, velocity, effort in zip(
            sample.names, sample.positions, sample.velocities, sample.efforts, strict=True
        ):
            known = velocity if math.isfinite(velocity) else self._measure(name, position, at)
            self._values[name] = position, known, effort
            self._stamps[name] = at

    def _measure(self, name: str, position: float, at: float) -> float:
        """rad/s or m/s since the last position that is old enough, or the first one; 0 until half a span is known."""
        passed = self._passed.setdefault(name, deque())
        if passed and not 0.0 <= at - passed[-1][0] <= _LOST:
            passed.clear()
        while len(passed) > 1 and at - passed[1][0] >= _SPAN:
            passed.popleft()
        begun, begin = passed[0] if passed else (at, position)
        if not passed or at - passed[-1][0] >= _SPAN / _PIECES:
            passed.append((at, position))
        return (position - begin) / (at - begun) if at - begun >= _SPAN / 2 else 0.0

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

    def oldest(self, names: Iterable[str]) -> float:
        """Time (s) of the oldest of the newest samples of these joints. Raises `KeyError`."""
        return min(self._stamps[name] for name in names)

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> tuple[float, float, float]:
        """Position, velocity and effort of a joint. Raises `KeyError`."""
        return self._values[name]


def _all_or_none(values: list[float], count: int) -> tuple[float, ...]:
    return tuple(values) if len(values) == count else (math.nan,) * count


def _chosen(values: tuple[_T, ...], indexes: list[int]) -> tuple[_T, ...]:
    return values if len(indexes) == len(values) else tuple(values[index] for index in indexes)
