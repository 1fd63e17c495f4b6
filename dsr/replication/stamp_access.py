"""The part of a `Memory` that deals with stamps that leave no room above, or that no honest clock can have made."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from typing import NamedTuple

from dsr.clock import Clock
from dsr.crdt.delta import Delta, Key
from dsr.errors import AgentError, ClockDriftError, NoRoomError
from dsr.graph.elements import Edge, Node
from dsr.graph.far_stamps import FarStamp, far_stamps
from dsr.graph.graph import Graph
from dsr.replication.clock_votes import ClockVerdict
from dsr.replication.replica import Replica


class Cleaned(NamedTuple):
    """The outcome of `clean_stamps`."""

    renewed: list[FarStamp]
    """Attributes that have a stamp of now."""
    refused: dict[Key, str]
    """Elements that this agent may not make anew, with the reason."""


class StampAccess:
    """Base of `Memory`."""

    _replica: Replica
    _graph: Graph
    clock: Clock

    def nodes(self) -> list[Node]:
        """See `Memory.nodes`."""
        raise NotImplementedError

    def edges(self) -> list[Edge]:
        """See `Memory.edges`."""
        raise NotImplementedError

    def batch(self) -> AbstractContextManager[None]:
        """See `Memory.batch`."""
        raise NotImplementedError

    def _check_write(
        self, element: str, types: Sequence[str], attributes: Iterable[str], *, own: bool = False
    ) -> None:
        raise NotImplementedError

    @property
    def clocks(self) -> ClockVerdict:
        """Describe in words how this process's clock agrees with those of the other agents."""
        return self._replica.synchroniser.clocks

    @property
    def far_stamped(self) -> dict[str, int]:
        """How often each agent stamped a value days ahead of this clock; to overwrite such values does not count."""
        return dict(self._graph.far.agents)

    def far_stamps(self) -> list[FarStamp]:
        """Attributes whose present value is stamped days ahead of this clock.

        To overwrite them works as ever. Until then, or until `clean_stamps`, a write that has not seen the value loses.
        """
        return list(far_stamps(self._elements(), self.clock.now()))

    def clean_stamps(self) -> Cleaned:
        """Make elements with such attributes anew, with the same values and stamps of now, and the edges at nodes.

        Others see them go and come. A write at the same moment by who has not seen that is lost, as by any removal.
        The agent counts as who created them. Raises `ClockDriftError` if it is this clock that is wrong.
        """
        if self.clocks.is_behind:
            raise ClockDriftError(f"{self.clocks}; set it right: it cannot judge stamps")
        refused: dict[Key, str] = {}
        with self.batch(), self._replica.lock:
            found = self.far_stamps()
            for key in dict.fromkeys(stamp.element for stamp in found):
                if next(far_stamps(self._elements((key,)), self.clock.now()), None):  # not made anew with its node
                    try:
                        self._renew(key)
                        if next(far_stamps(self._elements((key,)), self.clock.now()), None):
                            raise AgentError(f"others have made {key}, too, with such stamps")
                    except AgentError as error:
                        refused[key] = str(error)
        left = {(stamp.element, stamp.attribute) for stamp in self.far_stamps()}
        return Cleaned([stamp for stamp in found if (stamp.element, stamp.attribute) not in left], refused)

    def _elements(self, keys: Iterable[Key] | None = None) -> Iterator[Node | Edge]:
        if keys is None:
            yield from self.nodes()
            yield from self.edges()
            return
        for key in keys:
            element = self._graph.nodes.get(key) if isinstance(key, str) else self._graph.edges.get(key)
            if element is not None:
                yield element

    def _put(self, write: Callable[[], Delta]) -> Delta:
        """Write, with the lock held, and queue what is to be sent.

        An element of which an attribute cannot be overwritten is made anew first. Raises `AgentError` if this agent may
        not do that.
        """
        try:
            delta = write()
        except NoRoomError as full:
            delta = self._put_anew(full, write)
        if delta.context or delta:
            self._replica.commit(delta)
        return delta

    def _put_anew(self, full: NoRoomError, write: Callable[[], Delta]) -> Delta:
        """Make elements anew until the write has room in all of them."""
        renewed: set[Key] = set()
        while full.key not in renewed:
            renewed.add(full.key)
            try:
                self._renew(full.key)
            except AgentError as error:
                raise AgentError(f"{full}, unless it is made anew, and {error}") from None
            try:
                return write()
            except NoRoomError as another:
                full = another
        raise full

    def _seen(self, element: Node | Edge) -> Node | Edge:
        """The element of its key as it is now: it may have been made anew."""
        return next(self._elements((element.key,)), element)

    def _renew(self, key: Key) -> None:
        renewals = self._graph.renewals(key)
        if not renewals or renewals[0].element.key != key:
            raise AgentError(f"{key} is others': nothing of it is for this agent to make anew")
        for element, type, writes in renewals:
            kind = "node" if isinstance(element, Node) else "edge"
            self._check_write(kind, (type,), [write.attribute for write in writes], own=True)
        self._replica.commit(self._graph.renew(key, self.clock.now()))
