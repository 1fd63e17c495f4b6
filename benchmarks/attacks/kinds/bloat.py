"""Contexts full of what never was: the attacker goes, and must leave no cost behind."""

from __future__ import annotations

import time
from collections.abc import Callable

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.crdt.context import CausalContext
from dsr.crdt.delta import Delta
from dsr.crdt.pieces import START, Piece
from dsr.memory import Memory
from dsr.replication.claims import MAX_EARLY, MAX_GAPS, MAX_NEWCOMERS, MAX_STRANGERS
from dsr.replication.piece_wire import encode_piece
from dsr.replication.wire import Digest, encode_digest
from dsr.security.policy import Grant

_GHOSTS = 100_000
_GHOSTS_OF_A_REPLY = 40_000
"""About as many as fit into one message."""
_GAPS = 60_000
_PATIENCE = 10.0
_MOST_DIGEST = 4000
"""bytes of a digest: 32 replicas with names of 40 letters and eight ranges each are the most; here most have one."""
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",), trusted=True), "other": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",)),
}  # fmt: skip


def _run(send: Callable[[Arena, Raw], None], most_ranges: int) -> Callable[[Arena], Outcome]:
    def run(arena: Arena) -> Outcome:
        victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("attacker")
        victim.add_node("before", "cube")
        arena.eventually(lambda: "before" in other, _PATIENCE)
        send(arena, attacker)
        arena.wait(2.0)
        attacker.transport.close()
        victim.add_node("after", "cube")
        arrived = arena.eventually(lambda: "after" in other, _PATIENCE)
        memories = (victim, other)
        ranges = max(sum(1 for _ in memory.replica.graph.store.context.ranges()) for memory in memories)
        digest = max(map(_digest_bytes, memories))
        load = _load(arena, memories)
        effect = f"{ranges} ranges kept, digests of {digest} bytes, CPU {100 * load:.0f} %, others served: {arrived}"
        held = arrived and ranges <= most_ranges and digest <= _MOST_DIGEST
        return Outcome(held, effect, {"ranges": ranges, "digest_bytes": digest, "cpu_share": load})

    return run


def _digest_bytes(memory: Memory) -> int:
    with memory.replica.lock:
        return len(memory.replica.synchroniser.digest(0.0))


def _load(arena: Arena, memories: tuple[Memory, ...]) -> float:
    """Share of a core that this process takes for all its memories while nothing happens."""
    begin, cpu = arena.now(), time.process_time()
    arena.wait(5.0)
    return (time.process_time() - cpu) / (arena.now() - begin)


def _ghosts_in_a_context(arena: Arena, attacker: Raw) -> None:
    attacker.send(Delta(context=[(f"ghost-{number}", 1, 1) for number in range(_GHOSTS)]))


def _ghosts_removed(arena: Arena, attacker: Raw) -> None:
    for first in range(0, _GHOSTS, 1000):
        dots = [(f"ghost-{number}", 1) for number in range(first, first + 1000)]
        attacker.send(Delta(removed=dots, context=[(attacker.rid, first + 1, first + 1)]))


def _ghosts_that_write(arena: Arena, attacker: Raw) -> None:
    for number in range(3 * MAX_NEWCOMERS):
        rid = f"attacker-{number}"
        attacker.send(Delta(context=[(rid, 1, 1)]), rid)


def _ghosts_in_replies(arena: Arena, attacker: Raw) -> None:
    context = [(f"attacker-{number}", 1, 1) for number in range(_GHOSTS_OF_A_REPLY)]
    reply = encode_piece(Piece(START, examined=context, whole=context))
    attacker.transport.serve(attacker.keys.sync(attacker.rid), lambda _key, _payload: reply)
    seen = CausalContext(context).summary()
    for _ in range(3):
        attacker.send_digest(encode_digest(Digest(attacker.rid, arena.now(), seen, 0, ())))


def _gaps(arena: Arena, attacker: Raw) -> None:
    attacker.send(Delta(context=[(attacker.rid, 2 * number, 2 * number) for number in range(1, _GAPS)]))
    for number in range(1, 5 * MAX_GAPS):
        attacker.send(Delta(context=[(attacker.rid, 2 * number, 2 * number)]))


_HOLDS = "few are kept, digests stay small, and the others go on"
_REST = 100
"""Ranges that may be kept of whoever else took part."""

ATTACKS = [
    Attack("ghosts", f"claims to have seen {_GHOSTS} replicas that never were", _HOLDS,
           _run(_ghosts_in_a_context, _REST), _GRANTS),
    Attack("ghosts-removed", f"removes what {_GHOSTS} replicas that never were have made", _HOLDS,
           _run(_ghosts_removed, MAX_EARLY + _REST), _GRANTS),
    Attack("ghosts-that-write", f"speaks as {3 * MAX_NEWCOMERS} replicas of its own", _HOLDS,
           _run(_ghosts_that_write, MAX_NEWCOMERS + _REST), _GRANTS),
    Attack("ghosts-in-replies", f"answers with {_GHOSTS_OF_A_REPLY} replicas of its own that never were", _HOLDS,
           _run(_ghosts_in_replies, 2 * MAX_STRANGERS + _REST), _GRANTS),
    Attack("gaps", f"leaves {_GAPS} gaps between its counters", _HOLDS, _run(_gaps, MAX_GAPS + _REST), _GRANTS),
]  # fmt: skip
