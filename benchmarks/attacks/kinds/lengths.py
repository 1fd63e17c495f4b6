"""Content that is cheap to send, and would be too long to hand on, or long to look at for all who hold it."""

from __future__ import annotations

import time
from collections.abc import Callable

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.crdt.delta import MAX_ENDS, Add, Delta, Write
from dsr.math3d.transforms import Pose
from dsr.memory import Memory
from dsr.security.policy import Grant

_AT_ONCE = 400
"""Nodes of long names in one message."""
_NAMED = 1600
_LONG = 252 * chr(0x1F600)
"""A name of a thousand bytes."""
_EDGES, _IN_ONE = 1000, 200
_CHANGES = 60
_CHAIN = 8000
_MOST_TAKEN, _MOST_COST = 20.0, 0.4
"""s of the processor, of all that take part: to take in what the attacker sends, and more for changes of others."""
_PATIENCE = 30.0
"""s"""
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",), trusted=True),
    "other": Grant(("*",), ("*",), ("*",)),
    "late": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",), ("on", "RT"), ("pose",)),
}


def _long_names(arena: Arena) -> Outcome:
    """An answer counts each of them for a hundred bytes, and nobody takes a message of more than a megabyte."""
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    victim.add_node("before", "cube")

    def arrives() -> bool:
        for first in range(0, _NAMED, _AT_ONCE):
            adds = [Add((attacker.rid, first + n + 1), f"{first + n:04}{_LONG}", "table") for n in range(_AT_ONCE)]
            attacker.send(Delta(adds, context=[(attacker.rid, first + 1, first + _AT_ONCE)]))
        return len(victim.nodes("table")) == _NAMED

    arrived = arena.eventually(arrives, _PATIENCE)
    late = arena.join("late")
    joined = arena.eventually(lambda: late.joined and "before" in late, _PATIENCE)
    equal = joined and len(late.nodes("table")) == _NAMED
    return Outcome(arrived and equal, f"a newcomer joined: {joined}, with everything: {equal}", {"joined": joined})


def _many_ends(arena: Arena) -> Outcome:
    ends = tuple(("nobody-1", number + 1) for number in range(100)) * (MAX_ENDS // 100)

    def send(attacker: Raw) -> None:
        for first in range(0, _EDGES, _IN_ONE):
            dots = [(attacker.rid, first + number + 1) for number in range(_IN_ONE)]
            adds = [Add(dot, ("a", f"b{dot[1]}", "on"), "on", ends, ends) for dot in dots]
            attacker.send(Delta(adds, context=[(attacker.rid, first + 1, first + _IN_ONE)]))

    return _while_others_write(arena, send, _EDGES)


def _frame_chain(arena: Arena) -> Outcome:
    def send(attacker: Raw) -> None:
        rid, edges, writes = attacker.rid, [], []
        nodes = [Add((rid, number + 1), f"n{number}", "table") for number in range(_CHAIN)]
        attacker.send(Delta(nodes, context=[(rid, 1, _CHAIN)]))
        for number in range(1, _CHAIN):
            dot, key = (rid, _CHAIN + 2 * number), (f"n{number - 1}", f"n{number}", "RT")
            edges.append(Add(dot, key, "RT", ((rid, number),), ((rid, number + 1),)))
            writes.append(Write(dot, "pose", 1, rid, (rid, dot[1] + 1), Pose((1, 0, 0))))
        attacker.send(Delta(edges, writes, context=[(rid, _CHAIN + 1, 3 * _CHAIN)]))

    return _while_others_write(arena, send, 2 * _CHAIN)


def _while_others_write(arena: Arena, send: Callable[[Raw], None], count: int) -> Outcome:
    """What it costs to take what the attacker sends, and changes of another one after that."""
    victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("attacker")
    victim.add_node("world", "world")
    victim.add_node("box", "cube")
    victim.add_edge("world", "box", "RT", pose=Pose())
    victim.transform("world", "box")
    usual = _cost_of_changes(arena, victim, other, "ball")
    store = victim.replica.graph.store
    before = len(store.entries)

    def arrives() -> bool:
        if not store.context.knows(attacker.rid):
            send(attacker)
        return len(store.entries) >= before + count - 1

    begin = time.process_time()
    arrived = arena.eventually(arrives, _PATIENCE)
    taken = time.process_time() - begin
    arena.wait(1.0)  # until all have it
    more = _cost_of_changes(arena, victim, other, "robot") - usual
    found = len(victim.nodes("robot"))
    held = arrived and found == _CHANGES and taken < _MOST_TAKEN and more < _MOST_COST
    effect = f"took {taken:.1f} s of the processor, then {found} of {_CHANGES} changes of another one {more:.1f} s more"
    return Outcome(held, effect, {"taken_s": taken, "changes_s": more})


def _cost_of_changes(arena: Arena, victim: Memory, other: Memory, type: str) -> float:
    """Processor time (s) until changes have come, one after the other."""
    begin = time.process_time()
    for number in range(1, _CHANGES + 1):
        other.add_node(f"{type}_{number}", type)
        arena.eventually(_has(victim, type, number), _PATIENCE)
    return time.process_time() - begin


def _has(memory: Memory, type: str, count: int) -> Callable[[], bool]:
    return lambda: len(memory.nodes(type)) == count


ATTACKS = [
    Attack(
        "long-names",
        f"makes {_NAMED} nodes with names of a thousand bytes",
        "who comes later joins, with everything",
        _long_names,
        _GRANTS,
    ),
    Attack(
        "many-ends",
        f"makes {_EDGES} edges that name {MAX_ENDS} ends each, which never come, on both sides",
        "changes of others arrive as before",
        _many_ends,
        _GRANTS,
    ),
    Attack(
        "frame-chain",
        f"hangs {_CHAIN} frames from one another",
        "changes of others arrive as before",
        _frame_chain,
        _GRANTS,
    ),
]
