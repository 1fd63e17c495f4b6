"""The parts that a memory holds: asked for, waited for, and given back."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable

from dsr.clock import Clock
from dsr.crdt.store import Incarnation
from dsr.errors import AgentError, PartError, TransportError
from dsr.graph.access import Guard, part_check
from dsr.network.keys import Keys, check_part, part_of, part_rid
from dsr.network.transport import Transport
from dsr.parts.graph import PartedGraph
from dsr.parts.registry import PartList
from dsr.parts.replica import PartedReplica
from dsr.replication.holders import gathered
from dsr.replication.polling import Poller
from dsr.replication.replica import Replica

_log = logging.getLogger("dsr.parts")


class HeldParts:
    """The parts that one process holds.

    Args:
        replica: that of the base, whose graph has parts.
        parts: the list.
        transport: the network.
        clock: for waiting.
        graph: name of the graph.
        agent: what this process is called.
        rid: the replica id with which the process began.
        poller: does what is due, if threads are run.
    """

    def __init__(
        self, replica: PartedReplica, parts: PartList, transport: Transport, clock: Clock, graph: str, agent: str,
        rid: str, poller: Poller | None,
    ) -> None:
        self.listed = parts
        self._replica = replica
        self._transport = transport
        self._clock = clock
        self._graph_name = graph
        self._agent = agent
        self._rid = rid
        self._poller = poller
        self._changing = threading.RLock()
        self._times = 0
        self._ended = False

    @property
    def graph(self) -> PartedGraph:
        """What is visible of all parts together."""
        graph = self._replica.graph
        assert isinstance(graph, PartedGraph)
        return graph

    @property
    def replicas(self) -> dict[str, Replica]:
        """Those of the parts that are held, by name."""
        return dict(self._replica.parts)

    @property
    def joined(self) -> bool:
        """Whether all that they held before us is here."""
        return all(replica.synchroniser.joined for replica in self._replica.parts.values())

    def take(self, part: str) -> Replica:
        """Begin to hold a part, or go on; nobody is waited for.

        Raises `TransportError` once the memory is closed, for nobody would close the part.
        """
        check_part(part)
        with self._changing:
            if self._holds(part):
                return self._replica.parts[part]
            self.leave(part)  # if leaving was broken off
            self._times += 1
            lock, gate = self._replica.lock, self._replica.synchroniser.gate
            with lock:
                if self._ended:
                    raise TransportError(f"the memory of graph {self._graph_name!r} is closed")
                member = self.graph.hold(part, part_rid(self._rid, part, self._times))
                keys = Keys(self._graph_name, part=part)
                try:
                    replica = Replica(member, self._transport, self._clock, keys, self._agent, gate, lock)
                    self._replica.parts = {**self._replica.parts, part: replica}
                except BaseException:  # else what is written into the part would be sent by nobody
                    self.graph.leave(part)
                    raise
            if self._poller is not None:
                replica.start(self._poller)
            return replica

    def _holds(self, part: str) -> bool:
        return part in self._replica.parts and part in self.graph.parts and part not in self.graph.leaving

    def hold(self, parts: Iterable[str], timeout: float) -> None:
        """Hold listed parts, complete. Raises `PartNotFoundError`, `TransportError`."""
        names = list(dict.fromkeys(parts))
        for name in names:
            self.listed.info(name)
        begun = [name for name in names if not self._holds(name)]
        try:
            for name, replica in [(name, self.take(name)) for name in begun]:
                self._wait(name, replica, timeout)
        except BaseException:
            for name in begun:
                self.leave(name)
            raise

    def _wait(self, part: str, replica: Replica, timeout: float) -> None:
        def move() -> None:
            self._transport.pump()
            replica.poll()

        if gathered(replica, None if self._poller is not None else move, timeout):
            return
        joining = replica.synchroniser.joining
        if not joining.insists:
            why = joining.why(self._clock.monotonic())
            raise TransportError(f"part {part!r}: not complete after {timeout:.1f} s, {why}")
        if self._poller is not None:
            _log.info("nobody else holds part %r: it begins here, empty", part)
            replica.synchroniser.nobody_there()

    def begin(self, part: str) -> None:
        """Hold a part that nobody can hold yet."""
        self.take(part).synchroniser.nobody_there()

    def leave(self, part: str) -> None:
        """Send what was written into a part, and hold it no more; harmless if it is not held."""
        with self._changing:
            replica = self._replica.parts.get(part)
            if replica is None:
                return
            with self._replica.lock:
                self.graph.leaving.add(part)  # what is written from now on would not be sent
            replica.close()
            with self._replica.lock:
                self.graph.leave(part)
                self._replica.parts = {name: each for name, each in self._replica.parts.items() if name != part}

    def close(self) -> None:
        """Send what was written; nothing changes in the parts any more."""
        with self._replica.lock:
            self._ended = True
        for replica in self.replicas.values():
            replica.close()


def burial_allowed(guard: Guard) -> Callable[[Incarnation], bool]:
    """Tell by the guard of a secured graph whether others accept it if this process removes an edge."""
    check = part_check(guard)

    def allowed(entry: Incarnation) -> bool:
        try:
            guard("edge", entry.type, ())
            if check is not None:
                check(part_of(entry.dot[0]))
        except AgentError:
            return False
        return True

    return allowed


def not_parted(what: str) -> PartError:
    """The error for a memory that was not told to hold parts."""
    return PartError(f"{what}: this memory holds no parts; give it interest=(...), if only an empty one")
