"""Statuses that tell of more than any agent does: whoever looks at all agents and worlds must go on."""

from __future__ import annotations

import time

from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.runtime.activity import WorldUse
from dsr.runtime.status import State, Status, encode_status
from dsr.runtime.topology import TopologyObserver
from dsr.security.policy import Grant

_WORLDS = 20_000
_SMALL = 500
"""Worlds of a status that is short enough to be taken, and longer than honest ones."""
_LONGEST = 1.0
"""s of the processor that a look may take"""
_PATIENCE = 10.0


def _many_worlds(arena: Arena) -> Outcome:
    victim, attacker = arena.join("victim"), arena.raw("attacker")
    observer = TopologyObserver(victim)
    took = 0.0
    for worlds in (_WORLDS, _SMALL):
        uses = [WorldUse(world=f"w{number}", reads=True, writes=True) for number in range(worlds)]
        status = Status(agent="attacker", rid=attacker.rid, pid=1, state=State.READY, worlds=uses, stamp=arena.now())
        attacker.transport.publish(attacker.keys.status("attacker"), encode_status(status))
        arena.wait(0.5)
        begin = time.process_time()
        found = observer.look()
        took = max(took, time.process_time() - begin)
    came = arena.eventually(lambda: len(observer.look().worlds) > _SMALL, _PATIENCE)
    observer.close()
    effect = f"a look took {took:.2f} s of the processor, {len(found.worlds)} worlds are told"
    return Outcome(came and took < _LONGEST and len(found.worlds) < _WORLDS, effect, {"took_s": took})


ATTACKS = [
    Attack(
        "many-worlds",
        f"tells in its status that it uses {_WORLDS} worlds",
        "who looks at all agents and worlds is not held up",
        _many_worlds,
        {"victim": Grant(("*",), ("*",), ("*",), trusted=True), "attacker": Grant(("table",))},
    )
]
