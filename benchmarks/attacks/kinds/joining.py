"""Answers to newcomers by replicas that have nothing to give, and askers that want everything all the time."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome
from benchmarks.timing import monotonic
from dsr.crdt.context import CausalContext
from dsr.crdt.pieces import START, Piece
from dsr.replication.piece_wire import Request, encode_piece, encode_request
from dsr.security.policy import Grant

_NODES = 3000
_REQUESTS = 2000
_LONGEST_WRITE = 1.0
"""s; a machine that runs attacks may be busy."""
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",), trusted=True),
    "newcomer": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",)),
}


def _unjoined(arena: Arena) -> Outcome:
    """The attacker is there before the newcomer, and says that it has joined nothing."""
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    for number in range(_NODES):
        victim.add_node(f"cube_{number}", "cube")
    refusal = encode_piece(Piece(START, joined=False))
    served = attacker.transport.serve(attacker.keys.sync(attacker.rid), lambda *_: refusal)
    announced = attacker.transport.announce(attacker.keys.presence("attacker", attacker.rid))
    newcomer = arena.join("newcomer")
    arena.eventually(lambda: newcomer.joined, 5.0)
    found = len(newcomer.nodes())
    announced.close()
    served.close()
    held = newcomer.joined and found == _NODES
    return Outcome(held, f"joined with {found} of {_NODES} nodes", {"found": found})


def _flood(arena: Arena) -> Outcome:
    """All requests are for everything; only the newest of an asker is worth an answer."""
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    for number in range(_NODES):
        victim.add_node(f"cube_{number}", "cube")
    key = attacker.keys.sync(victim.rid)
    longest = 0.0
    for number in range(_REQUESTS):
        rid = attacker.rid if number % 2 else f"made-up-{number}"
        payload = encode_request(Request(rid, CausalContext(), START, insists=True))
        attacker.transport.request(key, payload, lambda *_: None, lambda: None, 1.0)
        begin = monotonic()
        victim.update_node("cube_0", seen=number)
        longest = max(longest, monotonic() - begin)
    newcomer = arena.join("newcomer")
    joined = arena.eventually(lambda: newcomer.joined and len(newcomer.nodes()) == _NODES, 20.0)
    effect = f"longest write {longest * 1e3:.0f} ms, a newcomer joined: {joined}"
    return Outcome(joined and longest < _LONGEST_WRITE, effect, {"longest_write_s": longest})


ATTACKS = [
    Attack(
        "empty-answers",
        "answers newcomers that it has joined nothing, as one that knows nothing does",
        "newcomers join with everything, from another one",
        _unjoined,
        _GRANTS,
    ),
    Attack(
        "request-flood",
        f"asks for everything {_REQUESTS} times at once, under its own and made-up names",
        "the writes of who is asked go on, and a newcomer joins",
        _flood,
        {},
    ),
]
