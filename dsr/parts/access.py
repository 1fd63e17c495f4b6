"""The part of a `Memory` that lists, makes, holds and leaves parts of the graph."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dsr.clock import Clock
from dsr.errors import PartError
from dsr.graph.elements import Edge, Node
from dsr.graph.schema import PART_RECORD, Schema, checked_names
from dsr.network.keys import check_part, part_of
from dsr.parts.held import HeldParts, not_parted
from dsr.parts.registry import PartInfo, node_name, to_attribute
from dsr.replication.replica import Replica

TIMEOUT = 5.0
"""s within which others must hand on a part that is held."""


class PartAccess:
    """Base of `Memory`: what is in no part is held by everybody, a part only by who asks for it."""

    agent: str
    clock: Clock
    schema: Schema
    _held: HeldParts | None

    def write_record(self, name: str, type: str, record: str) -> None:
        """See `Memory.write_record`."""
        raise NotImplementedError

    def parts(self) -> list[PartInfo]:
        """All parts that the graph lists, by name, held here or not."""
        return list(self._parts("parts").listed.parts.values())

    @property
    def interest(self) -> tuple[str, ...]:
        """Names of the parts that are held here, beside what is in no part."""
        return () if self._held is None else tuple(self._held.replicas)

    def create_part(self, name: str, *, types: Iterable[str] = (), exist_ok: bool = False) -> None:
        """List a new part, and hold it.

        The right to list parts is the right to write nodes of type `part_record`. A part is never taken off the list.

        Args:
            name: letters, digits and `_`.
            types: node types of which those who hold the part make new nodes in it, unless they name another one.
            exist_ok: hold the part if it is listed, with the types that it has.

        Raises:
            PartError: if it is listed already.
            SchemaError: for an unknown type.
            ConfigError: for a name that cannot be used.
            AgentError: if this agent may not list parts.
        """
        held = self._parts("create_part")
        check_part(name)
        types = checked_names(types, self.schema.node_types, "node type") or ()
        if name in held.listed.parts:
            if not exist_ok:
                raise PartError(f"part {name!r} exists already; hold it with hold_part({name!r})")
            held.hold((name,), TIMEOUT)
            return
        info = PartInfo(name, tuple(sorted(types)), self.agent, self.clock.now())
        self.write_record(node_name(name), PART_RECORD, to_attribute(info))
        held.begin(name)

    def hold_part(self, *names: str, timeout: float = TIMEOUT, unlisted: bool = False) -> None:
        """Ask for parts, and wait until they are complete; of parts that nobody holds, what begins here.

        "*" asks for all parts that are listed, and for those that will be, until one is left.
        With `unlisted`, parts are held that nobody has listed yet.
        Without threads and with slow messages they may be complete only after further polls: see `joined`.

        Raises:
            PartNotFoundError: for a part that is not listed.
            TransportError: if those who hold one do not answer within `timeout` s.
        """
        self._parts("hold_part").hold(names, timeout, unlisted=unlisted)

    def leave_part(self, *names: str) -> None:
        """Hold parts no more: what is in them goes out of sight here, and nowhere else.

        What nobody else holds is lost. Who held all parts holds none any more that others list later. Raises
        `PartError` for a part that is not held.
        """
        held = self._parts("leave_part")
        for name in names:
            self.part_replica(name)
        for name in names:
            held.leave(name)

    def part_replica(self, name: str) -> Replica:
        """The replica of a part that is held here. Raises `PartError`."""
        replica = self._parts("part_replica").replicas.get(name)
        if replica is None:
            raise PartError(f"part {name!r} is not held here; held: {', '.join(self.interest) or 'none'}")
        return replica

    def hold_kept_parts(self, names: Iterable[str], restore: Callable[[str], object]) -> None:
        """Hold parts, of which `restore` puts in what was kept; for who keeps the graph. Raises `TransportError`."""
        self._parts("hold_kept_parts").hold_kept(names, restore, TIMEOUT)

    def part(self, element: Node | Edge) -> str:
        """Name of the part that an element is in, that of its creation; empty if it is in none.

        An edge is in the part of its source.
        """
        if self._held is not None:
            return self._held.graph.part(element.key)
        return part_of(max(element.created)[0])

    def _parts(self, what: str) -> HeldParts:
        if self._held is None:
            raise not_parted(what)
        return self._held

    def poll(self) -> None:
        """See `WorldAccess.poll`."""
        super().poll()  # type: ignore[misc]
        if self._held is not None:
            for replica in self._held.replicas.values():
                replica.poll()

    def flush(self) -> None:
        """See `WorldAccess.flush`."""
        super().flush()  # type: ignore[misc]
        if self._held is not None:
            for replica in self._held.replicas.values():
                replica.flush()
