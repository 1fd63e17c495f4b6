"""The scene as boxes, read off a working memory, and the relations that hold in it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from dsr.errors import ConfigError, TransformError, suggest
from dsr.frames.tree import BELIEVED, WORLD
from dsr.geometry import own_bounds
from dsr.graph.elements import Node
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.spatial.boxes import Box
from dsr.spatial.definitions import ALLOCENTRIC, EGOCENTRIC, SPATIAL, View, margin
from dsr.vocabulary.relations import MODELLED, SURFACES, THINGS, is_present

_THINNEST = 1e-4  # m, of what is flat


class Fact(NamedTuple):
    """A relation between two things."""

    relation: str
    """Name of the relation, one of `SPATIAL`."""
    source: str
    """Name of what is above, left, ..."""
    destination: str
    """... of this."""


@dataclass(frozen=True)
class Scene:
    """The believed places of things, as boxes."""

    boxes: Mapping[str, Box] = field(default_factory=dict)
    """Boxes of the things, by name."""

    def margins(
        self,
        relations: str | Iterable[str] | None = None,
        sources: str | Iterable[str] | None = None,
        destinations: str | Iterable[str] | None = None,
        view: View | None = None,
    ) -> dict[Fact, float]:
        """How far (m) each of these relations holds between any two of these things, or of all.

        Args:
            relations: one or some of `SPATIAL`; all if None, but without a `view` none that depends on who looks.
            sources: name(s) of what is above, left, ...; all if None. Names that are not in the scene do not count.
            destinations: likewise, of what that is above, left of, ...
            view: from where `in_front_of`, `behind`, `left_of` and `right_of` are seen.

        Raises:
            ConfigError: for relations that are unknown, or named and in need of a view that is not given.
        """
        if relations is None:
            wanted = SPATIAL if view is not None else tuple(ALLOCENTRIC)
        else:
            wanted = checked_relations(relations)
            if view is None:
                check_no_view(wanted, "give a view")
        ends = self._among(destinations)
        return {
            (fact := Fact(relation, source, destination)): self.margin(fact, view)
            for source in self._among(sources)
            for destination in ends
            if source != destination
            for relation in wanted
        }

    def margin(self, fact: Fact, view: View | None = None) -> float:
        """Measure how far (m) the fact holds; negative if it does not. See `dsr.spatial.margin`."""
        return margin(fact.relation, self.boxes[fact.source], self.boxes[fact.destination], view)

    def _among(self, names: str | Iterable[str] | None) -> list[str]:
        wanted = self.boxes if names is None else {names} if isinstance(names, str) else set(names)
        return [name for name in self.boxes if name in wanted]


def read_scene(memory: Memory) -> Scene:
    """All things, surfaces and objects with meshes whose extent is known and that are believed to be somewhere."""
    boxes = {}
    for kind in (*THINGS, *SURFACES, *MODELLED):
        for node in memory.nodes(kind):
            box = None if not is_present(node) else _box(memory, node)
            if box is not None:
                boxes[node.name] = box
    return Scene(dict(sorted(boxes.items())))


def read_view(memory: Memory, name: str) -> View:
    """The view of a camera (its optical frame) or of any other frame (x forward, y left, z up).

    Raises:
        NodeNotFoundError: for an unknown name.
        ConfigError: if nobody knows where it is.
    """
    optical = memory.node(name).type == "camera"
    try:
        pose = memory.transform(WORLD, name, types=BELIEVED) if name != WORLD else Pose()
    except TransformError as error:
        raise ConfigError(f"viewpoint {name!r}: {error}") from error
    return View.of(pose, optical=optical)


def checked_relations(names: str | Iterable[str], known: Collection[str] = SPATIAL) -> tuple[str, ...]:
    """The name, or names, each once. Raises `ConfigError` for one that is not known."""
    chosen = (names,) if isinstance(names, str) else tuple(dict.fromkeys(names))
    for name in chosen:
        if name not in known:
            raise ConfigError(f"no spatial relation {name!r}; {suggest(name, known)}")
    return chosen


def check_no_view(names: Iterable[str], expected: str) -> None:
    """Raise `ConfigError`, with what is expected, for relations that depend on who looks."""
    if seen := [name for name in names if name in EGOCENTRIC]:
        raise ConfigError(f"{', '.join(seen)} depends on who looks: {expected}")


def box_at(memory: Memory, node: Node, world_from_node: Pose) -> Box | None:
    """The box around a node of a memory that is somewhere in the world; None while nothing tells its extent."""
    size, centre = _extent(memory, node)
    if size is None:
        return None
    return Box(world_from_node if centre is None else world_from_node @ Pose(centre), size)


def _box(memory: Memory, node: Node) -> Box | None:
    pose = memory.get_transform(WORLD, node.name, types=BELIEVED)
    return None if pose is None else box_at(memory, node, pose)


def _extent(memory: Memory, node: Node) -> tuple[Vector3 | None, Vector3 | None]:
    """Edge lengths of the box around a node, None if unknown, and where its centre is in the node's frame."""
    size = node.get("size")
    if node.type not in MODELLED and isinstance(size, tuple) and len(size) == 3 and min(size) > 0.0:
        return (size[0], size[1], size[2]), (0.0, 0.0, -0.5 * size[2]) if node.type in SURFACES else None
    bounds = own_bounds(memory, node) if node.type in MODELLED or "mesh" in node else None
    if bounds is None:
        return None, None
    (x, y, z), (u, v, w) = bounds
    return (
        (max(u - x, _THINNEST), max(v - y, _THINNEST), max(w - z, _THINNEST)),
        (0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w)),
    )
