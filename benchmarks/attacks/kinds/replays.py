"""Messages that were captured, sent again: later, in another order, when their sender has left."""

from __future__ import annotations

import random
from collections import deque

from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.memory import Memory
from dsr.security.policy import Grant

_NODES = 40
_TIMES = 3
_PATIENCE = 10.0
"""s until what was sent has arrived."""
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",), trusted=True),
    "sender": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",)),
}


def _state(memory: Memory) -> dict[str, object]:
    return {node.name: node.get("seen") for node in memory.nodes()}


def _replay(arena: Arena) -> Outcome:
    """The sender makes nodes, overwrites them and removes every other one; then it leaves."""
    victim, sender, attacker = arena.join("victim"), arena.join("sender"), arena.raw("attacker")
    captured: deque[tuple[str, bytes]] = deque(maxlen=10_000)
    for key in (attacker.keys.delta(), attacker.keys.stream(), attacker.keys.digest()):
        attacker.transport.subscribe(key, lambda key, payload: captured.append((key, payload)))
    arena.wait(0.5)
    names = [f"cube_{number}" for number in range(_NODES)]
    for name in names:
        sender.add_node(name, "cube", seen=0)
    arena.eventually(lambda: len(_state(victim)) == _NODES, _PATIENCE)
    for name in names:
        sender.update_node(name, seen=1)
    for name in names[::2]:
        sender.remove_node(name)
    right: dict[str, object] = dict.fromkeys(names[1::2], 1)
    arrived = arena.eventually(lambda: _state(victim) == right, _PATIENCE)
    sender.close()
    arena.wait(0.5)
    messages = list(captured) * _TIMES
    random.Random(1).shuffle(messages)
    for key, payload in messages:
        own = f"{key.rpartition('/')[0]}/{attacker.rid}"
        attacker.transport.publish(own if arena.secured else key, payload)
    arena.wait(2.0)
    held = arrived and bool(messages) and _state(victim) == right
    victim.update_node(names[1], seen=2)
    held = held and victim.node(names[1])["seen"] == 2
    effect = f"{len(messages)} messages sent again, nothing changed: {held}"
    return Outcome(held, effect, {"messages": len(messages)})


ATTACKS = [
    Attack(
        "replay",
        f"sends all that a member sent {_TIMES} times again, in another order, when it has left",
        "what was removed stays so, what was overwritten too, and writing goes on",
        _replay,
        _GRANTS,
    )
]
