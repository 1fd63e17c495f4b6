"""Claims about what another replica has written: it must go on, and lose nothing."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.crdt.delta import Delta
from dsr.crdt.summary import Summary
from dsr.memory import Memory
from dsr.replication.wire import Digest, encode_digest

_ALL = 1 << 53
"""The highest counter that a message may name."""
_NODES = 20
_PATIENCE = 10.0
"""s until what was written is everywhere: some digests, on a machine that is busy."""

Lie = Callable[[Arena, Raw, Memory], None]


def _run(lie: Lie) -> Callable[[Arena], Outcome]:
    def run(arena: Arena) -> Outcome:
        victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("attacker")
        victim.add_node("before", "cube", mass=1.0)
        arena.eventually(lambda: "before" in other, _PATIENCE)
        lie(arena, attacker, victim)
        victim.add_node("at_once", "cube")
        arena.wait(0.5)
        made = 0
        for number in range(_NODES):
            try:
                victim.add_node(f"later_{number}", "cube")
                made += 1
            except KeyError:
                continue
        arrived = arena.eventually(lambda: len(other.nodes("cube")) == _NODES + 2, _PATIENCE)
        kept = len(victim.nodes("cube"))
        effect = f"{made} of {_NODES} nodes made afterwards, {kept - made} of 2 kept, all at the other: {arrived}"
        return Outcome(arrived and made == _NODES and kept == _NODES + 2, effect, {"made": made})

    return run


def _everything(arena: Arena, attacker: Raw, victim: Memory) -> None:
    rid = victim.replica.graph.rid
    attacker.send(Delta(context=[(rid, 1, _ALL)]), rid)


def _removed(arena: Arena, attacker: Raw, victim: Memory) -> None:
    graph = victim.replica.graph
    dots = [(graph.rid, graph.counter + number) for number in range(1, 500)]
    attacker.send(Delta(removed=dots, context=[(attacker.rid, 1, 1)]))


def _listed(arena: Arena, attacker: Raw, victim: Memory) -> None:
    seen = Summary(((victim.replica.graph.rid, ((1, _ALL),)),), 1)
    attacker.send_digest(encode_digest(Digest(attacker.rid, arena.now(), seen, 0, ())))


_HOLDS = "it refuses, goes on under another id, and all that it wrote is everywhere"

ATTACKS = [
    Attack("impersonation", "claims in 30 bytes to have seen all that another may ever write", _HOLDS,
           _run(_everything)),
    Attack("removal-in-advance", "removes what another replica will add next", _HOLDS, _run(_removed)),
    Attack("digest-of-the-future", "tells in a digest to have seen all that another may ever write", _HOLDS,
           _run(_listed)),
]  # fmt: skip
