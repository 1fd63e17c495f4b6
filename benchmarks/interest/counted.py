"""A network in memory that counts what each process sends and gets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dsr import LocalNetwork, ManualClock, Memory
from dsr.network.keys import Keys
from dsr.network.local_transport import LocalTransport, _Declaration
from dsr.network.transport import MessageHandler, Qos, RequestHandler, key_matches

GRAPH = "g"
_BASE_DIGESTS, _QUESTIONS = Keys(GRAPH).digest(), Keys(GRAPH).holders()
TICK = 0.05
"""s between two rounds in which all do what is due"""


@dataclass
class Traffic:
    """Messages and bytes, one way."""

    messages: int = 0
    size: int = 0
    """Bytes."""

    def add(self, payload: bytes) -> None:
        """Count one message."""
        self.messages += 1
        self.size += len(payload)


class CountedTransport(LocalTransport):
    """A participant that counts; a message to several receivers counts once for each, as between peers."""

    def __init__(self, network: LocalNetwork, name: str) -> None:
        super().__init__(network, name)
        self.sent, self.received = Traffic(), Traffic()
        self.digests, self.questions = Traffic(), Traffic()
        """Of what was received, digests of the base, and who holds what: each process sends these to all others."""

    def publish(self, key: str, payload: bytes, qos: Qos = Qos.RELIABLE) -> None:
        """See `Transport.publish`."""
        for other in self._network.others(self):
            if any(key_matches(pattern, key) for pattern, _ in other._subscribers):
                self.sent.add(payload)
                assert isinstance(other, CountedTransport)
                other.received.add(payload)
                if key_matches(_BASE_DIGESTS, key):
                    other.digests.add(payload)
        super().publish(key, payload, qos)

    def request(
        self, key: str, payload: bytes, on_reply: MessageHandler, on_done: Callable[[], None], timeout: float
    ) -> None:
        """See `Transport.request`."""
        self.sent.add(payload)

        def replied(key: str, reply: bytes) -> None:
            self.received.add(reply)
            if key_matches(_QUESTIONS, key):
                self.questions.add(reply)
            on_reply(key, reply)

        super().request(key, payload, replied, on_done, timeout)

    def serve(
        self, key: str, handler: RequestHandler, *, asker: Callable[[bytes], str] | None = None
    ) -> _Declaration:
        """See `Transport.serve`."""

        def answer(key: str, payload: bytes) -> bytes | None:
            self.received.add(payload)
            if key_matches(_QUESTIONS, key):
                self.questions.add(payload)
            reply = handler(key, payload)
            if reply is not None:
                self.sent.add(reply)
            return reply

        return super().serve(key, answer, asker=asker)


class Fleet:
    """Memories of one graph on such a network, with a clock that is moved by hand."""

    def __init__(self, seed: int = 0) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock, seed=seed)
        self.memories: list[Memory] = []

    def join(self, agent: str, interest: tuple[str, ...] | None = ()) -> Memory:
        """One more process."""
        transport = CountedTransport(self.network, agent)
        self.network._transports.append(transport)
        memory = Memory(GRAPH, agent, transport=transport, clock=self.clock, rid=f"{agent}-1", interest=interest)
        self.memories.append(memory)
        return memory

    def live(self, seconds: float) -> None:
        """Let time pass, and everybody do what is due."""
        for _ in range(max(1, round(seconds / TICK))):
            self.clock.advance(TICK)
            for memory in self.memories:
                memory.flush()
            self.network.deliver()
            for memory in self.memories:
                memory.poll()
                memory.flush()
            self.network.deliver()

    @staticmethod
    def traffic(memory: Memory) -> CountedTransport:
        """The counts of a process."""
        assert isinstance(memory.transport, CountedTransport)
        return memory.transport
