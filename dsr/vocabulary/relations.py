"""The relations between things in a working memory: edges `on` and `grasping`, and their consequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from dsr.graph.elements import Node
from dsr.memory import Memory

THINGS = ("cube", "box", "container", "cup", "ball")
"""Node types of things that can be perceived and moved; all else is structure, a hand, or stands still."""
SURFACES = ("table",)
"""Node types of static bodies on which things are put."""
MODELLED = ("object",)
"""Node types of static bodies in the form of their mesh, as loaded from a file."""
ARITY = {"on": 2, "ontable": 1, "clear": 1, "holding": 1, "handempty": 0}
"""The relations by name, with how many things each relates."""
Pair = tuple[str, str]


class Relation(NamedTuple):
    """A relation between things, true or not: `on(cube_3, cube_4)`."""

    name: str
    """Name of the relation, one of `ARITY`."""
    arguments: tuple[str, ...]
    """Names of nodes."""

    def __str__(self) -> str:
        return f"{self.name}({','.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True)
class Relations:
    """The relations that hold at one moment. Two are equal if the same things are in the same relations."""

    things: frozenset[str] = frozenset()
    """Names of the things that are believed to be somewhere."""
    tables: frozenset[str] = frozenset()
    on: frozenset[Pair] = frozenset()
    """(thing, what it rests on)"""
    grasping: frozenset[Pair] = frozenset()
    """(gripper of a robot, thing)"""
    taken: frozenset[str] = frozenset()
    """Things that somebody else holds: a human hand."""

    @property
    def held(self) -> frozenset[str]:
        """The things in grippers."""
        return frozenset(thing for _, thing in self.grasping)

    @property
    def facts(self) -> frozenset[Relation]:
        """The relations that are not derived: `on` and `holding`."""
        resting = (Relation("on", pair) for pair in self.on)
        return frozenset((*resting, *(Relation("holding", (thing,)) for thing in self.held)))

    def supports(self, thing: str) -> frozenset[str]:
        """Names of the things that `thing` rests on."""
        return frozenset(support for above, support in self.on if above == thing)

    def holds(self, relation: Relation) -> bool:
        """Whether a relation holds. Of a thing that is not believed to be anywhere, none does."""
        name, arguments = relation
        if name == "handempty":
            return not self.grasping
        thing = arguments[0]
        if thing not in self.things:
            return False
        if name == "on":
            return (thing, arguments[1]) in self.on
        if name == "ontable":
            return not self.tables.isdisjoint(self.supports(thing))
        if name == "holding":
            return thing in self.held
        return self._is_clear(thing)

    def _is_clear(self, thing: str) -> bool:
        free = thing not in self.held and thing not in self.taken
        return free and all(support != thing for _, support in self.on)


def nodes_by_name(memory: Memory, types: str | Iterable[str]) -> list[Node]:
    """The nodes of one type or several, in the order of their names. Raises `SchemaError` for an unknown type."""
    return sorted(memory.nodes(types), key=lambda node: node.name)


def is_present(node: Node) -> bool:
    """Whether a thing is believed to be in the scene."""
    return node.get("present", True) is not False


def present_things(memory: Memory) -> list[Node]:
    """The things that are believed to be in the scene."""
    return [node for node in memory.nodes(THINGS) if is_present(node)]


def grasped_things(memory: Memory) -> set[str]:
    """Names of what is held or touched, by whatever hand or gripper."""
    return {edge.dst for edge in memory.edges("grasping")}


def read_relations(memory: Memory) -> Relations:
    """Read the present relations of `memory`.

    Edges at things that are nowhere (`present` is false, no believed pose) do not count.
    """
    grasps = [(edge.src, edge.dst) for edge in memory.edges("grasping")]
    grasped = {thing for _, thing in grasps}
    names = (node.name for node in present_things(memory))
    things = frozenset(name for name in names if name in grasped or memory.edges("Virtual_RT", dst=name))
    tables = frozenset(node.name for node in memory.nodes(SURFACES))
    grippers = {node.name for node in memory.nodes("gripper")}
    return Relations(
        things=things,
        tables=tables,
        on=frozenset(
            (edge.src, edge.dst)
            for edge in memory.edges("on")
            if edge.src in things and (edge.dst in things or edge.dst in tables)
        ),
        grasping=frozenset((holder, thing) for holder, thing in grasps if holder in grippers and thing in things),
        taken=frozenset(thing for holder, thing in grasps if holder not in grippers and thing in things),
    )
