"""Reads the joints and collision shapes of a robot description (URDF); inertias are left to simulators.

https://wiki.ros.org/urdf/XML/joint. SI units, radians.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, cast, get_args

from agents.arm_controller.model.collisions import read_boxes
from agents.arm_controller.model.shapes import LinkBox
from agents.urdf_elements import attribute, number, origin, parse_urdf, vector
from agents.xacro_file import Value, read_robot
from dsr.errors import ConfigError, suggest
from dsr.math3d.quaternions import Vector3, from_rotvec
from dsr.math3d.transforms import Pose

JointKind = Literal["revolute", "continuous", "prismatic", "fixed"]
MOST_LINKS = 300
"""Links that a robot may have: three times those of a humanoid with hands. Kinematics follows them one by one."""
_KINDS: tuple[str, ...] = get_args(JointKind)
_ORIGIN: Vector3 = (0.0, 0.0, 0.0)
_X_AXIS: Vector3 = (1.0, 0.0, 0.0)


def fixed_pose(joints: Iterable[Joint]) -> Pose:
    """From the parent of the first joint to the child of the last one, of joints in a row, at position 0."""
    pose = Pose.identity()
    for joint in joints:
        pose = pose @ joint.origin
    return pose


@dataclass(frozen=True)
class Mimic:
    """Says that a joint follows another one."""

    joint: str
    multiplier: float
    offset: float
    """rad or m"""

    def position(self, positions: Mapping[str, float]) -> float:
        """Position (rad or m) of the joint, from those of others by name."""
        return self.multiplier * positions[self.joint] + self.offset


@dataclass(frozen=True)
class Joint:
    """A joint between two links."""

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Pose
    """parent_from_child at position 0"""
    axis: Vector3
    """Unit vector in the child's frame that it turns about or slides along."""
    lower: float
    upper: float
    """rad or m; infinite for a continuous joint"""
    velocity: float
    """rad/s or m/s, the most; infinite if not given"""
    effort: float = math.inf
    """N m or N, the most; infinite if not given"""
    mimic: Mimic | None = None
    """Which joint it follows; None for one that is moved for itself"""

    @property
    def moves(self) -> bool:
        """Whether the joint moves, and so has a position."""
        return self.kind != "fixed"

    def pose(self, position: float) -> Pose:
        """parent_from_child at `position` (rad or m)."""
        if self.kind == "fixed":
            return self.origin
        x, y, z = self.axis
        step = (x * position, y * position, z * position)
        if self.kind == "prismatic":
            return self.origin @ Pose.unchecked(step, (0.0, 0.0, 0.0, 1.0))
        return self.origin @ Pose.unchecked(_ORIGIN, from_rotvec(step))


@dataclass(frozen=True)
class Robot:
    """A tree of links."""

    name: str
    root: str
    joints: tuple[Joint, ...]
    boxes: Mapping[str, tuple[LinkBox, ...]] = field(default_factory=dict)
    """Around the collision shapes, by link, in its frame."""
    drawn_only: tuple[str, ...] = ()
    """Links that are drawn, but collide with nothing."""

    @cached_property
    def parents(self) -> dict[str, Joint]:
        """The joint above each link but the root."""
        return {joint.child: joint for joint in self.joints}

    def between(self, base: str, tip: str) -> tuple[Joint, ...]:
        """The joints on the way from link `base` down to link `tip`. Raises `ConfigError` if there is no way."""
        self.check_link(base)
        self.check_link(tip)
        chain: list[Joint] = []
        link = tip
        while link != base:
            if link == self.root:
                raise ConfigError(f"robot {self.name!r}: link {tip!r} does not hang below link {base!r}")
            chain.append(self.parents[link])
            link = chain[-1].parent
        return tuple(reversed(chain))

    def below(self, link: str) -> Iterator[Joint]:
        """Yield all joints that hang, directly or not, below `link`."""
        for joint in self.joints:
            if joint.parent == link:
                yield joint
                yield from self.below(joint.child)

    def rigid(self, link: str, *, without: str = "") -> tuple[LinkBox, ...]:
        """Boxes of `link` and all that is fixed to it, in its frame; not of link `without` and what hangs there."""
        fixed = self.fixed_to(link, without=without)
        return tuple(box.seen_from(pose) for other, pose in fixed for box in self.boxes.get(other, ()))

    def fixed_to(self, link: str, *, without: str = "") -> Iterator[tuple[str, Pose]]:
        """`link` and all links that are fixed to it, with their poses in its frame; as of `rigid`."""
        yield link, Pose.identity()
        for joint in self.joints:
            if joint.parent == link and joint.child != without and not joint.moves:
                for other, pose in self.fixed_to(joint.child, without=without):
                    yield other, joint.origin @ pose

    def with_frame(self, name: str, parent: str, pose: Pose) -> Robot:
        """The same robot with a link without shape fixed to link `parent`, at `pose` (parent_from_link)."""
        self.check_link(parent)
        joint = Joint(f"{name}_joint", "fixed", parent, name, pose, _X_AXIS, -math.inf, math.inf, math.inf)
        return replace(self, joints=(*self.joints, joint))

    def check_link(self, link: str) -> None:
        """Raise `ConfigError` unless there is a link of this name."""
        if link != self.root and link not in self.parents:
            raise ConfigError(f"robot {self.name!r} has no link {link!r}; {suggest(link, [self.root, *self.parents])}")


def load_robot(file: Path, args: Mapping[str, Value] | None = None) -> Robot:
    """The robot described in a URDF file, or in a xacro file with these arguments. Raises `ConfigError`."""
    return parse_robot(read_robot(file, args), str(file))


def parse_robot(data: bytes, file: str = "<urdf>") -> Robot:
    """The robot described by URDF `data` that came from `file`, beside which its meshes are. Raises `ConfigError`."""
    return parse_urdf(data, file, lambda root: _robot(root, Path(file).parent))


def _robot(root: ET.Element, folder: Path) -> Robot:
    joints = tuple(_joint(element) for element in root.findall("joint"))
    _check_mimics(joints)
    elements = [(attribute(element, "name"), element) for element in root.findall("link")]
    root_link = _root_link([name for name, _ in elements], joints)
    boxes = {name: read_boxes(element, folder) for name, element in elements}
    drawn = [name for name, element in elements if element.find("visual") is not None]
    drawn_only = tuple(name for name in drawn if not boxes[name])
    return Robot(root.get("name", ""), root_link, joints, boxes, drawn_only)


def _root_link(links: list[str], joints: tuple[Joint, ...]) -> str:
    """The link that no joint carries; ValueError unless the joints make all links one tree."""
    if len(links) > MOST_LINKS:
        raise ValueError(f"{len(links)} links; at most {MOST_LINKS}")
    for kind, names in (("link", links), ("joint", [joint.name for joint in joints])):
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise ValueError(f"several {kind}s are called {min(twice)!r}")
    carried = {joint.child: joint.parent for joint in joints}
    if unknown := {*carried, *carried.values()} - set(links):
        raise ValueError(f"a joint connects link {min(unknown)!r}, which there is not; {suggest(min(unknown), links)}")
    roots = [link for link in links if link not in carried]
    if len(roots) != 1 or len(carried) != len(joints):
        raise ValueError(f"the links are no tree: {len(roots)} have no parent ({', '.join(roots)}), expected 1")
    if lost := [link for link in links if not _reaches(link, roots[0], carried)]:
        raise ValueError(f"the links are no tree: {lost[0]!r} is in a loop")
    return roots[0]


def _reaches(link: str, root: str, carried: dict[str, str]) -> bool:
    for _ in range(len(carried)):
        link = carried.get(link, root)
    return link == root


def _joint(element: ET.Element) -> Joint:
    name = attribute(element, "name")
    kind = attribute(element, "type")
    if kind not in _KINDS:
        raise ValueError(f"joint {name!r}: type {kind!r} is not supported; {suggest(kind, _KINDS)}")
    limit = element.find("limit")
    lower, upper = _limits(name, kind, limit)
    return Joint(
        name=name,
        kind=cast(JointKind, kind),
        parent=attribute(_child(element, "parent"), "link"),
        child=attribute(_child(element, "child"), "link"),
        origin=origin(element.find("origin")),
        axis=_X_AXIS if kind == "fixed" else _axis(name, element.find("axis")),
        lower=lower,
        upper=upper,
        velocity=_most(name, limit, "velocity"),
        effort=_most(name, limit, "effort"),
        mimic=_mimic(name, element.find("mimic")),
    )


def _most(name: str, limit: ET.Element | None, what: str) -> float:
    """The limit of a joint's velocity or effort; a 0, which would hold the joint still, counts as none."""
    most = math.inf if limit is None else number(limit, what, math.inf)
    if most < 0.0:
        raise ValueError(f"joint {name!r}: {what} {most:g}; expected a positive number")
    return most or math.inf


def _mimic(name: str, element: ET.Element | None) -> Mimic | None:
    if element is None:
        return None
    master = attribute(element, "joint")
    if master == name:
        raise ValueError(f"joint {name!r} mimics itself")
    return Mimic(master, number(element, "multiplier", 1.0), number(element, "offset", 0.0))


def _check_mimics(joints: tuple[Joint, ...]) -> None:
    """Who mimics follows a joint that moves for itself."""
    by_name = {joint.name: joint for joint in joints}
    for joint in joints:
        if joint.mimic is None:
            continue
        master = by_name.get(joint.mimic.joint)
        if master is None or not master.moves or master.mimic is not None:
            raise ValueError(f"joint {joint.name!r} mimics {joint.mimic.joint!r}; expected one that moves by itself")


def _limits(name: str, kind: str, limit: ET.Element | None) -> tuple[float, float]:
    if kind in ("continuous", "fixed"):
        return -math.inf, math.inf
    if limit is None:
        raise ValueError(f"joint {name!r}: a {kind} joint needs a <limit>")
    lower, upper = number(limit, "lower", 0.0), number(limit, "upper", 0.0)
    if lower > upper:
        raise ValueError(f"joint {name!r}: lower limit {lower} is above upper limit {upper}")
    return lower, upper


def _axis(name: str, element: ET.Element | None) -> Vector3:
    x, y, z = _X_AXIS if element is None else vector(element, "xyz", _X_AXIS)
    norm = math.hypot(x, y, z)
    if norm < 1e-9:
        raise ValueError(f"joint {name!r}: its axis has no length")
    return x / norm, y / norm, z / norm


def _child(element: ET.Element, tag: str) -> ET.Element:
    child = element.find(tag)
    if child is None:
        raise ValueError(f"joint {element.get('name')!r} has no <{tag}>")
    return child
