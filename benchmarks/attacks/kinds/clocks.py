"""Lies about clocks, and clocks that are honestly wrong."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.crdt.context import CausalContext
from dsr.errors import ClockDriftError
from dsr.memory import Memory
from dsr.replication.wire import Digest, encode_digest
from dsr.security.policy import Grant

_ROUNDS, _PERIOD = 20, 0.2
"""Digests of each replica, and the time between two of them, s."""
_REPLICAS = 4
_HOUR = 3600.0
_PATIENCE = 5.0
_ALL = Grant(("*",), ("*",), ("*",))
_GRANTS = {"a": _ALL, "b": _ALL, "c": _ALL, "liar": Grant(("cup",))}


def _say(raw: Raw, replicas: int, now: float, ahead: tuple[str, ...]) -> None:
    """Digests of several replicas of one agent, whose clock says `now`, that see others ahead."""
    for number in range(replicas):
        rid = raw.rid if number == 0 else f"{raw.rid.rpartition('-')[0]}-{number:08x}"
        raw.send_digest(encode_digest(Digest(rid, now, CausalContext().summary(), 0, ahead)), rid)


def _writes(memory: Memory, value: int) -> bool:
    try:
        memory.add_node(f"cube_of_{memory.agent}", "cube", seen=value)
    except ClockDriftError:
        return False
    return True


def _outvoted(arena: Arena) -> Outcome:
    victims = [arena.join(agent) for agent in ("a", "b", "c")]
    liar = arena.raw("liar")
    arena.eventually(lambda: all(len(memory.peers) >= 2 for memory in victims), _PATIENCE)
    done = refused = 0
    for value in range(_ROUNDS):
        _say(liar, _REPLICAS, arena.now(), tuple(memory.rid for memory in victims))
        arena.wait(_PERIOD)
        for memory in victims:
            done += 1
            refused += not _writes(memory, value)
    return Outcome(not refused, f"{refused} of {done} writes refused", {"refused": refused, "writes": done})


def _one_behind(arena: Arena) -> Outcome:
    victim, other = arena.join("a"), arena.raw("liar")
    done = refused = 0
    for value in range(_ROUNDS):
        _say(other, 1, arena.now() - _HOUR, (victim.rid,))
        arena.wait(_PERIOD)
        done += 1
        refused += not _writes(victim, value)
    said = str(victim.clocks)
    return Outcome(
        not refused and "liar" in said and "behind" in said, f"{refused} of {done} writes refused; told: {said}",
        {"refused": refused, "writes": done},
    )  # fmt: skip


ATTACKS = [
    Attack(
        "clock-votes",
        "says as four replicas of one agent that the clocks of three others are ahead",
        "nobody is stopped from writing",
        _outvoted,
        _GRANTS,
    ),
    Attack(
        "clock-of-two",
        "is the only other agent, with a clock that is an hour behind",
        "the one with the right clock goes on writing, and is told who is behind",
        _one_behind,
        _GRANTS,
    ),
]
