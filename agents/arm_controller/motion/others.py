"""The other arms of the graph, as one arm minds them: where they are, where they are about to be, for whom they wait.

An arm announces each way before it sets out, in the attributes `way` and `way_times` of its node: the boxes of its
parts at some moments, in the world. `way_since` tells when it first wanted to go. Of two arms that want the same room
the one that has wanted it for longer goes first; of two that began at one moment, the first by name.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from agents.arm_controller.joints import Joints
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.model.urdf import MOST_LINKS
from agents.arm_controller.motion.obstacles import Load
from agents.arm_controller.motion.trajectory import Trajectory
from agents.arm_controller.scene import Obstacle
from dsr.frames.tree import WORLD
from dsr.graph.elements import Node
from dsr.math3d.boxes import Array, Boxes, gaps, stacked
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.arms import MOST_ARMS, arm_nodes, arms_beyond, gripper_node_of

APART = 0.015
"""m that ways of two arms keep apart, beside the margin to things: arms lag behind their ways by some mm"""
STRIDE = 0.05
"""m between two announced places of a part; each box is larger by half of that, so that none slips through"""
NEAR = 0.012
"""m of predicted distance at which the arm that moves into the other stops: less than ways keep, so that it is rare"""
AHEAD = (0.0, 0.1, 0.2, 0.3)
"""s ahead for which distances are predicted: an arm brakes within 0.3 s from the speeds of skills"""
SPAN = 0.1
"""s over which the speed of another arm's parts is measured: five samples"""
SILENT = 0.3
"""s without a sample after which another arm counts as stopped somewhere on its way"""
COAST = 1.0
"""s that an arm may have moved on after its last sample: its device stops it after 0.5 s, and it brakes"""
_NUMBERS = 10
"""Numbers of a box: pose (7) and edges (3)"""
MOST_BOXES = 4096
"""Boxes of a way that can be read; an arm of twelve parts has as many on a way of 17 m"""
_CLOSER = 0.001
"""m by which an arm must come closer to count as moving into another"""


class OtherArms:
    """All arms of the graph but one.

    Args:
        memory: the graph.
        arm: name of the one that minds the others.
    """

    def __init__(self, memory: Memory, arm: str) -> None:
        self._memory, self._arm = memory, arm
        self._seen: dict[str, deque[tuple[float, Array]]] = {}

    def names(self) -> list[str]:
        """Their names, in the order in which arms are listed."""
        return [node.name for node in arm_nodes(self._memory) if node.name != self._arm]

    def obstacles(self, now: float) -> list[Obstacle]:
        """The boxes of their parts at time `now` (s), and along their ways. Each has its arm's name."""
        found: list[Obstacle] = []
        for node in arm_nodes(self._memory):
            if node.name != self._arm:
                found += _grown(self._present(node), 2 * APART)
                found += _grown(self._ahead(node, now), 2 * APART + STRIDE)
        return found

    def state(self, name: str) -> tuple[object, ...]:
        """What must change before another arm leaves room: its way, and its joints to some hundredths of a radian."""
        node = self._memory.get_node(name)
        if node is None:
            return ()
        return node.get("way_times"), *(round(position, 2) for position in node.get("joint_positions", ()))

    def precedes(self, name: str) -> bool:
        """Whether another arm has wanted to go for longer than this one."""
        own, other = self._memory.get_node(self._arm), self._memory.get_node(name)
        return _order(other) < _order(own)

    def claims(self) -> tuple[object, ...]:
        """What changes when another arm announces a way, or takes one back."""
        nodes = [node for node in arm_nodes(self._memory) if node.name != self._arm]
        return tuple((node.name, node.get("way_since"), node.get("way_times")) for node in nodes)

    def obstacles_of_first(self, now: float) -> list[Obstacle]:
        """The boxes of those others that go first."""
        first = [name for name in self.names() if self.precedes(name)]
        return [box for box in self.obstacles(now) if box.name in first]

    def unreadable(self) -> str:
        """Name of an arm whose way nobody can read, or nobody looks at: it may go anywhere; empty for none."""
        nodes = [node for node in arm_nodes(self._memory) if node.name != self._arm]
        beyond = (name for name in arms_beyond(self._memory) if name != self._arm)
        return next((node.name for node in nodes if _read_way(node) is None), next(beyond, ""))

    def why_unreadable(self, name: str) -> str:
        """Tell people why the way of that arm is not known."""
        if name in arms_beyond(self._memory):
            return f"more than {MOST_ARMS} arms are there, and nobody looks at the way of {name}"
        return f"nobody can read the way that {name} has announced"

    def waits_for_us(self) -> list[str]:
        """Names of those that stand still until this one has gone."""
        nodes = arm_nodes(self._memory)
        return [node.name for node in nodes if node.name != self._arm and node.get("waits_for", "") == self._arm]

    def is_near(self, figure: Figure, world_from_arm: Pose, joints: Joints) -> str:
        """Name of an arm into which this one moves, as far as both go on as they do now; empty for none.

        Call it at each sample: the speeds of the others are measured from one call to the next.
        """
        for node in arm_nodes(self._memory):
            if node.name != self._arm and self._nears(node, figure, world_from_arm, joints):
                return node.name
        return ""

    def _nears(self, node: Node, figure: Figure, world_from_arm: Pose, joints: Joints) -> bool:
        parts = self._present(node)
        if not parts:
            return False
        there = stacked((part.pose, part.size) for part in parts)
        seen = self._sampled(node.name)
        rates, late = self._rates(node.name, seen, there.centers), joints.stamp - seen
        if late > SILENT:  # it may be anywhere on its way by now
            parts += self._ahead(node, joints.stamp)
            there = stacked((part.pose, part.size) for part in parts)
            rates, late = np.zeros_like(there.centers), 0.0
        rows = np.array([np.add(joints.positions, np.multiply(joints.velocities, ahead)) for ahead in AHEAD])
        here = _in_world(figure.boxes(rows, joints.opening), world_from_arm, figure.base_boxes)
        standing = [_least_gap(here, row, there) for row in range(len(AHEAD))]
        if min(standing) >= standing[0] - _CLOSER:
            return False
        moved = [Boxes(there.centers + rates * (late + ahead), there.axes, there.halves) for ahead in AHEAD]
        return any(_least_gap(here, row, boxes) < NEAR for row, boxes in enumerate(moved))

    def _rates(self, name: str, stamp: float, centers: Array) -> Array:
        """(k, 3) m/s of the centres of an arm's parts, which were sampled at `stamp` (s)."""
        seen = self._seen.setdefault(name, deque())
        if seen and len(seen[0][1]) != len(centers):
            seen.clear()
        if not seen or stamp > seen[-1][0]:
            seen.append((stamp, centers))
        while stamp - seen[0][0] > SPAN:
            seen.popleft()
        passed = stamp - seen[0][0]
        return (centers - seen[0][1]) / passed if passed > 0.0 else np.zeros_like(centers)

    def _present(self, node: Node) -> list[Obstacle]:
        """The parts of an arm where they are believed to be now, with what it holds."""
        gripper = gripper_node_of(node)
        parts = [node.name, *self._links(node.name), gripper]
        found = [box for part in parts if (box := self._part(node.name, part)) is not None]
        for edge in self._memory.edges("grasping", src=gripper):
            thing, pose = self._memory.get_node(edge.dst), self._memory.get_edge(WORLD, edge.dst, "Virtual_RT")
            if thing is not None and pose is not None and "size" in thing and "pose" in pose:
                found.append(Obstacle(node.name, pose.pose, thing["size"]))
        return found

    def _links(self, arm: str) -> list[str]:
        names = (f"{arm}_link_{number}" for number in range(1, MOST_LINKS + 1))
        return list(itertools.takewhile(self._memory.__contains__, names))

    def _part(self, arm: str, part: str) -> Obstacle | None:
        node, pose = self._memory.get_node(part), self._memory.get_transform(WORLD, part)
        bounds = None if node is None else node.get("bounds")
        if bounds is None or pose is None:
            return None
        low, high = np.array(bounds[:3]), np.array(bounds[3:])
        x, y, z = ((low + high) / 2).tolist()
        u, v, w = (high - low).tolist()
        return Obstacle(arm, pose @ Pose((x, y, z)), (u, v, w))

    def _ahead(self, node: Node, now: float) -> list[Obstacle]:
        """The boxes of an arm on what is left of its way; one that tells nothing more may be anywhere on it."""
        way = _read_way(node)
        if not way:
            return []
        seen = self._sampled(node.name)
        end = seen + COAST if now - seen > SILENT else math.inf
        until = (*(begin for begin, _ in way[1:]), math.inf)
        return [
            box
            for (begin, boxes), leaves in zip(way, until, strict=True)
            if leaves >= seen and begin <= end
            for box in boxes
        ]

    def _sampled(self, arm: str) -> float:
        """s, when the newest sample of an arm was taken; long ago without any."""
        pose = self._memory.get_pose(arm, f"{arm}_link_1", "RT")
        return -math.inf if pose is None else pose.stamp


class Announcer:
    """Tells the other arms where one arm is about to go, and for whom it waits.

    Args:
        memory: the graph.
        arm: name of the arm.
        figure: its shape.
    """

    def __init__(self, memory: Memory, arm: str, figure: Figure) -> None:
        self._memory, self._arm, self._figure = memory, arm, figure
        self._told = self._has_way = True  # until it is known that nothing is left of an earlier run
        self.since = math.inf
        """s, when the arm first wanted to go where it goes or waits to go; infinite if it wants nothing."""

    def want(self, now: float) -> None:
        """Note that the arm wants to go somewhere from time `now` (s) on, unless it does already."""
        self.since = min(self.since, now)

    def announce(self, trajectory: Trajectory, begin: float, world_from_arm: Pose, load: Load) -> None:
        """Tell the way of a trajectory that begins at `begin` (s), with what moves along."""
        self.want(begin)
        rows = _strides(self._figure, trajectory.positions, load.opening)
        parts = self._figure.boxes(trajectory.positions[rows], load.opening, load.held)
        boxes = _in_world(parts, world_from_arm, self._figure.base_boxes)
        numbers = [number for row in range(len(rows)) for number in _numbers(boxes, row)]
        times = tuple((begin + trajectory.times[rows]).tolist())
        self._has_way = True
        self._write(way=tuple(numbers), way_times=times, way_since=self.since, waits_for="")

    def wait_for(self, other: str, now: float) -> None:
        """Tell that the arm stands still, or is about to, until another one has gone."""
        self.want(now)
        self._write(way_since=self.since, waits_for=other)

    def withdraw(self) -> None:
        """Tell that the arm wants to go nowhere. The way stays until `rest`: an arm brakes on it, and may die there."""
        self.since = math.inf
        if self._told:
            self._forget("way_since", "waits_for")
        self._told = False

    def rest(self) -> None:
        """Take back the way of an arm that stands still, and does not want to go."""
        if self._has_way:
            self._forget("way", "way_times")
        self._has_way = False

    def _forget(self, *names: str) -> None:
        node = self._memory.get_node(self._arm)
        for name in [] if node is None else [name for name in names if name in node]:
            self._memory.remove_attribute(self._arm, name)

    def _write(self, **values: object) -> None:
        self._told = True
        if self._arm in self._memory:
            self._memory.update_node(self._arm, **values)


def _read_way(node: Node) -> list[tuple[float, list[Obstacle]]] | None:
    """When (s) an arm passes through which boxes; empty if it has announced no way, None if nobody can read that."""
    times, numbers = node.get("way_times", ()), node.get("way", ())
    if not len(times) or not len(numbers):
        return []
    if len(numbers) % (len(times) * _NUMBERS) or len(numbers) > MOST_BOXES * _NUMBERS:
        return None
    rows = np.array(numbers).reshape(len(times), -1, _NUMBERS)
    if (rows[..., 7:] < 0.0).any() or any(later < time for time, later in itertools.pairwise(times)):
        return None
    try:
        return [
            (
                time,
                [
                    Obstacle(node.name, Pose((x, y, z), (a, b, c, d)), (u, v, w))
                    for x, y, z, a, b, c, d, u, v, w in row.tolist()
                ],
            )
            for time, row in zip(times, rows, strict=True)
        ]
    except ValueError:  # numbers that are no rotation
        return None


def _order(node: Node | None) -> tuple[float, str]:
    return (math.inf, "") if node is None else (node.get("way_since", math.inf), node.name)


def _grown(parts: Sequence[Obstacle], by: float) -> list[Obstacle]:
    """The boxes with edges longer by so many m."""
    return [Obstacle(part.name, part.pose, tuple(edge + by for edge in part.size)) for part in parts]  # type: ignore[arg-type]


def _in_world(boxes: Boxes, world_from_arm: Pose, without: int) -> Boxes:
    """(m, b) boxes of an arm seen from the world, without the first ones, which stand still."""
    turn, offset = world_from_arm.rotation_matrix, np.array(world_from_arm.t)
    centers, axes, halves = (part[:, without:] for part in boxes)
    return Boxes(centers @ turn.T + offset, turn @ axes, halves)


def _least_gap(boxes: Boxes, row: int, others: Boxes) -> float:
    """M between a row of boxes and others; what is far apart is told as 1 m."""
    one = Boxes(*(part[row] for part in boxes))
    away = np.linalg.norm(one.centers[:, None] - others.centers, axis=-1) - one.radii[:, None] - others.radii
    a, b = np.nonzero(away < 0.2)
    return float(gaps(one.at(a), others.at(b)).min(initial=1.0))


def _strides(figure: Figure, positions: Array, opening: float) -> list[int]:
    """Rows of a way between which no part moves by more than `STRIDE`."""
    centers = figure.boxes(positions, opening).centers
    rows = [0]
    for row in range(1, len(positions)):
        ahead = min(row + 1, len(positions) - 1)
        if np.linalg.norm(centers[ahead] - centers[rows[-1]], axis=1).max() > STRIDE or row == len(positions) - 1:
            rows.append(row)
    return rows


def _numbers(boxes: Boxes, row: int) -> list[float]:
    """The numbers of a row of boxes: poses in the world, and edges."""
    found: list[float] = []
    for center, axes, half in zip(*(part[row] for part in boxes), strict=True):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = axes, center
        pose = Pose.from_matrix(matrix)
        found += [*pose.t, *pose.q, *(2 * half).tolist()]
    return found
