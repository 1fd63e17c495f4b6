"""False claims about meshes: to have one, where its bytes are, and that somebody wants one kept."""

from __future__ import annotations

import fcntl
import os
import secrets
import threading
import weakref
from collections.abc import Callable

from benchmarks.attacks.attack import Arena, Attack, Outcome, Raw
from dsr.clock import WALL_CLOCK
from dsr.geometry import Mesh
from dsr.geometry.mesh import MOST_BYTES
from dsr.geometry.messages import AskForMesh, Offer, decode_ask, encode_ask, encode_offer
from dsr.geometry.shared import SharedPlace
from dsr.memory import new_rid
from dsr.network.zenoh_transport import ZenohTransport
from dsr.security.policy import Grant

_PATIENCE = 20.0
"""s for a mesh that comes in 0.1 s otherwise; a machine that runs attacks may be busy."""
_CLAIMS = 40
_HESITATION = 4.0
"""s, less than the asker waits for."""
_KEEPS = 3000
_LIE = 1 << 32
"""Bytes that a place is said to have."""
_GRANTS = {
    "holder": Grant(("*",), ("*",), ("*",)),
    "victim": Grant(("*",), ("*",), ("*",)),
    "attacker": Grant(("table",)),
}


def _attacked(prepare: Callable[[Arena, Raw, str], None]) -> Callable[[Arena], Outcome]:
    """A run in which the victim wants a new mesh after `prepare(arena, attacker, victim's rid)`."""

    def run(arena: Arena) -> Outcome:
        victim, holder, attacker = arena.join("victim"), arena.join("holder"), arena.raw("attacker")
        for memory in (victim, holder):
            memory.meshes.store.disk = None  # which all processes of a user share
        prepare(arena, attacker, victim.rid)
        arena.wait(0.5)
        height = float(secrets.randbelow(1 << 20))
        mesh = Mesh([(0, 0, height), (1, 0, height), (0, 1, height)], [(0, 1, 2)])
        holder.meshes.put(mesh)
        begin = arena.now()
        came = arena.eventually(lambda: victim.get_mesh(mesh.hash) is not None, _PATIENCE)
        seconds, believed = arena.now() - begin, victim.meshes.statistics.mismatched
        effect = f"the mesh came: {came}, after {seconds:.1f} s, false bytes read from {believed} sources"
        return Outcome(came and not believed, effect, {"seconds": seconds, "believed": believed})

    return run


def _claim(arena: Arena, attacker: Raw, victim: str) -> None:
    """Forty replicas offer the largest mesh, and take their time with its pieces."""
    over = threading.Event()
    weakref.finalize(arena, over.set)
    hesitation = _HESITATION if isinstance(attacker.transport, ZenohTransport) else 0.0  # in memory, None is silence

    def offer(_: str, payload: bytes) -> bytes | None:
        if decode_ask(payload).length == 0:
            return encode_offer(Offer(MOST_BYTES))
        WALL_CLOCK.wait(over, hesitation)
        return None

    for _ in range(_CLAIMS):
        attacker.transport.serve(attacker.keys.mesh(new_rid("attacker")), offer)


def _misplace(arena: Arena, attacker: Raw, victim: str) -> None:
    """A file without content, 4 GiB long, stands for a mesh."""
    descriptor = os.memfd_create("dsr-blob", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    weakref.finalize(arena, os.close, descriptor)
    os.ftruncate(descriptor, _LIE)
    seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SEAL
    fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
    payload = encode_offer(Offer(100, SharedPlace(os.getpid(), descriptor, _LIE)))
    attacker.transport.serve(attacker.keys.mesh(attacker.rid), lambda *_: payload)


def _have_kept(arena: Arena, attacker: Raw, victim: str) -> None:
    """The victim is asked to get thousands of meshes that nobody has."""
    for _ in range(_KEEPS):
        payload = encode_ask(AskForMesh(secrets.token_hex(32), keep=True))
        attacker.transport.request(attacker.keys.mesh(victim), payload, lambda *_: None, lambda: None, 0.5)


ATTACKS = [
    Attack(
        "mesh-claims",
        f"offers each mesh {_CLAIMS} times, as large as meshes may be, and sends nothing of it",
        "the mesh comes from the one who has it",
        _attacked(_claim),
        _GRANTS,
    ),
    Attack(
        "mesh-place",
        "says that a mesh lies in shared memory of 4 GiB",
        "that is not read, and the mesh comes from the one who has it",
        _attacked(_misplace),
        _GRANTS,
    ),
    Attack(
        "mesh-keep",
        f"has the victim get {_KEEPS} meshes that nobody has",
        "what the victim wants itself comes first",
        _attacked(_have_kept),
        _GRANTS,
    ),
]
