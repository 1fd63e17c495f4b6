"""False liveliness tokens: they must hide nobody and hold nothing up."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.replication.peers import MAX_PEERS
from dsr.security.policy import Grant

_ROUNDS = 20
_TOKENS = 3000
_PATIENCE = 10.0
_GRANTS = {
    "victim": Grant(("*",), ("*",), ("*",), trusted=True), "other": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",)),
}  # fmt: skip


def _withdraw(arena: Arena) -> Outcome:
    victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("attacker")
    arena.eventually(lambda: victim.rid in other.replica.synchroniser.heard, _PATIENCE)
    hidden = 0
    for _ in range(_ROUNDS):
        for agent in ("victim", "attacker"):
            token = attacker.transport.announce(attacker.keys.presence(agent, victim.rid))
            arena.wait(0.05)
            token.close()
        for _ in range(5):
            arena.wait(0.05)
            hidden += victim.rid not in other.peers
    return Outcome(hidden == 0, f"missing in {hidden} of {5 * _ROUNDS} looks", {"hidden": hidden})


def _flood(arena: Arena) -> Outcome:
    victim, other, attacker = arena.join("victim"), arena.join("other"), arena.raw("attacker")
    arena.eventually(lambda: victim.replica.synchroniser.heard and other.replica.synchroniser.heard, _PATIENCE)
    keys = [attacker.keys.presence("attacker", f"attacker-{number}") for number in range(_TOKENS)]
    tokens = [attacker.transport.announce(key) for key in keys]
    arena.wait(1.0)
    there = max(len(memory.peers) for memory in (victim, other))
    victim.add_node("after", "cube")
    begin = arena.now()
    sync = victim.replica.synchroniser
    delivered = arena.eventually(lambda: sync.delivered and "after" in other, _PATIENCE)
    took = arena.now() - begin
    for token in tokens:
        token.close()
    held = delivered and there <= MAX_PEERS and other.rid in victim.peers and victim.rid in other.peers
    return Outcome(held, f"{there} of {_TOKENS} listened to, a write confirmed after {took:.1f} s", {"took_s": took})


ATTACKS = [
    Attack("token-withdrawn", "announces and withdraws another's liveliness token", "nobody forgets the other one",
           _withdraw, _GRANTS),
    Attack("token-flood", f"announces {_TOKENS} replicas that never speak",
           "few are listened to, and nobody waits for them", _flood, _GRANTS),
]  # fmt: skip
