"""Declares the types that an agent reads and writes, guards its writes, and checks the declarations of a system."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from dsr.errors import AgentError, ConfigError, UndeclaredError, suggest
from dsr.graph.schema import POSE_FIELDS, RECORDS, SCHEMA_RECORD, WORLD_RECORD, Schema
from dsr.network.keys import BASE

EVERYTHING = "*"
"""Name that stands for every name in a declaration."""
Guard = Callable[[str, str, Iterable[str]], None]
"""Called with ("node" or "edge", type, attributes) before each write; raises to refuse it."""
_POSE = frozenset({"pose", *POSE_FIELDS})


@dataclass(frozen=True)
class Access:
    """Types and attributes that an agent reads, or writes.

    Args:
        nodes: node types.
        edges: edge types; the pose of a geometric edge needs no further declaration.
        attributes: attributes of those nodes and edges.
        exclusive: those of the names above that no other agent of the system may write.
        several: whether several agents may declare exactly this, each for nodes of its own, such as those of its arm.
        worlds: the worlds to which this applies, `view_of_*` for all that begin so; all of them if None. The list of
            worlds, nodes of type `world_record`, belongs to none of them.

    Raises:
        AgentError: if `exclusive` holds a name that is not declared, or something is no collection of names.
    """

    nodes: Collection[str] = ()
    edges: Collection[str] = ()
    attributes: Collection[str] = ()
    exclusive: Collection[str] = field(default=(), kw_only=True)
    several: bool = field(default=False, kw_only=True)
    worlds: Collection[str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        for what in ("nodes", "edges", "attributes", "exclusive", "worlds"):
            names = getattr(self, what)
            if what == "worlds" and names is None:
                continue
            if not _are_names(names):
                raise AgentError(f"{what}={names!r:.100}: expected a collection of names, such as ('cube', 'table')")
        undeclared = [name for name in self.exclusive if not self.includes(name)]
        if undeclared:
            raise AgentError(f"exclusive names {undeclared} are not among the nodes, edges and attributes")

    def includes(self, name: str) -> bool:
        """Whether `name` is declared as a node type, an edge type or an attribute."""
        return any(name in names or EVERYTHING in names for names in (self.nodes, self.edges, self.attributes))

    def includes_world(self, name: str) -> bool:
        """Whether this access applies to the world `name`."""
        return self.worlds is None or any(_overlap(name, world) for world in self.worlds)

    def meets(self, other: Access) -> bool:
        """Whether both apply to the same world; who says nothing about worlds is at work in the base."""
        mine, theirs = ((BASE,) if access.worlds is None else access.worlds for access in (self, other))
        return any(_overlap(one, another) for one in mine for another in theirs)

    def check_names(self, schema: Schema) -> None:
        """Raise `ConfigError` for a declared name that `schema` does not know."""
        known = (
            ("node type", self.nodes, schema.node_types),
            ("edge type", self.edges, schema.edge_types),
            ("attribute", self.attributes, schema.attributes),
        )
        for what, declared, valid in known:
            for name in declared:
                if name != EVERYTHING and name not in valid:
                    hint = suggest(name, valid)
                    own = "" if hint.endswith("?") else "; a name of your own is registered in `setup`"
                    raise ConfigError(f"declared {what} {name!r} is not in the schema; {hint}{own}")


def _are_names(given: object) -> bool:
    """Whether it is a collection of texts; a text alone would be one of letters, of which only "*" is a name."""
    if isinstance(given, str):
        return given == EVERYTHING
    return isinstance(given, Collection) and all(isinstance(name, str) for name in given)


def _overlap(one: str, other: str) -> bool:
    """Whether names of worlds, or beginnings of names (`view_of_*`), may mean the same one."""
    stem, other_stem = one.removesuffix(EVERYTHING), other.removesuffix(EVERYTHING)
    if stem != one and other_stem != other:
        return stem.startswith(other_stem) or other_stem.startswith(stem)
    return (
        one == other or (stem != one and other.startswith(stem)) or (other_stem != other and one.startswith(other_stem))
    )


class WriteGuard:
    """Refuses the writes that an agent did not declare; it is called before each write."""

    def __init__(self, agent: str, writes: Access, world: str = BASE) -> None:
        self._agent = agent
        self._writes = writes
        self._world = world
        self._types = {"node": frozenset(writes.nodes), "edge": frozenset(writes.edges)}
        self._attributes = frozenset(writes.attributes)
        self._is_its_own = writes.includes_world(world)
        builtin = Schema()
        self._describes = not (
            self._types["node"] <= builtin.node_types.keys()
            and self._types["edge"] <= builtin.edge_types.keys()
            and self._attributes <= builtin.attributes.keys()
        )
        """Whether it may write names that are not built in, hence describe them."""

    def in_world(self, world: str) -> WriteGuard:
        """The guard of the same agent in another world."""
        return WriteGuard(self._agent, self._writes, world)

    def includes(self, what: str, name: str) -> bool:
        """Whether a type of "node" or "edge", or an "attribute", is declared."""
        names = self._attributes if what == "attribute" else self._types[what]
        return name in names or EVERYTHING in names

    def __call__(self, element: str, kind: str, attributes: Iterable[str]) -> None:
        """Raise `UndeclaredError` unless writing these attributes of a "node" or "edge" of type `kind` is declared."""
        if kind != WORLD_RECORD and not self._is_its_own:
            raise UndeclaredError(
                f"agent {self._agent!r} writes into world {self._world!r}, which it does not declare; "
                f"declared: {', '.join(self._writes.worlds or ()) or 'none'}"
            )
        if kind == SCHEMA_RECORD and self._describes:
            return
        types = self._types[element]
        if kind not in types and EVERYTHING not in types:
            raise UndeclaredError(
                f"agent {self._agent!r} writes {element}s of type {kind!r}, which it does not declare; "
                f"declared: {', '.join(sorted(types)) or 'none'}"
            )
        if EVERYTHING in self._attributes or kind in RECORDS:
            return
        for name in attributes:
            if name not in self._attributes and not (element == "edge" and name in _POSE):
                raise UndeclaredError(
                    f"agent {self._agent!r} writes attribute {name!r} of a {kind}, which it does not declare; "
                    f"declared: {', '.join(sorted(self._attributes)) or 'none'}"
                )


def check_one(guard: Guard, element: str, types: Sequence[str], attributes: Iterable[str]) -> None:
    """Raise `AgentError` unless these attributes may be written to an element of one of these types.

    The error tells about the first of them.
    """
    for type in types[1:]:
        with contextlib.suppress(AgentError):
            return guard(element, type, attributes)
    return guard(element, types[0], attributes)


def guard_in(guard: Guard | None, world: str) -> Guard | None:
    """The guard of writes in a world, given that of the base: one that minds worlds has one for each."""
    in_world: Callable[[str], Guard | None] | None = getattr(guard, "in_world", None)
    return guard if in_world is None else in_world(world)


def part_check(guard: Guard | None) -> Callable[[str], None] | None:
    """What raises `AgentError` for a part of the graph into which nothing may be written; None if all may."""
    check: Callable[[str], None] | None = getattr(guard, "check_part", None)
    return check


def check_writers(writes: Mapping[str, Access]) -> None:
    """Raise `ConfigError` if an agent writes what another one (both by name) claims for itself alone."""
    for owner, access in writes.items():
        for name in access.exclusive:
            for other, theirs in writes.items():
                if access.several and theirs == access:
                    continue
                if other != owner and theirs.includes(name) and access.meets(theirs):
                    raise ConfigError(
                        f"agents {owner!r} and {other!r} cannot run together: {owner!r} must be the only writer "
                        f"of {name!r}, and {other!r} writes it too"
                    )
