"""Synchronisation replies that nobody asked for."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.crdt.delta import Delta
from dsr.security.policy import Grant

_NODES = 20
_PATIENCE = 30.0
"""s until what was sent has arrived: processes that have just joined may not hear one another yet."""


def _uninvited(arena: Arena) -> Outcome:
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    for number in range(_NODES):
        victim.add_node(f"cube_{number}", "cube")
    seen = list(victim.replica.graph.store.context.ranges())

    def is_told() -> bool:
        attacker.send(Delta(context=seen, live=frozenset()))
        return attacker.rid in victim.dropped

    told = arena.eventually(is_told, _PATIENCE)
    left = len(victim.nodes("cube"))
    return Outcome(told and left == _NODES, f"{left} of {_NODES} nodes left, sender told: {told}", {"left": left})


ATTACKS = [
    Attack(
        "uninvited-reply",
        "sends a reply that lists nothing as alive, on the key of its deltas",
        "nothing is deleted, and the sender is counted",
        _uninvited,
        {"victim": Grant(("*",), ("*",), ("*",)), "attacker": Grant(("table",))},
    )
]
