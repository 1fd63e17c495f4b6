"""Orders to arms with times that nobody has."""

from __future__ import annotations

import logging

from agents.arm_controller.safety.halting import EmergencyStop
from benchmarks.attacks.attack import Arena, Attack, Outcome
from dsr.errors import DsrError
from dsr.memory import Memory
from dsr.security.policy import Grant
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE, HaltOrder, order_about, send_order, write_order

_ARM = "left"
_NO_TIME = 1e300
_FUTURE = 1e12
_PATIENCE = 5.0
_ORDERS = Grant((HALT_NODE,), (), HALT_ATTRIBUTES, ("device/halt",))
_GRANTS = {"arm": _ORDERS, "person": _ORDERS, "liar": _ORDERS}


def _stop(memory: Memory) -> EmergencyStop:
    """The part of an arm's controller that obeys orders."""
    log = logging.getLogger("benchmarks.attacks.orders")
    return EmergencyStop(memory, memory.transport, memory.keys, memory.agent, log, _ARM)


def _at_no_time(arena: Arena) -> Outcome:
    memory, liar = arena.join("arm"), arena.raw("liar")
    stop, failed = _stop(memory), 0

    def is_kept() -> bool:
        nonlocal failed
        send_order(liar.transport, liar.keys, HaltOrder("1", True, "liar", "", _NO_TIME))
        try:
            stop.tick(False)
        except DsrError:
            failed += 1
        return order_about(memory, _ARM) is not None

    kept = arena.eventually(is_kept, _PATIENCE)
    again = _stop(memory)
    stop.close()
    again.close()
    held = kept and not failed and bool(stop.reason and again.reason)
    return Outcome(held, f"{failed} failures; halted after a restart: {bool(again.reason)}", {"failures": failed})


def _release_to_come(arena: Arena) -> Outcome:
    person, liar = arena.join("person"), arena.join("liar")
    arm = arena.join("arm")
    liar.add_node(f"halt_{_ARM}", HALT_NODE, halted=False, halt_id="1", source="liar", since=_FUTURE, arm=_ARM)
    arena.eventually(lambda: f"halt_{_ARM}" in arm, _PATIENCE)
    write_order(person, HaltOrder("2", True, "person", "a hand", arena.now()))
    arena.eventually(lambda: HALT_NODE in arm, _PATIENCE)
    stop = _stop(arm)
    stop.close()
    return Outcome(bool(stop.reason), f"a controller that starts then is told: {stop.reason or 'nothing'}")


ATTACKS = [
    Attack(
        "halt-no-time",
        "orders an emergency stop that is stamped with 1e300 s",
        "the arm stops, its controller does not fail, and a restarted one knows of the stop",
        _at_no_time,
        _GRANTS,
    ),
    Attack(
        "halt-release-to-come",
        "releases an arm in the graph with a time to come, before a person halts all arms",
        "a controller that starts after that does not move",
        _release_to_come,
        _GRANTS,
    ),
]
