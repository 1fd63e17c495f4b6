"""A world as a scene to simulate: its differences from the belief, and the outcome written into it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from dsr.errors import SchemaError
from dsr.frames.tree import BELIEVED, WORLD
from dsr.graph.elements import Node
from dsr.math3d.shapes import from_numbers
from dsr.math3d.tolerance import PoseTolerance
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.vocabulary.relations import SURFACES, THINGS, is_present
from dsr.vocabulary.what_if import Answer, Supposed

IMAGINED = "imagination"
"""`source` of edges `on` that follow from an imagined scene."""
IMPRECISE = (0.006, 0.004)
"""m, along x and y, by which things are first tried beside the middle: what only balances there falls, as it would."""
NOTHING: Mapping[str, Pose] = MappingProxyType({})
_SAME = PoseTolerance(5e-4, 2e-3)  # m, rad: what differs by less is where it is believed to be
_MASS, _FRICTION = 0.1, 0.5  # kg; of what does not tell


def place_of(memory: Memory, name: str) -> Pose | None:
    """world_from_thing where it is believed to be; None if it is nowhere."""
    node = memory.get_node(name)
    if node is None or not is_present(node):
        return None
    return memory.get_transform(WORLD, name, types=BELIEVED)


def differences(
    base: Memory, world: Memory, *, held: Collection[str] = (), elsewhere: Mapping[str, Pose] = NOTHING
) -> tuple[Supposed, ...]:
    """List the changes that turn the believed scene of the base into the scene of another world.

    What the base does not believe to be anywhere is added, if it tells its `size`.

    Args:
        base: the world whose belief the simulation handler has.
        world: the other one.
        held: names of things that stay where they are, whatever pushes them.
        elsewhere: world_from_thing of things that are not where the other world has them.
    """
    changes = []
    for name in sorted({node.name for memory in (base, world) for node in memory.nodes(THINGS)}):
        node = base.get_node(name)
        before = base.get_pose(WORLD, name, "Virtual_RT") if node is not None and is_present(node) else None
        now = elsewhere.get(name) or place_of(world, name)
        if now is None:
            if before is not None:
                changes.append(Supposed.remove(name))
        elif before is None:
            changes += _added(world.node(name), now)
        elif name in held:
            changes.append(Supposed.hold(name, now))
        elif name in elsewhere or not _SAME.covers(before, now):
            changes.append(Supposed.place(name, now))
    return tuple(changes)


def keep(world: Memory, answer: Answer) -> None:
    """Write the poses (`Virtual_RT`) and supports (`on`) after a simulation into a world."""
    with world.batch():
        for name in sorted(answer.poses):
            if name not in world:
                continue
            pose = answer.pose(name)
            before = world.get_pose(WORLD, name, "Virtual_RT")
            if before is None or not _SAME.covers(before, pose):
                world.add_edge(WORLD, name, "Virtual_RT", pose=pose)
            _rest(world, name, [support for support in answer.rests_on.get(name, ()) if support in world])


def _rest(world: Memory, name: str, supports: Collection[str]) -> None:
    for edge in world.edges("on", src=name):
        if edge.dst not in supports:
            world.remove_edge(*edge.key)
    for support in supports:
        if world.get_edge(name, support, "on") is None:
            world.add_edge(name, support, "on", source=IMAGINED)


def _added(node: Node, pose: Pose) -> list[Supposed]:
    size = node.get("size")
    if not isinstance(size, tuple) or len(size) != 3:
        return []
    try:
        shape = from_numbers(node["shape"]) if "shape" in node else ()
    except SchemaError:
        return []
    mass, friction = node.get("mass", _MASS), node.get("friction", _FRICTION)
    return [Supposed.add(node.name, pose, (size[0], size[1], size[2]), shape, mass, friction)]


def surface_below(world: Memory, x: float, y: float) -> tuple[str, float] | None:
    """The highest table beneath a place, with the height of its top (m); None beside all tables."""
    found: tuple[str, float] | None = None
    for node in world.nodes(SURFACES):
        size, pose = node.get("size"), place_of(world, node.name)
        if pose is None or not isinstance(size, tuple):
            continue
        u, v, _ = pose.inverse().apply((x, y, pose.t[2])).tolist()
        if abs(u) <= size[0] / 2 and abs(v) <= size[1] / 2 and (found is None or pose.t[2] > found[1]):
            found = node.name, pose.t[2]
    return found
