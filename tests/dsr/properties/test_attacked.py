"""A peer that lies in random ways: the others go on, lose nothing that they wrote, and are equal in the end."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from dsr import LocalNetwork, ManualClock, Memory, Pose
from dsr.crdt.delta import Add, Delta
from dsr.crdt.summary import LISTED, Summary
from dsr.network.local_transport import LocalTransport
from dsr.network.transport import Subscription
from dsr.replication.impersonation import NEW_ID_PAUSE
from dsr.replication.peers import FORGET
from dsr.replication.wire import Digest, encode_delta, encode_digest
from tests.dsr.conftest import reply_of

CATCH_UP = max(2 * NEW_ID_PAUSE, FORGET) + 5.0
"""s after which all must be as it should: two pauses between new ids, a silent peer is forgotten, and the repair."""
LIAR = "liar-1"
sites, choices = st.integers(0, 2), st.integers(0, 1000)


class Attacked(RuleBasedStateMachine):
    """Three honest memories that write and remove, partitions, and a liar that speaks the protocol itself."""

    @initialize()
    def begin(self) -> None:
        self.clock = ManualClock()
        self.network = LocalNetwork(self.clock)
        self.memories = [self._join(f"honest{number}") for number in range(3)]
        self.liar = self.network.connect("liar")
        self.keys = self.memories[0].keys
        self.tokens: list[Subscription] = []
        self.answer: tuple[int, int, int] | None = None
        self.liar.serve(self.keys.sync(LIAR), lambda key, payload: self._answer())
        self.count = self.lies = 0
        self.written: dict[str, set[int]] = {}
        self.removed: set[str] = set()
        self._advance(2.0)
        self.memories[0].add_node("world", "world")
        self._advance(2.0)

    def _join(self, name: str) -> Memory:
        return Memory("g", name, transport=self.network.connect(name), clock=self.clock, rid=f"{name}-1")

    def _advance(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / 0.1))):
            self.clock.advance(0.1 if seconds else 0.0)
            for memory in self.memories:
                memory.flush()
            self.network.deliver()
            for memory in self.memories:
                memory.poll()
                memory.flush()

    # ---- what the honest do

    @rule(site=sites, value=choices)
    def add(self, site: int, value: int) -> None:
        self.count += 1
        name = f"node_{self.count}"
        memory = self.memories[site]
        memory.add_node(name, "cube", seen=value)
        memory.add_edge("world", name, "RT", pose=Pose((0.0, 0.0, 0.0)))
        memory.update_edge("world", name, "RT", pose=Pose((1.0, 0.0, 0.0)))
        self.written[name] = {value}

    @precondition(lambda self: self.written)
    @rule(site=sites, choice=choices, value=choices)
    def update(self, site: int, choice: int, value: int) -> None:
        name = sorted(self.written)[choice % len(self.written)]
        if name in self.memories[site]:
            self.memories[site].update_node(name, seen=value)
            self.written[name].add(value)

    @precondition(lambda self: self.written)
    @rule(site=sites, choice=choices)
    def remove(self, site: int, choice: int) -> None:
        name = sorted(self.written)[choice % len(self.written)]
        if self.memories[site].remove_node(name):
            self.removed.add(name)

    @rule(seconds=st.sampled_from([0.0, 0.1, 0.5, 1.2]))
    def advance(self, seconds: float) -> None:
        self._advance(seconds)

    @rule(mask=st.integers(0, 15))
    def partition(self, mask: int) -> None:
        if self.answer is not None:
            self._advance(1.5)  # who is lied about hears so from the digests of those that believe it: see `_reaches`
        everybody = ["honest0", "honest1", "honest2", "liar"]
        here = [name for place, name in enumerate(everybody) if mask >> place & 1]
        self.network.partition(here, [name for name in everybody if name not in here])

    @rule()
    def heal(self) -> None:
        self.network.heal()

    # ---- what the liar does

    def _id_of(self, site: int) -> tuple[str, int]:
        graph = self.memories[site].replica.graph
        return graph.rid, graph.counter

    def _send(self, delta: Delta, rid: str = LIAR) -> None:
        self.liar.publish(self.keys.delta(rid), encode_delta(delta))

    def _reaches(self, site: int) -> bool:
        """Whether the victim hears the lie: if not, and it writes as much as was claimed, nothing tells it."""
        transport = self.memories[site].transport
        assert isinstance(transport, LocalTransport)
        return self.network.reaches(self.liar, transport)

    def _answer(self) -> bytes | None:
        """A reply of the liar. Of who cannot hear from those that believe it, nothing false is said: see `_reaches`."""
        if self.answer is None:
            return None
        site, number, claimed = self.answer
        rid, counter = self._id_of(site)
        is_lie = claimed > counter and all(self._hears(other, site) for other in range(len(self.memories)))
        context = [(f"ghost-{number}", 1, 3), *([(rid, claimed, claimed)] if is_lie else [])]
        return reply_of(Delta(context=context))

    def _hears(self, speaker: int, site: int) -> bool:
        ends = [self.memories[place].transport for place in (speaker, site)]
        return speaker == site or self.network.reaches(*(end for end in ends if isinstance(end, LocalTransport)))

    def _dot(self) -> int:
        self.lies += 1
        return self.lies

    @rule(site=sites, more=st.sampled_from([-1, 1, 3, 1 << 50]))
    def speak_as(self, site: int, more: int) -> None:
        """In the name of another, of what it has written or will write."""
        rid, counter = self._id_of(site)
        if counter + more >= 1 and self._reaches(site):
            self._send(Delta(context=[(rid, 1, counter + more)]), rid)
            self.network.deliver()

    @rule(site=sites, more=st.integers(1, 4))
    def add_as(self, site: int, more: int) -> None:
        rid, counter = self._id_of(site)
        dot = (rid, counter + more)
        if self._reaches(site):
            self._send(Delta(adds=[Add(dot, f"false_{self._dot()}", "cube")], context=[(*dot, dot[1])]), rid)
            self.network.deliver()

    @rule(site=sites, choice=choices)
    def say_again(self, site: int, choice: int) -> None:
        """In the name of another, what that one added."""
        rid, counter = self._id_of(site)
        made = [dot for dot in sorted(self.memories[site].replica.graph.store.entries) if dot[0] == rid]
        if made and self._reaches(site):
            entry = self.memories[site].replica.graph.store.entries[made[choice % len(made)]]
            add = Add(entry.dot, entry.key, entry.type, entry.sources, entry.destinations)
            self._send(Delta(adds=[add], context=[(rid, 1, counter)]), rid)
            self.network.deliver()

    @rule(site=sites, more=st.integers(1, 4))
    def remove_in_advance(self, site: int, more: int) -> None:
        rid, counter = self._id_of(site)
        number = self._dot()
        if self._reaches(site):
            self._send(Delta(removed=[(rid, counter + more)], context=[(LIAR, number, number)]))
            self._advance(0.0)  # when it comes late it is a removal like any other

    @rule(site=sites, number=choices)
    def claim_for_others(self, site: int, number: int) -> None:
        rid, counter = self._id_of(site)
        self._send(Delta(context=[(f"ghost-{number}", 2, 2), (rid, counter + 1, counter + 9)]))

    @rule(number=choices)
    def leave_a_gap(self, number: int) -> None:
        dot = (LIAR, 10_000 + 2 * number)
        self._send(Delta(context=[(*dot, dot[1])]))

    @rule(site=sites, more=st.integers(-2, 5), hash=st.integers(0, 3))
    def digest(self, site: int, more: int, hash: int) -> None:
        rid, counter = self._id_of(site)
        listed = ((rid, ((1, max(1, counter + more)),)),) if hash else ()
        seen = Summary(listed, hash)
        self.liar.publish(self.keys.digest(LIAR), encode_digest(Digest(LIAR, self.clock.now(), seen, hash, ())))

    @rule(site=sites, number=choices, more=st.integers(0, 2))
    def answer_from_now_on(self, site: int, number: int, more: int) -> None:
        """With replicas that never were, and with more of others than there was."""
        self.answer = site, number, self._id_of(site)[1] + more if more else 0

    @rule(site=sites)
    def announce(self, site: int) -> None:
        self.tokens.append(self.liar.announce(self.keys.presence(f"honest{site}", self._id_of(site)[0])))

    @precondition(lambda self: self.tokens)
    @rule()
    def withdraw(self) -> None:
        self.tokens.pop().close()

    # ---- what must be so

    def teardown(self) -> None:
        if not hasattr(self, "removed"):
            return
        self.network.heal()
        self._advance(1.0)
        self.liar.close()
        self._advance(CATCH_UP)
        first = self.memories[0]
        for memory in self.memories:
            graph = memory.replica.graph
            assert _content(memory) == _content(first), "replicas differ"
            assert graph.store.context == first.replica.graph.store.context, "contexts differ"
            assert graph.store.fingerprint == first.replica.graph.store.fingerprint
            others = {other.replica.graph.rid for other in self.memories if other is not memory}
            assert set(memory.peers) == others, "somebody is forgotten, or taken to be there"
            assert graph.store.context.vector.get(graph.rid, 0) == graph.counter
            assert not graph.store.context.gaps(graph.rid)
        for name, values in self.written.items():
            if name not in self.removed:
                assert name in first, f"{name} is lost"
                assert first.node(name)["seen"] in values
                assert first.edge("world", name, "RT").pose.t[0] == 1.0, "a sample is lost"


def _content(memory: Memory) -> object:
    nodes = {node.name: (node.type, dict(node)) for node in memory.nodes()}
    return nodes, {edge.key: dict(edge) for edge in memory.edges()}


def test_a_difference_that_no_digest_lists_is_repaired() -> None:
    """Of a replica that is long gone, behind all that changed since."""
    machine = Attacked()
    machine.begin()
    a, b, _ = machine.memories
    a.replica.graph.join(Delta(adds=[Add(("old-1", 1), "old", "cube")], context=[("old-1", 1, 1)]), 0.0)
    for memory in (a, b):
        for number in range(2 * LISTED):
            memory.replica.graph.store.context.summary()
            memory.replica.graph.store.context.add((f"gone{number}-1", 1))
    machine._advance(3.0)
    assert "old" in b


def test_a_false_token_hides_nobody() -> None:
    machine = Attacked()
    machine.begin()
    machine.announce(1)
    machine._advance(0.1)
    machine.withdraw()
    machine._advance(0.2)
    assert "honest1-1" in machine.memories[0].peers


Attacked.TestCase.settings = settings(
    max_examples=40, stateful_step_count=30, deadline=None, report_multiple_bugs=False
)  # fmt: skip
TestAttacked = Attacked.TestCase
