"""Nodes and edges that take more than their place: the name of another one, or the time of all who hear of them."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome
from benchmarks.timing import monotonic
from dsr.crdt.delta import Add, Delta
from dsr.security.policy import Grant

_TIMES = 5000
_CHANGES = 20
_LONGEST = 2.0
"""s until others have heard of all that somebody writes; a machine that runs attacks may be busy."""
_PATIENCE = 20.0
"""s"""
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",)),
    "other": Grant(("*",), ("*",), ("*",)),
    "zz_attacker": Grant(("table",), ("on",)),
}


def _hidden_world(arena: Arena) -> Outcome:
    """Of two nodes of one name the type of the later replica id counts: that of `zz_attacker`."""
    victim, attacker = arena.join("victim"), arena.raw("zz_attacker")
    world = victim.create_world("dream")

    def is_told() -> bool:
        attacker.send(Delta(adds=[Add((attacker.rid, 1), ".world.dream", "table")], context=[(attacker.rid, 1, 1)]))
        return attacker.rid in victim.dropped

    told = arena.eventually(is_told, _PATIENCE)
    left = "dream" in [info.name for info in victim.worlds()] and not world.closed
    return Outcome(told and left, f"the world is there: {left}, sender told: {told}", {"left": left})


def _many_times(arena: Arena) -> Outcome:
    """Then everything in it that is bound to be looked at again and again is looked at by everybody."""
    victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("zz_attacker")
    rid, nowhere = attacker.rid, (("nobody-1", 1),)
    adds = [Add((rid, number + 1), "hub", "table") for number in range(_TIMES)]
    first = _TIMES + 1
    edges = [Add((rid, first + n), ("hub", f"n{n}", "on"), "on", ((rid, 1),), nowhere) for n in range(_TIMES)]

    def arrives() -> bool:
        attacker.send(Delta(adds=adds, context=[(rid, 1, _TIMES)]))
        attacker.send(Delta(adds=edges, context=[(rid, first, 2 * _TIMES)]))
        return (rid, 2 * _TIMES) in victim.replica.graph.store.context

    begin = monotonic()
    arrived = arena.eventually(arrives, _PATIENCE)
    for number in range(_CHANGES):
        other.add_node(f"cube_{number}", "cube")
    arena.eventually(lambda: len(victim.nodes("cube")) == _CHANGES, _PATIENCE)
    seconds = monotonic() - begin
    found = len(victim.nodes("cube"))
    held = arrived and found == _CHANGES and seconds < _LONGEST
    return Outcome(held, f"{found} of {_CHANGES} changes of another one came within {seconds:.1f} s", {"s": seconds})


ATTACKS = [
    Attack(
        "hidden-world",
        "makes a table under the name of the entry that lists a world",
        "the world stays, and the sender is counted",
        _hidden_world,
        _GRANTS,
    ),
    Attack(
        "many-times",
        f"makes one node {_TIMES} times, and as many edges to nodes that never come, in two messages",
        "changes of others arrive as before",
        _many_times,
        _GRANTS,
    ),
]
