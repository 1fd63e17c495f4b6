"""Forged stamps: one that no clock has reached yet, and the greatest one that the format takes."""

from __future__ import annotations

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.crdt.context import Dot
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.hlc import MAX_STAMP, physical_time
from dsr.memory import Memory
from dsr.security.policy import Grant

_FIRST, _SECOND = 50, 1000
"""Writes of the two victims, one after the other."""
_PATIENCE = 10.0
"""s until what was written has reached all."""
_HORIZON = 1 << 62
_DAY = 86_400.0

_VICTIM = Grant(("cube", "table"), ("on",), ("seen", "mass"))
_GRANTS = {"a": _VICTIM, "b": _VICTIM, "forger": Grant(("cup",), (), ("seen",))}
_MEDDLER = {**_GRANTS, "forger": Grant(("cube",), (), ("seen",))}


def _forge(raw: Raw, owner: Dot, stamp: int, counter: int, *adds: Add) -> None:
    write = Write(owner, "seen", stamp, raw.rid, (raw.rid, counter), -1)
    raw.send(Delta(adds=list(adds), writes=[write], context=[(raw.rid, 1, counter)]))


def _ahead(memory: Memory, name: str, now: float) -> float:
    """How far ahead the newest write of `seen` is stamped, days."""
    write = memory.node(name).newest_write("seen")
    return 0.0 if write is None else max(0.0, physical_time(write.stamp) - now) / _DAY


def _write_in_turn(arena: Arena, a: Memory, b: Memory) -> tuple[int, int]:
    """A writes, B sees it and writes; what A and B read in the end, which should be `_FIRST + _SECOND`."""
    for value in range(1, _FIRST + 1):
        a.update_node("cube", seen=value)
    arena.eventually(lambda: b.node("cube").get("seen") == _FIRST, _PATIENCE)
    for value in range(_FIRST + 1, _FIRST + _SECOND + 1):
        b.update_node("cube", seen=value)
    arena.eventually(lambda: a.node("cube").get("seen") == _FIRST + _SECOND, _PATIENCE)
    return a.node("cube").get("seen", 0), b.node("cube").get("seen", 0)


def _elsewhere(arena: Arena) -> Outcome:
    a, b, forger = arena.join("a"), arena.join("b"), arena.raw("forger")
    a.add_node("cube", "cube", seen=0)
    _forge(forger, (forger.rid, 1), _HORIZON, 2, Add((forger.rid, 1), "cup", "cup"))
    arrived = arena.eventually(lambda: "cup" in a and "cup" in b and "cube" in b, _PATIENCE)
    read = _write_in_turn(arena, a, b)
    ahead = max(_ahead(memory, "cube", arena.now()) for memory in (a, b))
    told = all("forger" in memory.far_stamped for memory in (a, b))
    right = read == (_FIRST + _SECOND,) * 2
    return Outcome(
        arrived and right and told and ahead < 1.0,
        f"read {read[0]} and {read[1]} of {_FIRST + _SECOND}, stamps {ahead:.0f} days ahead, forger told: {told}",
        {"a": read[0], "b": read[1], "days_ahead": ahead},
    )


def _greatest(arena: Arena) -> Outcome:
    a, b, forger = arena.join("a"), arena.join("b"), arena.raw("forger")
    a.add_node("table", "table", seen=1)
    a.add_node("cube", "cube", seen=0, mass=0.5)
    a.add_edge("cube", "table", "on")
    arena.eventually(lambda: "cube" in b, _PATIENCE)
    _forge(forger, a.node("cube").created[0], MAX_STAMP, 1)
    arrived = arena.eventually(lambda: a.node("cube")["seen"] == b.node("cube")["seen"] == -1, _PATIENCE)
    read = _write_in_turn(arena, a, b)
    whole = all(memory.get_edge("cube", "table", "on") and memory.node("cube")["mass"] == 0.5 for memory in (a, b))
    told = all("forger" in memory.far_stamped for memory in (a, b))
    return Outcome(
        arrived and whole and told and read == (_FIRST + _SECOND,) * 2,
        f"read {read[0]} and {read[1]} of {_FIRST + _SECOND}, the rest of it kept: {whole}, forger told: {told}",
        {"a": read[0], "b": read[1]},
    )


def _cleaned(arena: Arena) -> Outcome:
    a, b, forger = arena.join("a"), arena.join("b"), arena.raw("forger")
    names = [f"cube_{number}" for number in range(20)]
    for name in names:
        a.add_node(name, "cube", seen=0)
    arena.eventually(lambda: all(name in b for name in names), _PATIENCE)
    for number, name in enumerate(names):
        _forge(forger, a.node(name).created[0], _HORIZON + number, number + 1)
    poisoned = arena.eventually(lambda: len(a.far_stamps()) == len(b.far_stamps()) == len(names), _PATIENCE)
    a.clean_stamps()
    clean = arena.eventually(lambda: not a.far_stamps() and not b.far_stamps(), _PATIENCE)
    b.update_node(names[0], seen=7)
    right = arena.eventually(lambda: a.node(names[0])["seen"] == 7, _PATIENCE)
    ahead = max((_ahead(memory, name, arena.now()) for memory in (a, b) for name in names), default=0.0)
    return Outcome(
        poisoned and clean and right and ahead < 1.0,
        f"{len(names)} values forged, {len(a.far_stamps())} left, stamps {ahead:.0f} days ahead",
        {"forged": len(names), "left": len(a.far_stamps()), "days_ahead": ahead},
    )


ATTACKS = [
    Attack(
        "stamp-elsewhere",
        "stamps a value of its own node with the year 2112",
        "of others' values the last one written wins, clocks stay, and the forger is told",
        _elsewhere,
        _GRANTS,
    ),
    Attack(
        "stamp-greatest",
        "stamps the victims' value with the greatest stamp of the format",
        "the next write wins everywhere, nothing else is lost, and the forger is told",
        _greatest,
        _MEDDLER,
    ),
    Attack(
        "stamp-cleaned",
        "stamps the values of twenty nodes with the year 2112",
        "one call makes the graph clean, without a restart",
        _cleaned,
        _MEDDLER,
    ),
]
