"""The parts that a memory holds: asked for, waited for, and given back."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Callable, Iterable, Mapping

from dsr.clock import Clock
from dsr.crdt.store import Incarnation
from dsr.errors import AgentError, ConfigError, PartError, TransportError
from dsr.graph.access import Guard, part_check
from dsr.network.keys import ALL, Keys, check_interest, check_part, part_of, part_rid
from dsr.network.transport import Transport
from dsr.parts.graph import PartedGraph
from dsr.parts.registry import PartInfo, PartList
from dsr.parts.replica import PartedReplica
from dsr.replication.holders import Holders
from dsr.replication.polling import Poller
from dsr.replication.replica import Replica

MOST_PARTS = 1000
"""Parts that who asks for all holds at once: each takes a thread, and who may list parts may list any number."""

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
        holders: asks the other processes who holds what.
    """

    def __init__(
        self, replica: PartedReplica, parts: PartList, transport: Transport, clock: Clock, graph: str, agent: str,
        rid: str, poller: Poller | None, holders: Holders,
    ) -> None:
        self.listed = parts
        self._replica = replica
        self._transport = transport
        self._clock = clock
        self._graph_name = graph
        self._agent = agent
        self._rid = rid
        self._poller = poller
        self._holders = holders
        self._asking: dict[str, Replica] = {}
        """Parts of which others are asked, still, whether they hold them."""
        self._changing = threading.RLock()
        self._times = 0
        self._ended = False
        self.holds_all = False
        """Whether parts that others list are held here, too."""
        self._swept: Mapping[str, PartInfo] | None = None
        self._refused: set[str] = set()
        self._is_full = False

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
        with self._changing:
            replica = self._begun(part)
            if not replica.synchroniser.joined:
                self._ask(part, replica)
            return replica

    def _ask(self, part: str, replica: Replica) -> None:
        """Ask all others whether they hold a part that is held here; see `sweep`."""
        if part not in self._asking:
            self._asking[part] = replica
            self._holders.ask(self._place(part))

    def _place(self, part: str) -> str:
        return Keys(self._graph_name, part=part).place

    def _begun(self, part: str) -> Replica:
        """The replica of a part that is held from now on."""
        check_part(part)
        with self._changing:
            if self._holds(part):
                return self._replica.parts[part]
            self._give_back(part)  # if leaving was broken off
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
                try:
                    replica.start(self._poller)
                except RuntimeError as error:
                    self._give_back(part)
                    raise TransportError(f"part {part!r}: {error}") from error
            return replica

    def sweep(self) -> None:
        """Begin parts that nobody else holds, and if all is held here, what others listed; nobody is waited for."""
        for part, replica in list(self._asking.items()):
            if self._holders.note(replica, self._place(part)):
                self._begin_here(part, replica)
        self._holders.look()
        listed = self.listed.parts
        if self._ended or not self.holds_all or listed is self._swept:
            return
        missing = self._room_for([name for name in listed if not self._holds(name)])
        refused = [name for name in missing if not self._is_taken(name)]
        if not refused:
            self._swept = listed

    def _begin_here(self, part: str, replica: Replica) -> None:
        """Nothing of a part is waited for any more."""
        with self._changing:
            if self._asking.get(part) is not replica:
                return
            self._settle(part, answered=True)
            if not replica.synchroniser.joined:
                _log.info("nobody else holds part %r: it begins here", part)
                replica.synchroniser.nobody_there()

    def _settle(self, part: str, *, answered: bool) -> None:
        if self._asking.pop(part, None) is not None:
            self._holders.settle(self._place(part), answered=answered)

    def _room_for(self, parts: list[str]) -> list[str]:
        """Those of `parts` that are held if all are asked for; the others are told once."""
        room = max(0, MOST_PARTS - len(self._replica.parts))
        if (over := len(parts) - room) > 0 and not self._is_full:
            self._is_full = True
            _log.warning("%d parts that are listed are not held: at most %d are; name those that you want", over,
                         MOST_PARTS)  # fmt: skip
        return parts[:room]

    def _is_taken(self, part: str) -> bool:
        try:
            self.take(part)
        except TransportError as error:
            if part not in self._refused:
                _log.warning("part %r is not held: %s (tried again)", part, error)
            self._refused.add(part)
            return False
        return True

    def take_named(self, parts: Iterable[str]) -> None:
        """Hold parts of which some content is given, if all is held here; what no part can be called is passed over."""
        for part in parts if self.holds_all else ():
            with contextlib.suppress(ConfigError):
                self.take(part)

    def _holds(self, part: str) -> bool:
        return part in self._replica.parts and part in self.graph.parts and part not in self.graph.leaving

    def hold(self, parts: Iterable[str], timeout: float, *, unlisted: bool = False) -> None:
        """Hold parts, complete. Raises `PartNotFoundError` for one not listed unless `unlisted`, `TransportError`."""
        names = dict.fromkeys(check_interest(parts))
        if ALL in names:
            self.holds_all = True
            del names[ALL]
            listed = [name for name in self.listed.parts if name not in names and not self._holds(name)]
            names = dict.fromkeys([*names, *self._room_for(listed)])
        for name in () if unlisted else names:
            self.listed.info(name)
        begun = [name for name in names if not self._holds(name)]
        try:
            for name, replica in [(name, self.take(name)) for name in begun]:
                self._wait(name, replica, timeout)
        except BaseException:
            for name in begun:
                self.leave(name)
            raise

    def hold_kept(self, parts: Iterable[str], restore: Callable[[str], object], timeout: float) -> None:
        """Hold parts, of which `restore` puts in what was kept before others are waited for.

        Raises `TransportError` if those who hold one do not answer.
        """
        names = list(parts)
        for part in names:
            self._begun(part)
        for part in names:
            restore(part)
        for part, replica in [(part, self.take(part)) for part in names]:
            self._wait(part, replica, timeout)

    def _wait(self, part: str, replica: Replica, timeout: float) -> None:
        def move() -> None:
            self._transport.pump()
            replica.poll()

        place = self._place(part)
        if self._holders.gathered(replica, place, None if self._poller is not None else move, timeout):
            return
        if self._holders.nobody_holds(replica, place):
            self._begin_here(part, replica)
        elif self._poller is not None and (why := self._holders.trouble(replica, place)):
            raise TransportError(f"part {part!r}: not complete after {timeout:.1f} s, {why}")
        elif self._poller is not None:
            self._begin_here(part, replica)

    def begin(self, part: str) -> None:
        """Hold a part that nobody can hold yet."""
        self.take(part).synchroniser.nobody_there()

    def leave(self, part: str) -> None:
        """Send what was written into a part, and hold it no more; harmless if it is not held."""
        with self._changing:
            self.holds_all = False  # else it would be held again
            self._give_back(part)

    def _give_back(self, part: str) -> None:
        replica = self._replica.parts.get(part)
        if replica is not None:
            with self._replica.lock:
                self.graph.leaving.add(part)  # what is written from now on would not be sent
            self._settle(part, answered=False)
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
    return PartError(f"{what}: this memory holds no parts; give it interest=(...), which may be empty")
