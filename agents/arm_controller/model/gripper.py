"""The fingers of a gripper: which joints move them, and where they are at an opening.

Fingers may slide or turn, each by a joint of its own or by joints that mimic others (`<mimic>`), as the bars of a
linkage do. All that are driven move in step from one end of their ranges to the other. The opening at each step is read
off the shapes: the gap between those beside the tool point, along the tool's x axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from agents.arm_controller.model.shapes import LinkBox
from agents.arm_controller.model.urdf import Joint, Robot
from dsr.errors import ConfigError, suggest
from dsr.math3d.boxes import Array
from dsr.math3d.transforms import Pose

_STEPS = 64
"""Steps of a stroke between which the opening is taken as straight: of a linkage of 0.1 m that is off by 0.02 mm."""
_LEAST_STROKE = 0.001
"""m; fingers that open less grip nothing."""
_ASKEW = 0.2
"""Share of a finger's way that may be across the tool's x axis: fingers on circles also move along z."""
_DIGITS = 9  # of lengths in m, beyond which sums are rounded


class GripperModel:
    """The fingers of one gripper; without any, its opening is always 0.

    Args:
        robot: its description.
        palm: link that carries the fingers.
        palm_from_tool: where the tool point is, its x axis from finger to finger.
        joints: names of the joints that are driven; all that move below the palm if empty.

    Raises:
        ConfigError: for joints that there are not, and fingers that do not close along the tool's x axis.
    """

    def __init__(self, robot: Robot, palm: str, palm_from_tool: Pose, joints: Sequence[str] = ()) -> None:
        self._robot = robot
        self._palm = palm
        self._tool_from_palm = palm_from_tool.inverse()
        self._moving = [joint for joint in robot.below(palm) if joint.moves]
        known = [joint.name for joint in self._moving]
        if unknown := [name for name in joints if name not in known]:
            raise ConfigError(f"robot {robot.name!r}: no finger joint {unknown[0]!r}; {suggest(unknown[0], known)}")
        self.driven = tuple(j for j in self._moving if j.mimic is None and (not joints or j.name in joints))
        """Joints that are driven, one for each finger or for all."""
        self.names = tuple(joint.name for joint in self._moving)
        """All joints that move below the palm: those that are driven, those that mimic them, and those that stay."""
        self._check_ranges()
        self._shares = np.linspace(0.0, 1.0, _STEPS + 1)
        self._openings = self._measured()

    @property
    def widest(self) -> float:
        """m, the largest opening; 0 without fingers"""
        return float(self._openings.max())

    @property
    def links(self) -> list[str]:
        """The links that joints below the palm move."""
        return [joint.child for joint in self._moving]

    def positions(self, opening: float) -> dict[str, float]:
        """Position (rad or m) of each joint below the palm where the fingers are `opening` m apart."""
        order = np.argsort(self._openings, kind="stable")
        return self._at(float(np.interp(opening, self._openings[order], self._shares[order])))

    def opening(self, positions: Mapping[str, float]) -> float:
        """Distance (m) between the fingers with the driven joints at `positions` (rad or m); of several the mean."""
        if not self.driven:
            return 0.0
        shares = [(positions[j.name] - j.lower) / (j.upper - j.lower) for j in self.driven]
        return float(np.interp(sum(shares) / len(shares), self._shares, self._openings))

    def boxes(self, opening: float) -> tuple[LinkBox, ...]:
        """Boxes of all that moves below the palm, in its frame, with the fingers `opening` m apart."""
        return self._boxes(self.positions(opening))

    def sides(self) -> tuple[frozenset[str], frozenset[str]]:
        """The links of the fingers on either side of the tool point, with all that is fixed to them."""
        left, right = set[str](), set[str]()
        for joint in self._moving:
            boxes = self._robot.rigid(joint.child)
            pose = self._tool_from_palm @ self._palm_from(joint, self.positions(self.widest))
            side = left if pose.apply(np.mean([box.pose.t for box in boxes] or [(0, 0, 0)], axis=0))[0] < 0 else right
            side |= {link for link, _ in self._robot.fixed_to(joint.child)}
        return frozenset(left), frozenset(right)

    def lever(self, joint: Joint) -> float:
        """Distance (m) of the tool point from the axis of a finger's joint: its torque over the force there."""
        pose = self._palm_from(joint, self.positions(0.0)).inverse() @ self._tool_from_palm.inverse()
        return float(np.linalg.norm(np.cross(pose.t, joint.axis)))

    def _boxes(self, positions: Mapping[str, float]) -> tuple[LinkBox, ...]:
        return tuple(
            self._upright(box.seen_from(pose))
            for joint in self._moving
            for pose in [self._palm_from(joint, positions)]
            for box in self._robot.rigid(joint.child)
        )

    def _upright(self, box: LinkBox) -> LinkBox:
        """The box of a mesh beside the tool point, along the tool's axes; all others as they are. In the palm's frame.

        The smallest box around the tip of a finger may lean, and stand out between the pads.
        """
        if box.filling is None:
            return box
        corners, points = self._tool_from_palm.apply(box.corners), self._tool_from_palm.apply(box.outermost)
        low, high = corners.min(axis=0), corners.max(axis=0)
        if not low[2] <= 0.0 <= high[2]:
            return box
        low[:2], high[:2] = points.min(axis=0)[:2], points.max(axis=0)[:2]
        (x, y, z), (u, v, w) = ((low + high) / 2).tolist(), ((high - low) / 2).tolist()
        return LinkBox(self._tool_from_palm.inverse() @ Pose((x, y, z)), (u, v, w))

    def _palm_from(self, joint: Joint, positions: Mapping[str, float]) -> Pose:
        pose = Pose.identity()
        for above in self._chains[joint.child]:
            pose = pose @ above.pose(positions.get(above.name, 0.0))
        return pose

    @cached_property
    def _chains(self) -> dict[str, tuple[Joint, ...]]:
        return {joint.child: self._robot.between(self._palm, joint.child) for joint in self._moving}

    def _at(self, share: float) -> dict[str, float]:
        """All positions with the driven joints at that share of their ranges; what is not driven stays nearest to 0."""
        found = {j.name: min(max(0.0, j.lower), j.upper) for j in self._moving if j.mimic is None}
        found.update({j.name: j.lower + share * (j.upper - j.lower) for j in self.driven})
        for joint in self._moving:
            if joint.mimic is not None:
                found[joint.name] = joint.mimic.position(found)
        return found

    def _check_ranges(self) -> None:
        for joint in self.driven:
            if not np.isfinite((joint.lower, joint.upper)).all() or joint.lower == joint.upper:
                raise ConfigError(f"robot {self._robot.name!r}: finger joint {joint.name!r} needs a range to move in")
        for joint in self._moving:
            if joint.mimic is not None and joint.mimic.joint not in self.names:
                who = f"robot {self._robot.name!r}: finger joint {joint.name!r}"
                raise ConfigError(f"{who} mimics {joint.mimic.joint!r}, which is none below {self._palm!r}")

    def _measured(self) -> Array:
        """(n,) m, the opening at each share of the stroke.

        Fingers on circles also move along the tool's z axis: other shapes may be beside the tool point at each share.
        """
        if not self.driven:
            return np.zeros(len(self._shares))
        centers, halves = (np.array(part) for part in zip(*map(self._extents, self._shares.tolist()), strict=True))
        beside = np.abs(centers[..., 2]) <= halves[..., 2]
        if not beside.any(axis=1).all():
            raise ConfigError(f"{self._who()}: no finger has a collision shape beside the tool point at all openings")
        nearest = np.where(beside, np.abs(centers[..., 0]), np.inf).min(axis=1)
        wider = int(nearest.argmax())
        left, right = beside & (centers[wider, :, 0] < 0), beside & (centers[wider, :, 0] > 0)
        if not (left.any(axis=1) & right.any(axis=1)).all():
            raise ConfigError(f"{self._who()}: the tool point is not between the fingers, as seen along its x axis")
        self._check_way((centers[-1] - centers[0])[beside[wider]])
        edge = np.where(right, centers[..., 0] - halves[..., 0], np.inf).min(axis=1)
        other = np.where(left, centers[..., 0] + halves[..., 0], -np.inf).max(axis=1)
        gaps = np.round(np.maximum(edge - other, 0.0), _DIGITS)
        steps = np.diff(gaps)
        if gaps.max() < _LEAST_STROKE or not ((steps >= -1e-6).all() or (steps <= 1e-6).all()):
            raise ConfigError(f"{self._who()}: its fingers do not open from one end of their ranges to the other")
        return np.asarray(gaps)

    def _extents(self, share: float) -> tuple[Array, Array]:
        """Centres and half extents (k, 3), along the tool's axes, of all boxes below the palm."""
        corners = np.array([self._tool_from_palm.apply(box.corners) for box in self._boxes(self._at(share))])
        if not len(corners):
            return np.zeros((0, 3)), np.zeros((0, 3))
        low, high = corners.min(axis=1), corners.max(axis=1)
        return (low + high) / 2, (high - low) / 2

    def _check_way(self, ways: Array) -> None:
        """The fingers move by `ways` (k, 3), along x and not along y."""
        way = np.abs(ways).sum(axis=0)
        if way[1] > _ASKEW * way[0]:
            x_not_y = "its x axis must point from finger to finger; turn it with `tool_mount`"
            raise ConfigError(f"{self._who()}: the fingers close along the y axis of the tool; {x_not_y}")

    def _who(self) -> str:
        return f"robot {self._robot.name!r}, gripper at {self._palm!r}"
