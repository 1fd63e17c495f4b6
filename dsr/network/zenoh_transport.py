"""The transport over Zenoh: peers that find each other by endpoint, no router needed. The only importer of zenoh."""

from __future__ import annotations

import contextlib
import json
import logging
import re
import threading
from collections.abc import Callable, Iterable, Mapping
from typing import Any
from weakref import WeakSet

import zenoh

from dsr.errors import ConfigError, ListenError, TransportError
from dsr.network.askers import newest_of_each
from dsr.network.bulk import BulkReader, BulkSubscription, BulkWriter, Handler
from dsr.network.keys import descriptor_key
from dsr.network.transport import (
    MAX_ASKERS,
    BulkHandler,
    Chunks,
    MessageHandler,
    PresenceHandler,
    Qos,
    RequestHandler,
    Subscription,
    names_one,
)
from dsr.threads import new_thread

_log = logging.getLogger("dsr.zenoh")

_NO_SETTINGS: Mapping[str, Any] = {}
_ENDPOINT = re.compile(r"[a-z]+/(?:\[[^\]\s]+\]|[^\[\]:/\s]+):(?P<port>[0-9]{1,5})(?:[?#].*)?")
_LAST_PORT = (1 << 16) - 1
_QUEUE = 256
_PATIENCE = 2.0  # s
_fifo, _ring = zenoh.handlers.FifoChannel, zenoh.handlers.RingChannel
_SENDING: dict[Qos, dict[str, Any]] = {
    # One priority each: traffic of one priority shares a queue, and a full one drops or blocks all of it.
    Qos.RELIABLE: {
        "congestion_control": zenoh.CongestionControl.BLOCK,
        "priority": zenoh.Priority.INTERACTIVE_HIGH,
        "express": True,
    },
    Qos.STREAM: {
        "congestion_control": zenoh.CongestionControl.DROP,
        "priority": zenoh.Priority.INTERACTIVE_LOW,
        "express": True,
    },
    Qos.BULK: {"congestion_control": zenoh.CongestionControl.DROP, "priority": zenoh.Priority.DATA_LOW},
}


class _Declaration:
    """A Zenoh declaration: can be made again, and is taken back once, whatever state its session is in."""

    def __init__(self, declare: Callable[[], Any]) -> None:
        self._declare = declare
        self._lock = threading.Lock()
        self._declared: Any = declare()

    def renew(self) -> None:
        """Make it again, unless it was taken back."""
        with self._lock:
            if self._declared is not None:
                self._undeclare()
                self._declared = self._declare()

    def close(self) -> None:
        """Take it back; harmless when repeated or after the session was closed."""
        with self._lock:
            if self._declared is not None:
                self._undeclare()

    def _undeclare(self) -> None:
        declared, self._declared = self._declared, None
        with contextlib.suppress(zenoh.ZError):
            declared.undeclare()


class _Outlet:
    """A publisher that knows whether anybody listens; `publisher` gives the one of the present session."""

    def __init__(self, publisher: Callable[[], Any]) -> None:
        self._publisher = publisher

    @property
    def wanted(self) -> bool:
        """Whether anybody elsewhere listens."""
        return bool(self._publisher().matching_status.matching)

    def put(self, payload: bytes) -> None:
        """Send a message."""
        self._publisher().put(payload)


class ZenohTransport:
    """One Zenoh session; implements `dsr.network.transport.Transport`.

    Args:
        listen: endpoint to be reached at, for example `tcp/127.0.0.1:0`; loopback only, unless told otherwise.
        connect: endpoints of peers or routers; those that are not there (yet) are tried again and again.
        settings: of Zenoh's configuration, by key, besides our own: certificates and access control.
        routing: pass on what others send each other, as a router does. Needed by whoever connects to a router:
            since Zenoh 1.9 a router passes nothing on between peers, but everything between routers.

    Raises:
        ConfigError: if an endpoint is malformed.
        ListenError: if the port is in use.
    """

    shares_memory = True

    def __init__(
        self,
        listen: str,
        connect: Iterable[str] = (),
        settings: Mapping[str, Any] = _NO_SETTINGS,
        *,
        routing: bool = False,
    ) -> None:
        routers = list(connect)
        for endpoint in (listen, *routers):
            _check_endpoint(endpoint)
        config = zenoh.Config()
        for key, value in {**_settings(listen, routers, routing), **settings}.items():
            try:
                config.insert_json5(key, json.dumps(value))
            except zenoh.ZError as error:
                raise TransportError(f"Zenoh refuses {key} = {value!r}: {_reason(error)}") from error
        self._config = config
        self._listen = listen
        self._session = self._open()
        self.trouble = ""
        """See `Transport.trouble`; whoever notices some writes it here."""
        self.closing = threading.Event()
        """Set when this transport closes."""
        self._publishers: dict[tuple[str, Qos], zenoh.Publisher] = {}
        self._bulk_writers: dict[str, BulkWriter] = {}
        self._routing = routing
        self._renewable: WeakSet[_Declaration] = WeakSet()
        """What listens and serves."""
        self._tokens: WeakSet[_Declaration] = WeakSet()
        """What announces, and watches who does."""
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()

    def _open(self) -> zenoh.Session:
        try:
            return zenoh.open(self._config)
        except zenoh.ZError as error:
            raise ListenError(f"cannot listen on {self._listen} ({_reason(error)}); is the port in use?") from error

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """Send to all current subscribers elsewhere; blocks only for `Qos.RELIABLE` on a full link."""
        publisher = self._publishers.get((key, qos)) or self._declare_publisher(key, qos)
        try:
            publisher.put(payload)
        except zenoh.ZError as error:
            if self._publisher(key, qos) is publisher:
                raise TransportError(f"cannot publish on {key}: {_reason(error)}") from error
            self.publish(key, payload, qos)  # in the session that took the place of that one

    def is_heard(self, key: str, qos: Qos = Qos.RELIABLE) -> bool:
        """Whether anybody elsewhere subscribes to `key` now."""
        try:
            return bool(self._publisher(key, qos).matching_status.matching)
        except zenoh.ZError as error:
            raise TransportError(f"cannot publish on {key}: {_reason(error)}") from error

    def publish_bulk(self, key: str, chunks: Chunks) -> None:
        """Send a large message to whoever listens: in shared memory where that reaches, otherwise as bytes."""
        writer = self._bulk_writers.get(key)
        if writer is None:
            plain = _Outlet(lambda: self._publisher(key, Qos.BULK))
            descriptors = _Outlet(lambda: self._publisher(descriptor_key(key), Qos.STREAM))
            writer = self._bulk_writers.setdefault(key, BulkWriter(descriptors, plain))
        try:
            writer.put(chunks)
        except zenoh.ZError as error:
            raise TransportError(f"cannot publish on {key}: {_reason(error)}") from error

    def newest(self, key: str, notify: Callable[[], None]) -> BulkReader:
        """Receive the newest large message of `key`."""

        def listen(place: str) -> Callable[[Handler], Subscription]:
            def declare(handler: Handler) -> Subscription:
                def take(sample: zenoh.Sample) -> None:
                    if names_one(str(sample.key_expr)):
                        handler(sample.payload)

                return self._subscribe(place, lambda: _ring(1), take)

            return declare

        return BulkReader(listen(descriptor_key(key)), listen(key), notify)

    def subscribe_bulk(self, key: str, handler: BulkHandler) -> BulkSubscription:
        """Call `handler` with each large message on `key`, from a thread of the subscription."""
        return BulkSubscription(self.subscribe, key, handler)

    def _publisher(self, key: str, qos: Qos) -> Any:  # the stubs say that `matching_status` is a bool
        return self._publishers.get((key, qos)) or self._declare_publisher(key, qos)

    def _declare_publisher(self, key: str, qos: Qos) -> zenoh.Publisher:
        if "*" in key:
            raise TransportError(f"{key}: wildcards are for subscriptions, not to publish on")
        with self._lock:
            if (key, qos) not in self._publishers:
                self._publishers[(key, qos)] = self._declare(
                    self._session.declare_publisher, key, allowed_destination=zenoh.Locality.REMOTE, **_SENDING[qos]
                )
            return self._publishers[(key, qos)]

    def subscribe(self, key: str, handler: MessageHandler, *, newest: int | None = None) -> Subscription:
        """Call `handler` from a thread of its own; with `newest`, from a ring that forgets the oldest."""

        def pass_on(sample: zenoh.Sample) -> None:
            if names_one(place := str(sample.key_expr)):
                handler(place, sample.payload.to_bytes())

        return self._subscribe(key, lambda: _fifo(_QUEUE) if newest is None else _ring(newest), pass_on)

    def _subscribe(self, key: str, channel: Callable[[], Any], action: Callable[[Any], None]) -> Subscription:
        def declare() -> Any:
            subscriber = self._declare(self._session.declare_subscriber, key, channel())
            self._run(f"dsr-sub-{key}", lambda: _for_each(subscriber, action))
            return subscriber

        return self._kept(declare, self._renewable)

    def serve(
        self, key: str, handler: RequestHandler, *, asker: Callable[[bytes], str] | None = None
    ) -> Subscription:
        """Answer requests on `key` from a thread of its own."""

        def answer(query: zenoh.Query) -> None:
            if asker is None or names_one(str(query.key_expr)):
                _answer(query, key, handler)
            else:
                query.drop()  # type: ignore[no-untyped-call]

        def declare() -> Any:
            # Of a ring the oldest request is dropped, whose asker most likely has given up: nobody else is held up.
            queue: Any = _fifo(_QUEUE) if asker is None else _ring(MAX_ASKERS)
            queryable = self._declare(self._session.declare_queryable, key, queue)
            asked = queryable
            if asker is not None:
                requests = queryable.handler
                asked = newest_of_each(requests.recv, requests.try_recv, lambda query: asker(_payload(query)))
            self._run(f"dsr-serve-{key}", lambda: _for_each(asked, answer))
            return queryable

        return self._kept(declare, self._renewable)

    def _kept(self, declare: Callable[[], Any], place: WeakSet[_Declaration]) -> _Declaration:
        """A declaration that is made again when needed, as long as somebody holds it."""
        declaration = _Declaration(declare)
        with self._lock:
            place.add(declaration)
        return declaration

    def renew(self) -> None:
        """Declare the subscriptions and services again.

        Routers that find each other again may throw declarations away for good, those that come before the routers know
        where they come from (https://github.com/eclipse-zenoh/zenoh/issues/1886). Peers do not.
        """
        if not self._routing:
            return
        with self._lock:
            declarations = list(self._renewable)
        for declaration in declarations:
            declaration.renew()

    def reopen(self) -> None:
        """Begin a new session in place of this one, with the present certificates of the files.

        All that was declared is declared again. Messages that are under way are lost, as on any link that breaks.

        Raises:
            ListenError: if the new session cannot begin; then nothing is heard or sent until this succeeds.
        """
        with self._lock:
            with contextlib.suppress(zenoh.ZError):
                self._session.close()  # type: ignore[no-untyped-call]
            self._session = self._open()
            self._publishers.clear()
            declarations = [*self._renewable, *self._tokens]
        for declaration in declarations:
            declaration.renew()

    def pump(self) -> None:
        """Nothing: messages move by themselves."""

    def request(
        self, key: str, payload: bytes, on_reply: MessageHandler, on_done: Callable[[], None], timeout: float
    ) -> None:
        """Ask whoever serves `key`; both callbacks come from a thread of their own."""
        replies = self._declare(
            self._session.get, key, _fifo(_QUEUE), payload=payload, timeout=timeout,
            target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE,
        )  # fmt: skip

        def pass_on(reply: zenoh.Reply) -> None:
            if reply.ok is not None and names_one(place := str(reply.ok.key_expr)):
                on_reply(place, reply.ok.payload.to_bytes())

        def wait() -> None:
            _for_each(replies, pass_on)
            on_done()

        self._run(f"dsr-ask-{key}", wait)

    def announce(self, key: str) -> Subscription:
        """Declare a liveliness token: others see it go when this process dies."""
        return self._kept(lambda: self._declare(self._session.liveliness().declare_token, key), self._tokens)

    def watch_presence(self, key: str, handler: PresenceHandler) -> Subscription:
        """Call `handler` for the tokens that are there and for every change."""
        is_there = zenoh.SampleKind.PUT

        def report(token: zenoh.Sample) -> None:
            if names_one(place := str(token.key_expr)):
                handler(place, token.kind == is_there)

        def declare() -> Any:
            tokens = self._declare(self._session.liveliness().declare_subscriber, key, _fifo(_QUEUE), history=True)
            self._run(f"dsr-live-{key}", lambda: _for_each(tokens, report))
            return tokens

        return self._kept(declare, self._tokens)

    def _declare(self, declare: Callable[..., Any], key: str, *args: Any, **options: Any) -> Any:
        try:
            return declare(key, *args, **options)
        except zenoh.ZError as error:
            raise TransportError(f"{key}: {_reason(error)}") from error

    def _run(self, name: str, target: Callable[[], None]) -> None:
        thread = new_thread(target, name)
        with self._lock:
            thread.start()
            self._threads = [*(other for other in self._threads if other.is_alive()), thread]

    def close(self) -> None:
        """Close the session and all that was declared on it.

        Waits for its threads: one that came back from Zenoh while the interpreter ends would abort the program.
        """
        self.closing.set()
        with contextlib.suppress(zenoh.ZError):
            self._session.close()  # type: ignore[no-untyped-call]
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(_PATIENCE)


def _check_endpoint(endpoint: str) -> None:
    found = _ENDPOINT.fullmatch(endpoint)
    if found is None or int(found["port"]) > _LAST_PORT:
        raise ConfigError(f"endpoint {endpoint!r}: expected PROTOCOL/HOST:PORT, such as tcp/192.168.0.7:7447")


def _settings(listen: str, connect: list[str], routing: bool) -> dict[str, Any]:
    return {
        "mode": "router" if routing else "peer",
        "listen/endpoints": [listen],
        "listen/exit_on_failure": True,
        "connect/endpoints": connect,
        # Tried in the background, again and again: 0 would mean once, and others are found before they listen.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        # ms that opening waits for connections; every third session waits so long although all are there already
        "scouting/delay": 100,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        "scouting/gossip/autoconnect": {"router": [], "peer": []},
        # A peer that was stopped for long could read what was overwritten meanwhile; `network.bulk` has no such gap.
        "transport/shared_memory/enabled": False,
        # A stopped peer holds up the others no longer than this; its link is closed, and repaired when it goes on.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,  # us
        "transport/unicast/open_timeout": 1000,  # ms
        # Not longer than who opens waits: whoever connects and says nothing holds up newcomers no longer than that.
        "transport/unicast/accept_timeout": 1000,  # ms
    }


def _reason(error: zenoh.ZError) -> str:
    """The message without the place in Zenoh's sources."""
    return str(error).splitlines()[0].split(" at /")[0][:200]


def _for_each(channel: Any, action: Callable[[Any], None]) -> None:
    """Act on what comes until the channel is closed; a failure is said, and does not end the others.

    Zenoh could call back by itself, from threads that would keep a process alive which forgot to close its session.
    """
    with contextlib.suppress(zenoh.ZError):
        for item in channel:
            try:
                action(item)
            except Exception:
                _log.exception("a message could not be handled")


def _payload(query: zenoh.Query) -> bytes:
    return query.payload.to_bytes() if query.payload is not None else b""


def _answer(query: zenoh.Query, key: str, handler: RequestHandler) -> None:
    with query:
        reply = handler(str(query.key_expr), _payload(query))
        if reply is not None:
            query.reply(key, reply)
