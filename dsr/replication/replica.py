"""One replica at work: a graph, its synchroniser and a transport, with or without threads of its own.

With threads, each subscription merges what it brings, and one thread sends what was written, so that neither a
busy reader nor a slow network ever blocks a writer. Without, `poll` and `flush` do it when called (lockstep, tests).
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
from collections import deque
from collections.abc import Callable, Iterator

from dsr.clock import Clock
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece, Place, piece_of, together
from dsr.graph.graph import Graph
from dsr.network.keys import Keys
from dsr.network.transport import Qos, Subscription, Transport
from dsr.replication.holding import Hold
from dsr.replication.inquiry import MAX_PAUSED, REQUEST_TIMEOUT
from dsr.replication.outbox import Outbox
from dsr.replication.outputs import Ask, Output, PublishDelta, PublishDigest, Renew, TakeId
from dsr.replication.parcels import parcels
from dsr.replication.piece_wire import asker_of, encode_piece
from dsr.replication.polling import Poller
from dsr.replication.renaming import going_on_as, next_id, unconfirmed
from dsr.replication.statistics import Statistics
from dsr.replication.sync import ChangeGate, Synchroniser
from dsr.replication.wire import encode_delta
from dsr.threads import new_thread

MAX_INBOX = 10_000
"""Messages that may wait for `poll`; the synchroniser's repair makes up for those beyond."""
NEWEST_DELTAS = 1024
"""Messages that may wait for a thread to merge them; of more, the newest are kept."""
NEWEST_SAMPLES = 256
IDLE = 0.002
"""s since anything was sent, after which a write is sent by the thread that made it: nobody need be woken."""
GATHER = 0.001
"""s for which the sending thread lets further writes gather."""
HEARD_LASTS = 1.0
"""s for which a key counts as heard on which somebody listened: to ask the network costs as much as to send."""
LEFT_OVER = 1.0
"""s after which the sending thread looks for what a writer that was interrupted has left behind."""

_log = logging.getLogger("dsr.replication.replica")


class Replica:
    """Connects a graph to its peers."""

    def __init__(
        self,
        graph: Graph,
        transport: Transport,
        clock: Clock,
        keys: Keys,
        agent: str,
        gate: ChangeGate | None = None,
        lock: threading.RLock | None = None,
    ) -> None:
        self.graph = graph
        graph.rights = gate
        self.lock = lock or threading.RLock()
        """Held while the graph is changed; all worlds of a memory share one, for forks share their content."""
        self.after_poll: Callable[[], None] | None = None
        """Called at the end of each `poll`, with no lock held."""
        self.synchroniser = Synchroniser(graph, gate, keys.part, self.lock, ask_ahead=self._perform)
        self._transport = transport
        self._clock = clock
        self._keys = keys
        self.skipped = 0
        """Messages passed over because merging could not keep up."""
        self.received = 0
        """Messages with changes of others that arrived."""
        self.written = 0
        """Changes of our own."""
        self._outbox = Outbox()
        self._inbox: deque[Callable[[], None]] = deque()
        """Room for answers that wait for `poll`."""
        self._written = threading.Event()
        self._progress = threading.Condition()
        self._sending = threading.RLock()  # where Ctrl-C leaves it locked, that thread can still send
        self._sent_at = -math.inf
        self._heard_at: dict[str, float] = {}
        """When somebody was known to listen, by key."""
        self._merging = threading.Lock()
        self._holds = 0
        self._stopped = threading.Event()
        self._left = False
        self._poller: Poller | None = None
        self._sender: threading.Thread | None = None
        self._agent = agent
        self.on_new_id: Callable[[str], None] = lambda rid: None
        """Called, with no lock held, when this replica has taken another id."""
        self._listening = self._listen()
        self._announced = self._announce()

    def _listen(self) -> list[Subscription]:
        keys, transport, sync = self._keys, self._transport, self.synchroniser

        def merge(key: str, payload: bytes) -> None:
            self.received += 1
            self._receive(lambda: sync.receive_delta(_last(key), payload, self._clock.now()))

        def digest(key: str, payload: bytes) -> None:
            self._receive(
                lambda: sync.receive_digest(_last(key), payload, self._clock.monotonic(), self._clock.now())
            )

        def presence(key: str, alive: bool) -> None:
            self._enqueue(lambda: self._peer_changed(_last(key), alive))

        return [
            transport.subscribe(keys.delta(), merge, newest=NEWEST_DELTAS),
            transport.subscribe(keys.stream(), merge, newest=NEWEST_SAMPLES),
            transport.subscribe(keys.digest(), digest, newest=NEWEST_SAMPLES),
            transport.watch_presence(keys.presence(), presence),
        ]

    def _announce(self) -> list[Subscription]:
        """Answer under the replica's id, and let others see it."""
        rid, keys, transport = self.graph.rid, self._keys, self._transport
        return [
            transport.serve(keys.sync(rid), self._answer, asker=asker_of),
            transport.announce(keys.presence(self._agent, rid)),
        ]

    # ---- writing

    def commit(self, delta: Delta) -> None:
        """Queue a delta of our own; the caller holds the lock, and calls `send_soon` when it does not any more."""
        self.written += 1
        self._outbox.add(delta, together=self._holds > 0)

    def send_soon(self) -> None:
        """Have sent what was committed: by this thread if the network has been idle, else by the sending thread.

        A stuck network has the sending thread wait in it, and writers pass by. Only a lone write that finds all buffers
        of a stalled link full, megabytes, waits itself, until the link is closed after a second.
        """
        if self._holds or self._sender is None or not self._outbox.waits:
            return
        if self._clock.monotonic() - self._sent_at > IDLE and self._sending.acquire(blocking=False):
            try:
                self._guarded(self._send)
            finally:
                self._sending.release()
        elif not self._written.is_set():
            self._written.set()

    def hold(self) -> contextlib.AbstractContextManager[None]:
        """Send all writes inside together."""
        return Hold(self._hold_for)

    def _hold_for(self, change: int) -> None:
        """Hold writes back for one more (1) or one less (-1)."""
        with self.lock:
            self._holds += change
            digests: list[PublishDigest] = []
            if self._holds == 0 and self._sender is not None and not self._stopped.is_set():
                self._guarded(lambda: digests.extend(self._settle()))
        self.send_soon()
        for digest in digests:
            self._guarded(lambda digest=digest: self._perform(digest))  # type: ignore[misc]

    def _settle(self) -> list[PublishDigest]:
        """What is to be told of now; what that tells of goes with what was held back, before it. Needs the lock."""
        due = self.synchroniser.speak(self._clock.monotonic(), self._clock.now())
        for output in due:
            if isinstance(output, PublishDelta):
                self.commit(output.delta)
        return [output for output in due if isinstance(output, PublishDigest)]

    def flush(self) -> None:
        """Hand everything written so far to the transport; nothing while writes are held together."""
        with self._sending:
            self._send()

    def _send(self) -> None:
        with self.lock:
            if self._holds and not self._stopped.is_set():
                return
            bundles, samples = self._outbox.take()
            rid = self.graph.rid
        self._publish_as(rid, bundles, samples)

    def _publish_as(self, rid: str, bundles: list[Delta], samples: Delta) -> None:
        """Publish what was taken from the outbox; what fails is left to the repair, what Ctrl-C breaks off is not."""
        try:
            if samples.writes:
                self._publish(self._keys.stream(rid), [samples], Qos.STREAM)
            if bundles:
                self._publish(self._keys.delta(rid), bundles, Qos.RELIABLE)
        except Exception:
            self._outbox.sent()
            raise
        self._outbox.sent()
        self._sent_at = self._clock.monotonic()

    def _publish(self, key: str, deltas: list[Delta], qos: Qos) -> None:
        """Publish, unless nobody listens: whoever comes gets a snapshot."""
        now = self._clock.monotonic()
        if now - self._heard_at.get(key, -math.inf) > HEARD_LASTS:
            if not self._transport.is_heard(key, qos):
                return
            self._heard_at[key] = now
        for delta in deltas:
            for message in parcels(delta):
                self._transport.publish(key, message, qos)

    # ---- receiving

    def poll(self) -> None:
        """Merge the messages that have arrived, and do the work that is due; who has left says nothing more."""
        if self._left:
            return
        with self._merging:
            for _ in range(len(self._inbox)):
                action = self._inbox.popleft()
                with self.lock:
                    action()
            with self.lock:
                now, physical = self._clock.monotonic(), self._clock.now()
                outputs = self.synchroniser.tick(now, physical, holds_back=self._holds > 0)
                self.graph.tidy()
            for output in outputs:
                self._perform(output)
        if self.after_poll is not None:
            self.after_poll()
        with self._progress:
            self._progress.notify_all()

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until `condition` holds after some poll (threads needed); false after `timeout` s."""
        with self._progress:
            return self._progress.wait_for(condition, timeout)

    def wait_for_pieces(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait until `condition` holds; false if no piece of an answer came for `timeout` s."""
        came = -1
        while came < self.synchroniser.pieces:
            came = self.synchroniser.pieces
            if self.wait_until(condition, timeout):
                return True
        return False

    def _receive(self, action: Callable[[], None]) -> None:
        """Do what a message asks for: at once in the thread of its subscription, or without threads in `poll`.

        The synchroniser takes the lock, after it has read the message.
        """
        if self._sender is not None:
            self._guarded(action)
        elif len(self._inbox) < MAX_INBOX:
            self._inbox.append(action)
        else:
            self.skipped += 1

    def _enqueue(self, action: Callable[[], None]) -> None:
        """Leave an action to the next `poll`: a callback of the network must return at once."""
        self._inbox.append(action)
        if self._poller is not None:
            self._poller.ask(self._poll_guarded)

    def _peer_changed(self, rid: str, alive: bool) -> None:
        if alive:
            self.synchroniser.peer_appeared(rid, self._clock.monotonic())
        else:
            self.synchroniser.peer_gone(rid, self._clock.monotonic())

    def _answer(self, key: str, payload: bytes) -> bytes | None:
        piece = self.synchroniser.answer(_last(key), payload)
        return None if piece is None else encode_piece(piece)

    def _perform(self, output: Output) -> None:
        match output:
            case PublishDelta(delta):
                with self.lock:
                    self.commit(delta)
                self._written.set()  # the sending thread waits for the network, not who polls all worlds
            case PublishDigest(rid, payload) if rid == self.graph.rid:
                self._transport.publish(self._keys.digest(rid), payload, Qos.STREAM)
            case Renew():
                self._transport.renew()
            case TakeId():
                self.take_id()
            case Ask(peer, payload, number):
                places = threading.Semaphore(MAX_PAUSED)
                self._transport.request(
                    self._keys.sync(peer),
                    payload,
                    lambda _, reply: self._take_in(peer, number, reply, places),
                    lambda: self._enqueue(lambda: self.synchroniser.request_done(number)),
                    REQUEST_TIMEOUT,
                )

    def _take_in(self, peer: str, number: int, payload: bytes, places: threading.Semaphore) -> None:
        """Read an answer in the network's thread, and leave it to the next poll.

        A question has as many `places` for answers: liars give one question any number of them.
        """
        if not places.acquire(blocking=False):
            self.skipped += 1
            return
        reply = self.synchroniser.read_reply(payload)
        self._enqueue(lambda: self.synchroniser.take_reply(peer, number, reply, self._clock.now()))

    # ---- life

    def start(self, poller: Poller) -> None:
        """Let `poller` do the work that is due, and run a thread that sends."""
        self._sender = new_thread(self._run_sending, "dsr-send")
        self._sender.start()
        self._poller = poller
        poller.add(self._poll_guarded)

    def _poll_guarded(self) -> None:
        self._guarded(self.poll)

    def _run_sending(self) -> None:
        while not self._stopped.is_set():
            if self._clock.wait(self._written, LEFT_OVER):
                self._clock.wait(self._stopped, GATHER)
            self._written.clear()
            self._guarded(self.flush)

    def _guarded(self, step: Callable[[], None]) -> None:
        """A fault in one step must not silence the replica: say it and go on."""
        try:
            step()
        except Exception:
            if not self._stopped.is_set():
                _log.exception("replica %s: %s failed", self.graph.rid, step.__qualname__)

    def move(self, keys: Keys) -> None:
        """Meet the peers under other keys from now on; what those there lack, the repair brings them."""
        with self._sending:
            self._withdraw(self._announced + self._listening)
            self._keys = keys
            self._listening = self._listen()
            self._announced = self._announce()

    def take_id(self) -> None:
        """Go on under another replica id, with all that is held here; what peers may lack of it is written anew."""
        with self._sending:
            with self.lock:
                bundles, samples = self._outbox.take()
                old, rid = self.graph.rid, next_id(self.graph.rid)
                sync, now = self.synchroniser, self._clock.now()
                lies = sync.impersonation
                delta, lies.renewed = going_on_as(self.graph, rid, sync.confirmed, now, lies.forged, lies.renewed)
                self.commit(delta)
                sync.id_taken()
            self._publish_as(old, bundles, samples)
            withdrawn, self._announced = self._announced, self._announce()
            self._withdraw(withdrawn)
        _log.warning("replica %s goes on as %s", old, rid)
        self.on_new_id(rid)
        self._written.set()

    def _withdraw(self, declarations: list[Subscription]) -> None:
        for declaration in declarations:
            declaration.close()

    def close(self) -> None:
        """Send the waiting changes and leave; the transport stays open.

        Harmless when repeated. What Ctrl-C breaks off goes on when it is called again.
        """
        if self._left:
            return
        self._guarded(self._send_again if self._stopped.is_set() else self._send_last)
        self._written.set()
        if self._sender is not None:
            self._sender.join(timeout=2.0)
        if self._poller is not None:
            self._poller.remove(self._poll_guarded)
        self._withdraw(self._announced + self._listening)
        self._left = True

    def _send_last(self) -> None:
        """Stream samples too, in a form that no link drops: nobody is left here to repeat them."""
        self._stopped.set()
        with self.lock:
            self.commit(self.synchroniser.make_durable())
        self.flush()

    def _send_again(self) -> None:
        """Send all that somebody may lack, after Ctrl-C broke off the sending: the outbox may not have had it yet."""
        with self.lock:
            self.commit(unconfirmed(self.graph, self.synchroniser.confirmed))
        self._send_last()

    @property
    def statistics(self) -> Statistics:
        """Counts of the faults that this replica has met."""
        sync = self.synchroniser
        malformed, far = (sum(list(counts.values())) for counts in (sync.dropped, self.graph.far.agents))
        return Statistics(
            sync.repairs, self._outbox.overflowed, self.skipped, self.graph.store.lost_waiting, malformed, far,
            sync.passed_over, sync.new_ids,
        )  # fmt: skip

    def snapshot(self) -> bytes:
        """The whole state as an encoded synchronisation reply; writers get on with their work meanwhile."""
        return encode_delta(together(self._pieces()))

    def _pieces(self) -> Iterator[Piece]:
        begin: Place | None = START
        while begin is not None:
            with self.lock:
                piece = piece_of(self.graph.store, CausalContext(), begin)
            begin = piece.end
            yield piece


def _last(key: str) -> str:
    return key.rsplit("/", 1)[-1]
