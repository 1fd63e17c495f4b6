"""The meshes of a system as one process sees them: its own store, and those of all other replicas behind it.

With threads, transfers go on in a thread that begins with the first of them. Without, `poll` does what is due.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from dsr.clock import Clock
from dsr.errors import MeshError, MeshNotFoundError, TransportError, WireError
from dsr.geometry.cache import DiskCache, cache_folder
from dsr.geometry.mesh import Mesh, is_hash
from dsr.geometry.messages import AskForMesh, Offer, decode_ask, encode_ask, encode_offer
from dsr.geometry.shared import SharedBytes, SharedPlace
from dsr.geometry.store import MeshStore
from dsr.geometry.transfer import EVERYBODY, Transfer
from dsr.network.keys import Keys
from dsr.network.transport import Transport
from dsr.threads import new_thread

ANSWER_TIMEOUT = 5.0
"""s that whoever is asked for a mesh, or a piece of one, has to answer."""
AGAIN = 0.5
"""s from a transfer that failed to the next attempt, if somebody waits for it."""
SELDOM = 8.0
"""s from one to the next in the end, if nobody does: each attempt takes twice as long to come as the one before."""
MOST_WANTED = 10_000
"""Meshes that are asked for at once, or were lately and nobody had them; further ones are not asked for."""
MOST_AT_ONCE = 4
"""Transfers; others wait."""
MOST_KEPT = 1000
"""Transfers on behalf of others, who are about to leave; what they ask for beyond that, they ask for again."""
SHARED_LIMIT = 1 << 28
"""bytes that other processes may read in place; what was asked for longest ago goes in pieces again"""
_TICK = 0.05
_log = logging.getLogger("dsr.meshes")


class MeshStatistics(NamedTuple):
    """Counts of the meshes that a process has sent, received and dropped since it began."""

    sent: int
    """bytes that it gave others in pieces"""
    received: int
    """bytes that came in pieces"""
    in_place: int
    """bytes that were read in the memory of their holders, on this machine"""
    mismatched: int
    """Sources, or files of the cache, whose bytes did not have the hash; dropped, and others asked."""
    malformed: int
    """Messages that made no sense."""
    silent: int
    """Sources that did not answer."""


class MeshExchange:
    """Gives and takes meshes by hash. May be used from any thread.

    Args:
        transport: the network.
        keys: of the system.
        rid: replica id, by which others ask us.
        clock: for waiting.
        threaded: run a thread for transfers, and keep meshes on disk. Without, call `poll`.
        store: of the meshes here.
    """

    def __init__(
        self,
        transport: Transport,
        keys: Keys,
        rid: str,
        clock: Clock,
        *,
        threaded: bool,
        store: MeshStore | None = None,
    ) -> None:
        self.store = store or MeshStore(DiskCache(cache_folder()) if threaded else None)
        self.shares_memory = transport.shares_memory
        """Whether others on this machine are told where they can read in place; else all get pieces."""
        self._transport, self._keys, self._rid, self._clock = transport, keys, rid, clock
        self.threaded = threaded
        """Whether transfers go on by themselves."""
        self.arrivals = 0
        """How many meshes have come here: what depends on meshes is to be looked at again when that goes up."""
        self._counts: Counter[str] = Counter()
        self._transfers: OrderedDict[str, Transfer] = OrderedDict()
        self._begun: set[str] = set()
        self._for_others: set[str] = set()
        """Hashes that nobody here wants."""
        self._failures: dict[str, _Failure] = {}
        self._shared: OrderedDict[str, SharedBytes] = OrderedDict()
        self._events: deque[Callable[[], None]] = deque()
        self._lock = threading.Lock()
        self._working = threading.Lock()
        self._arrived = threading.Event()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._serving = transport.serve(keys.mesh(rid), self._answer)

    @property
    def busy(self) -> bool:
        """Whether meshes are on their way here."""
        return bool(self._transfers)

    @property
    def statistics(self) -> MeshStatistics:
        """Counts of meshes that were sent, received and dropped."""
        counts = Counter(self._counts)
        if self.store.disk is not None:
            counts["mismatched"] += self.store.disk.mismatched
        return MeshStatistics(*(counts[name] for name in MeshStatistics._fields))

    def put(self, mesh: Mesh) -> str:
        """Have a mesh for whoever asks; returns its hash."""
        hash = self.store.put(mesh).hash
        self.arrivals += 1
        return hash

    def get(self, hash: str) -> Mesh | None:
        """The mesh if it is here; else None, and it is asked for. Raises `MeshError` for what is no hash."""
        mesh = self.store.get(_checked(hash))
        if mesh is None:
            self._transfer(hash)
        return mesh

    def ask_again(self) -> None:
        """Ask once more for the meshes that nobody gave when they were asked for, ever more seldom."""
        for hash in list(self._failures):
            self._transfer(hash)

    def wait(self, hash: str, timeout: float) -> Mesh:
        """The mesh, if necessary from elsewhere.

        Raises:
            MeshError: for what is no hash.
            MeshNotFoundError: if nobody gave it within `timeout` s.
        """
        deadline = self._clock.monotonic() + timeout
        while (mesh := self.store.get(_checked(hash))) is None and not self._stopped.is_set():
            left = deadline - self._clock.monotonic()
            transfer = self._transfer(hash, awaited=True)
            if transfer is None:
                self._clock.wait(self._stopped, min(AGAIN, left))
            elif self._clock.wait(transfer.finished, left) and transfer.mesh is not None:
                return transfer.mesh
            if not self.threaded or self._clock.monotonic() >= deadline:
                break
        if mesh is None:
            raise MeshNotFoundError(f"nobody within reach has mesh {hash}, or gave it within {timeout:g} s")
        return mesh

    def hand_over(self, hashes: Iterable[str], others: Sequence[str], timeout: float) -> None:
        """Wait until somebody else has these meshes, too, before this process ends.

        Waits at most `timeout` (s); needs threads.

        Needs threads.

        Args:
            hashes: of meshes that are here.
            others: replica ids.
            timeout: s for all of them.

        Raises:
            MeshNotFoundError: if nobody else has one of them in time.
        """
        deadline = self._clock.monotonic() + timeout
        for hash in hashes:
            asked = 0
            while not self._is_elsewhere(hash):
                if self._clock.monotonic() >= deadline or not others:
                    raise MeshNotFoundError(f"nobody else took mesh {hash} within {timeout:g} s")
                payload = encode_ask(AskForMesh(hash, keep=True))
                self._transport.request(self._keys.mesh(others[asked % len(others)]), payload, _ignore, _nothing, 1.0)
                asked += 1
                self._clock.wait(self._stopped, 0.1)

    def forget(self, hashes: Iterable[str]) -> None:
        """Have these meshes no longer, here or on disk."""
        for hash in hashes:
            self.store.forget(hash)
            with self._lock:
                self._shared.pop(hash, None)

    def poll(self) -> None:
        """Take in what has arrived; only needed without threads."""
        with self._working:
            for _ in range(len(self._events)):
                self._events.popleft()()
            for hash in self._begun:
                self._transfers[hash].look(self._clock.monotonic())
            self._finish()
            self._begin_waiting()

    def close(self) -> None:
        """Answer nobody any more; meshes stay usable. Harmless when repeated."""
        self._stopped.set()
        self._arrived.set()
        self._serving.close()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(2.0)
        with self._lock:
            self._shared.clear()

    # ---- getting

    def _transfer(self, hash: str, *, awaited: bool = False) -> Transfer | None:
        """The transfer of this mesh, begun if none is; None for a while after one that failed."""
        with self._lock:
            transfer = self._transfers.get(hash)
            if hash not in self._begun:
                self._for_others.discard(hash)
            if transfer is None and not self._stopped.is_set():
                failure = self._failures.get(hash)
                if failure and self._clock.monotonic() < failure.at + (AGAIN if awaited else failure.pause):
                    return None
                wanted = len(self._transfers) - len(self._for_others) + len(self._failures)
                if failure is None and wanted >= MOST_WANTED:
                    self._failures.clear()
                    return None
                transfer = self._transfers[hash] = Transfer(hash, self, self._counts)
                self._start_thread()
        self._arrived.set()
        return transfer

    def _keep(self, hash: str) -> None:
        """Get a mesh that nobody here wants."""
        with self._lock:
            if hash in self._transfers or len(self._for_others) >= MOST_KEPT or self._stopped.is_set():
                return
            self._for_others.add(hash)
            self._transfers[hash] = Transfer(hash, self, self._counts)
            self._start_thread()
        self._arrived.set()

    def _begin_waiting(self) -> None:
        with self._lock:
            waiting = [hash for hash in self._transfers if hash not in self._begun]
            room = MOST_AT_ONCE - len(self._begun - self._for_others)
            chosen = [hash for hash in waiting if hash not in self._for_others][:room]
            if self._begun.isdisjoint(self._for_others):  # one at a time, beside our own
                chosen += [hash for hash in waiting if hash in self._for_others][:1]
            self._begun.update(chosen)
            begun = [self._transfers[hash] for hash in chosen]
        for transfer in begun:
            transfer.begin()

    def _finish(self) -> None:
        done = [self._transfers[hash] for hash in self._begun if self._transfers[hash].finished.is_set()]
        for transfer in done:
            if transfer.mesh is not None:
                self.store.put(transfer.mesh)
                self.arrivals += 1
            with self._lock:
                self._begun.discard(transfer.hash)
                del self._transfers[transfer.hash]
                before = self._failures.pop(transfer.hash, None)
                kept_for_others = transfer.hash in self._for_others
                self._for_others.discard(transfer.hash)
                if transfer.mesh is None and not kept_for_others:
                    pause = AGAIN if before is None else min(2.0 * before.pause, SELDOM)
                    self._failures[transfer.hash] = _Failure(self._clock.monotonic(), pause)

    def ask(
        self, holder: str, payload: bytes, on_reply: Callable[[str, bytes], None], on_done: Callable[[], None]
    ) -> None:
        """See `dsr.geometry.transfer.Network`."""

        def reply(key: str, answer: bytes) -> None:
            self._post(lambda: on_reply(key.rsplit("/", 1)[-1], answer))

        try:
            self._transport.request(
                self._keys.mesh(holder), payload, reply, lambda: self._post(on_done), ANSWER_TIMEOUT
            )
        except TransportError as error:
            _log.warning("meshes cannot be asked for: %s", error)
            self._post(on_done)

    def _post(self, event: Callable[[], None]) -> None:
        self._events.append(event)
        self._arrived.set()

    def _start_thread(self) -> None:
        if self.threaded and self._thread is None:
            self._thread = new_thread(self._run, "dsr-meshes")
            self._thread.start()

    def _run(self) -> None:
        while not self._stopped.is_set():
            self._clock.wait(self._arrived, _TICK if self._transfers else 1.0)
            self._arrived.clear()
            try:
                self.poll()
            except Exception:
                _log.exception("a transfer of a mesh failed")

    # ---- giving

    def _answer(self, key: str, payload: bytes) -> bytes | None:
        try:
            ask = decode_ask(payload)
        except WireError as error:
            self._counts["malformed"] += 1
            _log.debug("%s", error)
            return None
        mesh = self.store.get(ask.hash)
        if mesh is None:
            if ask.keep:
                self._keep(ask.hash)
            return None
        if ask.length == 0:
            return encode_offer(Offer(mesh.nbytes, self._place(mesh)))
        piece = bytes(mesh.data[ask.offset : ask.offset + ask.length])
        self._counts["sent"] += len(piece)
        return piece

    def _place(self, mesh: Mesh) -> SharedPlace | None:
        """Where others on this machine can read it, if the transport reaches them so."""
        if not self.shares_memory:
            return None
        with self._lock:
            shared = self._shared.get(mesh.hash)
            try:
                shared = self._shared[mesh.hash] = shared or SharedBytes(mesh.data)
            except OSError as error:
                _log.info("mesh %s goes in pieces: %s", mesh.hash, error)
                return None
            self._shared.move_to_end(mesh.hash)
            while sum(other.place.length for other in self._shared.values()) > SHARED_LIMIT and len(self._shared) > 1:
                self._shared.popitem(last=False)
            return shared.place

    def _is_elsewhere(self, hash: str) -> bool:
        """Whether somebody else has a mesh; waits for his answer, or all others'."""
        found, answered = threading.Event(), threading.Event()

        def reply(key: str, _: bytes) -> None:
            if key != self._keys.mesh(self._rid):
                found.set()
                answered.set()

        self._transport.request(self._keys.mesh(EVERYBODY), encode_ask(AskForMesh(hash)), reply, answered.set, 1.0)
        self._clock.wait(answered, 1.5)
        return found.is_set()


class _Failure(NamedTuple):
    """Nobody had a mesh."""

    at: float
    """s, monotonic"""
    pause: float
    """s until it is asked for again, unless somebody waits for it"""


def _checked(hash: str) -> str:
    if not is_hash(hash):
        raise MeshError(f"{hash!r:.100} is no hash of a mesh; expected 64 hexadecimal digits")
    return hash


def _ignore(key: str, payload: bytes) -> None: ...


def _nothing() -> None: ...
