"""The state that a plan starts from: the believed relations, and the geometry that tells where things can go."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dsr.believing.distribution import ATTRIBUTE
from dsr.frames.tree import BELIEVED, WORLD
from dsr.math3d.transforms import Array, Pose
from dsr.memory import Memory
from dsr.vocabulary.arms import ARM, CONTROLLER, gripper_of
from dsr.vocabulary.intrinsics import Intrinsics, read_intrinsics
from dsr.vocabulary.perceived import camera_nodes
from dsr.vocabulary.relations import Relations
from planner.arms import Arms, Place, PlannedArm
from planner.config import PlannerConfig
from planner.likely_places import likely_places

_SQUARE = np.array([(x, y, 0.0) for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
FLAT = ("cube", "box")
"""Node types on which something can be put."""


@dataclass(frozen=True)
class KnownSolid:
    """A thing or a table: how large, and where."""

    size: tuple[float, float, float]
    """Edge lengths of the bounding box, m."""
    pose: Pose
    """world_from_thing as believed; a table's frame is at the centre of its top."""

    @property
    def radius(self) -> float:
        """m, of the circle about its footprint, however it is turned about the vertical."""
        return 0.5 * math.hypot(self.size[0], self.size[1])


class PossiblePlace(NamedTuple):
    """A place where a thing may be."""

    probability: float
    place: Place
    """x, y in the world, m"""


@dataclass(frozen=True)
class TableCamera:
    """A camera that looks at the table."""

    name: str
    """Name of the camera's node."""
    camera_from_world: Pose
    intrinsics: Intrinsics

    def sees(self, points: Array, radius: float) -> NDArray[np.bool_]:
        """(n,) around which of the points (n, 3) (m, world) a level square is in the image, `radius` m to each side."""
        corners = (points[:, None] + radius * _SQUARE).reshape(-1, 3)
        local, intrinsics = self.camera_from_world.apply(corners), self.intrinsics
        ahead = local[:, 2] > 0.0
        u, v = intrinsics.project(np.where(ahead[:, None], local, 1.0)).T
        inside = ahead & (u >= 0.0) & (u <= intrinsics.width) & (v >= 0.0) & (v <= intrinsics.height)
        whole: NDArray[np.bool_] = inside.reshape(-1, len(_SQUARE)).all(axis=1)
        return whole


@dataclass(frozen=True)
class WorldState:
    """The believed state of the world at one moment."""

    relations: Relations
    solids: Mapping[str, KnownSolid] = field(default_factory=dict)
    """The things and the table, by name; without those whose size or pose is not known."""
    table: str | None = None
    """The table on which things are put down."""
    graspable: frozenset[str] = frozenset()
    """Things that fit between the fingers and that nobody else holds."""
    flat: frozenset[str] = frozenset()
    """Things on which something can be put."""
    doubts: Mapping[str, tuple[PossiblePlace, ...]] = field(default_factory=dict)
    """Where things may be, by name, of those that are not surely where they are believed to be."""
    arms: Mapping[str, PlannedArm] = field(default_factory=lambda: {ARM: PlannedArm(ARM, CONTROLLER, gripper_of(ARM))})
    """Those that can be used, by name; of several."""
    trouble: tuple[str, ...] = ()
    """Why others cannot be used, with their names."""
    views: tuple[TableCamera, ...] = ()
    """Cameras that do not move with the arm."""

    @property
    def is_shared(self) -> bool:
        """Whether the graph has several arms, of which perhaps only one can be used."""
        return len(self.arms) > 1 or bool(self.trouble)


def read_state(memory: Memory, config: PlannerConfig) -> WorldState:
    """Read the present state of `memory`."""
    arms = Arms(memory, config)
    relations = arms.relations()
    solids: dict[str, KnownSolid] = {}
    for name in sorted(relations.things | relations.tables):
        node, pose = memory.get_node(name), memory.get_transform(WORLD, name, types=BELIEVED)
        size = None if node is None else node.get("size")
        if pose is not None and size is not None:
            solids[name] = KnownSolid(size, pose)
    return WorldState(
        relations=relations,
        solids=solids,
        table=_choose_table(relations, solids),
        graspable=frozenset(
            name for name in relations.things - relations.taken if name in solids and _fits(solids[name], config)
        ),
        doubts={name: doubts for name in solids if (doubts := _doubts(memory, name))},
        flat=frozenset(node.name for node in memory.nodes(FLAT) if node.name in relations.things),
        arms={arm.name: arm for arm in arms.usable()},
        trouble=tuple(f"{arm.name}: {arm.trouble}" for arm in arms.all() if arm.trouble),
        views=_views(memory),
    )


def _doubts(memory: Memory, name: str) -> tuple[PossiblePlace, ...]:
    """Where a thing may be that lies somewhere; none if only one place is thought of."""
    node = memory.get_node(name)  # it may just have been removed
    where = memory.belief(name) if node is not None and node.get(ATTRIBUTE) else None
    if where is None:
        return ()
    return tuple(
        PossiblePlace(weight, pose.t[:2])
        for weight, pose, one in likely_places(where)
        if pose is not None and not one.hand
    )


def _choose_table(relations: Relations, solids: Mapping[str, KnownSolid]) -> str | None:
    """The one that carries most things; among equals, the first by name."""
    loads = Counter(support for _, support in relations.on)
    tables = sorted(name for name in relations.tables if name in solids)
    return max(tables, key=lambda name: loads[name], default=None)


def _fits(solid: KnownSolid, config: PlannerConfig) -> bool:
    return min(solid.size[:2]) <= config.widest_grip


def _views(memory: Memory) -> tuple[TableCamera, ...]:
    """The cameras that hang from the world by one edge."""
    views = []
    for camera in camera_nodes(memory):
        pose, intrinsics = memory.get_pose(WORLD, camera.name, "RT"), read_intrinsics(camera)
        if pose is not None and intrinsics is not None:
            views.append(TableCamera(camera.name, pose.inverse(), intrinsics))
    return tuple(views)
