"""Messages that are small to send and would be large to read."""

from __future__ import annotations

import struct

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from benchmarks.timing import monotonic
from dsr.security.policy import Grant

_BYTES = 30_000_000
_PATIENCE = 20.0
"""s until what was sent has arrived."""
_LONGEST_WRITE = 1.0
"""s that the victim's own writes may take meanwhile; a machine that runs attacks may be busy."""
_GRANTS = {"victim": Grant(("*",), ("*",), ("*",)), "attacker": Grant(("table",))}


def _array(count: int, element: bytes) -> bytes:
    return b"\xdd" + struct.pack(">I", count) + count * element


def _with_value(value: bytes) -> bytes:
    """A delta of one write, of replica `a`, with this MessagePack as its value."""
    return b"\x97\x01\x91\xa1a\x90\x91\x98\x00\x01\xa4note\x01\x00\x00\x00" + value + b"\x90\x90\xc0"


def _with_key(key: bytes) -> bytes:
    """A delta of one addition under this MessagePack."""
    return b"\x97\x01\x91\xa1a\x91\x96\x00\x01" + key + b"\xa4cube\x90\x90\x90\x90\x90\xc0"


def _bomb(arena: Arena) -> Outcome:
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    victim.add_node("x", "cube")
    short = _BYTES // 60
    bombs = [
        _with_value(_array(_BYTES, b"\x90")),
        _with_value(_array(short, b"\x90")),
        _with_value(short * b"\x91" + b"\xc0"),
        _with_value(_array(short, b"\x01")),
        _with_key(_array(short, b"\x90")),
    ]
    for payload in bombs:
        _publish(attacker, payload)
    longest, end = 0.0, arena.now() + _PATIENCE
    while arena.now() < end and victim.dropped.get(attacker.rid, 0) < len(bombs):
        begin = monotonic()
        victim.update_node("x", seen=1)
        longest = max(longest, monotonic() - begin)
        arena.wait(0.01)
    told = victim.dropped.get(attacker.rid, 0)
    held = told == len(bombs) and longest < _LONGEST_WRITE
    effect = f"{told} of {len(bombs)} refused, longest write {longest * 1e3:.0f} ms"
    return Outcome(held, effect, {"refused": told, "longest_write_s": longest})


def _publish(attacker: Raw, payload: bytes) -> None:
    attacker.transport.publish(attacker.keys.delta(attacker.rid), payload)


ATTACKS = [
    Attack(
        "bombs",
        "sends 30 MB of empty arrays as a value, nested arrays, and arrays as a node's name",
        "each is refused and counted, and the victim's own writes go on",
        _bomb,
        _GRANTS,
    )
]
