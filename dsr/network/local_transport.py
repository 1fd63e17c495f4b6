"""A network inside one process: exact and instant, or with loss, duplication, delay, reordering, cuts and pauses.

Nothing moves by itself: `LocalNetwork.deliver` hands over what is due on the network's clock, in an order
that depends only on the seed. For lockstep runs and tests; not thread-safe.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from dsr.clock import Clock, ManualClock
from dsr.errors import TransportError
from dsr.network.transport import (
    BulkHandler,
    Chunks,
    MessageHandler,
    PresenceHandler,
    Qos,
    RequestHandler,
    key_matches,
    names_one,
)

T = TypeVar("T")
A = TypeVar("A")


@dataclass(frozen=True)
class Faults:
    """Faults of a simulated network, drawn independently for each message and receiver."""

    loss: float = 0.0
    """Probability that a message is lost."""
    duplication: float = 0.0
    """Probability that a message arrives twice."""
    delay: tuple[float, float] = (0.0, 0.0)
    """Bounds of a uniform delay, s; different delays reorder messages."""


_FAULTLESS = Faults()


class _Declaration:
    """Something that a transport declared and can take back."""

    def __init__(self, undo: Callable[[], None]) -> None:
        self._undo: Callable[[], None] | None = undo

    def close(self) -> None:
        """Take it back; harmless when repeated."""
        undo, self._undo = self._undo, None
        if undo is not None:
            undo()


class _Mailbox:
    """Holds the newest message of a key."""

    def __init__(self, transport: LocalTransport, key: str, notify: Callable[[], None]) -> None:
        self._notify = notify
        self._message: bytes | None = None
        self._subscription = transport.subscribe(key, self._keep)

    def _keep(self, _key: str, message: bytes) -> None:
        self._message = message
        self._notify()

    def take(self) -> bytes | None:
        """The newest message if it was not taken before."""
        message, self._message = self._message, None
        return message

    def close(self) -> None:
        """Stop receiving."""
        self._subscription.close()


class LocalNetwork:
    """Connects `LocalTransport`s."""

    def __init__(self, clock: Clock | None = None, *, seed: int = 0, faults: Faults | None = None) -> None:
        self.clock = clock or ManualClock()
        self.faults = faults or Faults()
        self._random = np.random.default_rng(seed)
        self._transports: list[LocalTransport] = []
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._groups: list[frozenset[str]] = []
        self._cuts: set[tuple[str, str]] = set()
        self._held: dict[str, list[Callable[[], None]]] = {}
        self._arrivals: dict[tuple[str, str], float] = {}
        self.met: Counter[str] = Counter()
        """Messages that met a fault, by its kind: lost, duplicated, delayed, reordered, cut off, held."""

    def connect(self, name: str) -> LocalTransport:
        """A new transport; `name` is what `partition` calls it."""
        transport = LocalTransport(self, name)
        self._transports.append(transport)
        return transport

    def is_due(self, within: float) -> bool:
        """Whether anything is to be handed over now or within so many seconds."""
        return bool(self._queue) and self._queue[0][0] <= self.clock.monotonic() + within

    def deliver(self) -> int:
        """Hand over everything due by now, including what that causes at once; returns how many messages."""
        count = 0
        while self._queue and self._queue[0][0] <= self.clock.monotonic():
            heapq.heappop(self._queue)[2]()
            count += 1
        return count

    def partition(self, *groups: Iterable[str]) -> None:
        """Divide the network: only transports in the same group reach each other; those in no group reach nobody."""
        self._change_reach([frozenset(group) for group in groups], self._cuts)

    def cut(self, sender: str, receiver: str) -> None:
        """Let nothing pass from one to the other; the way back stays as it is."""
        self._change_reach(self._groups, self._cuts | {(sender, receiver)})

    def heal(self) -> None:
        """Everybody reaches everybody again."""
        self._change_reach([], set())

    def suspend(self, name: str) -> None:
        """Stop a process: what comes for it waits, and it answers nobody."""
        self._held.setdefault(name, [])

    def resume(self, name: str) -> None:
        """Let a process go on, with what has come for it meanwhile; harmless if it was not stopped."""
        for action in self._held.pop(name, []):
            self.later(0.0, action)

    def reaches(self, a: LocalTransport, b: LocalTransport) -> bool:
        """Whether messages pass from `a` to `b`."""
        if a is b or (a.name, b.name) in self._cuts:
            return a is b
        return not self._groups or any(a.name in group and b.name in group for group in self._groups)

    def _change_reach(self, groups: list[frozenset[str]], cuts: set[tuple[str, str]]) -> None:
        pairs = [(a, b) for a in self._transports for b in self._transports if a is not b]
        before = {(a.name, b.name) for a, b in pairs if self.reaches(a, b)}
        self._groups, self._cuts = groups, cuts
        for a, b in pairs:
            alive = self.reaches(a, b)
            if alive != ((a.name, b.name) in before):
                for key in a.tokens:
                    b.see(key, alive)

    def others(self, me: LocalTransport) -> list[LocalTransport]:
        """The transports that `me` reaches, without itself."""
        return [other for other in self._transports if other is not me and self.reaches(me, other)]

    def leave(self, transport: LocalTransport) -> None:
        """Forget a closed transport."""
        if transport in self._transports:
            self._transports.remove(transport)

    def later(self, delay: float, action: Callable[[], None]) -> None:
        """Run `action` in `deliver`, `delay` seconds from now."""
        heapq.heappush(self._queue, (self.clock.monotonic() + delay, next(self._order), action))

    def send(self, sender: LocalTransport, receiver: LocalTransport, action: Callable[[], None]) -> None:
        """Pass a message on, with the network's faults; what is under way when a link is cut is lost."""
        arrive = partial(self._arrive, sender, receiver, action)
        if self.faults == _FAULTLESS:
            self.later(0.0, arrive)
            return
        copies = 0 if self._random.random() < self.faults.loss else 1
        copies += bool(copies and self._random.random() < self.faults.duplication)
        self.met["lost"] += copies == 0
        self.met["duplicated"] += copies == 2
        for _ in range(copies):
            delay = float(self._random.uniform(*self.faults.delay))
            self._note_order((sender.name, receiver.name), delay)
            self.later(delay, arrive)

    def _arrive(self, sender: LocalTransport, receiver: LocalTransport, action: Callable[[], None]) -> None:
        """Do what a message tells its receiver, if it still comes there."""
        if receiver.closed:
            return
        if not self.reaches(sender, receiver):
            self.met["cut off"] += 1
        elif receiver.name in self._held:
            self.met["held"] += 1
            self._held[receiver.name].append(partial(self._arrive, sender, receiver, action))
        else:
            action()

    def _note_order(self, way: tuple[str, str], delay: float) -> None:
        """Count a delay, and whether what was sent earlier on this way comes later."""
        at = self.clock.monotonic() + delay
        self.met["delayed"] += delay > 0.0
        self.met["reordered"] += at < self._arrivals.get(way, at)
        self._arrivals[way] = max(at, self._arrivals.get(way, at))


class LocalTransport:
    """One participant of a `LocalNetwork`; implements `dsr.network.transport.Transport`."""

    trouble = ""
    shares_memory = False

    def __init__(self, network: LocalNetwork, name: str) -> None:
        self.name = name
        self.closed = False
        self.tokens: list[str] = []
        self._network = network
        self._subscribers: list[tuple[str, MessageHandler]] = []
        self._servers: list[tuple[str, RequestHandler, bool]] = []
        self._presence: list[tuple[str, PresenceHandler]] = []

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """Send to all current subscribers but our own; faults spare no class of traffic."""
        self._check_open()
        for other in self._network.others(self):
            for pattern, handler in list(other._subscribers):
                if names_one(key) and key_matches(pattern, key):
                    self._network.send(self, other, _bind(handler, key, payload))

    def publish_bulk(self, key: str, chunks: Chunks) -> None:
        """Send the pieces as one message."""
        self.publish(key, b"".join(chunks), Qos.BULK)

    def newest(self, key: str, notify: Callable[[], None]) -> _Mailbox:
        """Receive the newest message of `key`."""
        return _Mailbox(self, key, notify)

    def subscribe_bulk(self, key: str, handler: BulkHandler) -> _Declaration:
        """Call `handler` in `deliver`."""
        return self.subscribe(key, handler)

    def is_heard(self, key: str, qos: Qos = Qos.RELIABLE) -> bool:
        """Whether anybody elsewhere subscribes to `key` now."""
        others = self._network.others(self)
        return any(key_matches(pattern, key) for other in others for pattern, _ in list(other._subscribers))

    def subscribe(self, key: str, handler: MessageHandler, *, newest: int | None = None) -> _Declaration:
        """Call `handler` in `deliver`; handlers here are never slow, so `newest` has no effect."""
        return self._declare(self._subscribers, (key, handler))

    def serve(
        self, key: str, handler: RequestHandler, *, asker: Callable[[bytes], str] | None = None
    ) -> _Declaration:
        """Answer requests on `key`; none ever waits here."""
        return self._declare(self._servers, (key, handler, asker is None))

    def request(
        self, key: str, payload: bytes, on_reply: MessageHandler, on_done: Callable[[], None], timeout: float
    ) -> None:
        """Ask whoever serves `key`; request and reply each suffer the network's faults."""
        self._check_open()
        served = False
        for other in self._network.others(self):
            for pattern, handler, answers_patterns in list(other._servers):
                is_asked = key_matches(key, pattern) or key_matches(pattern, key)
                if is_asked and (answers_patterns or names_one(key)):
                    served = True
                    place = key if "*" in pattern else pattern
                    self._network.send(self, other, self._exchange(other, handler, place, payload, on_reply))
        self._network.later(timeout if served else 0.0, on_done)  # as over Zenoh: who asks nobody need not wait

    def _exchange(
        self, other: LocalTransport, handler: RequestHandler, key: str, payload: bytes, on_reply: MessageHandler
    ) -> Callable[[], None]:
        def run() -> None:
            reply = handler(key, payload)
            if reply is not None:
                self._network.send(other, self, _bind(on_reply, key, reply))

        return run

    def announce(self, key: str) -> _Declaration:
        """Let others see `key` as alive until closed."""
        self.tokens.append(key)
        for other in self._network.others(self):
            other.see(key, True)

        def undo() -> None:
            self.tokens.remove(key)
            for other in self._network.others(self):
                other.see(key, False)

        return _Declaration(undo)

    def watch_presence(self, key: str, handler: PresenceHandler) -> _Declaration:
        """Call `handler` for present keys at the next `deliver`, then at each change."""
        for other in self._network.others(self):
            for token in other.tokens:
                if names_one(token) and key_matches(key, token):
                    self._network.later(0.0, _bind(handler, token, True))
        return self._declare(self._presence, (key, handler))

    def see(self, key: str, alive: bool) -> None:
        """Called by the network when a key appears or goes."""
        for pattern, handler in list(self._presence):
            if names_one(key) and key_matches(pattern, key):
                self._network.later(0.0, _bind(handler, key, alive))

    def renew(self) -> None:
        """Do nothing: this transport forgets no declarations."""

    def pump(self) -> None:
        """Deliver the messages that are due."""
        self._network.deliver()

    def close(self) -> None:
        """Leave the network; others see our tokens go."""
        if not self.closed:
            for key in list(self.tokens):
                for other in self._network.others(self):
                    other.see(key, False)
            self.closed = True
            self._network.leave(self)

    def _check_open(self) -> None:
        if self.closed:
            raise TransportError(f"{self.name} has left the network")

    def _declare(self, declarations: list[T], declaration: T) -> _Declaration:
        declarations.append(declaration)
        return _Declaration(lambda: declarations.remove(declaration))


def _bind(function: Callable[[str, A], object], key: str, argument: A) -> Callable[[], None]:
    def call() -> None:
        function(key, argument)

    return call
