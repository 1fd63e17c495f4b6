"""Meshes that processes have and ask for: whoever asks gets the right one if anybody who lives has it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from dsr import Memory
from dsr.errors import WireError
from dsr.geometry.exchange import ANSWER_TIMEOUT, SELDOM
from dsr.geometry.mesh import Mesh
from dsr.geometry.messages import Offer, decode_ask, encode_offer

PIECE = 256
"""bytes asked for at once, so that meshes of these histories come in several pieces"""
MOST_TRIANGLES = 60
"""Triangles of a mesh: up to about 1.5 kB, six pieces."""
TIME = SELDOM + 2.0 * ANSWER_TIMEOUT
"""s within which everybody has what is asked for: the longest pause after a failure, and two holders that are dead"""


def a_mesh(choice: int) -> Mesh:
    """A fan of triangles; each number gives another one."""
    count = 1 + choice % MOST_TRIANGLES
    angles = np.arange(count + 1) * 0.1
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.full(count + 1, float(choice))])
    corners = [(0, number, number + 1) for number in range(1, count + 1)]
    return Mesh(np.vstack([[0.0, 0.0, 0.0], rim]), corners)


FALSE = bytes(a_mesh(-1).data)
"""A mesh that nobody has made."""


def lie(key: str, payload: bytes) -> bytes | None:
    """The answer of somebody who claims to have each mesh, and sends another one."""
    try:
        ask = decode_ask(payload)
    except WireError:
        return None
    return encode_offer(Offer(len(FALSE))) if ask.length == 0 else FALSE[ask.offset : ask.offset + ask.length]


class MeshesInSeveral:
    """The meshes of some processes.

    Args:
        memories: gives those that live now.
    """

    def __init__(self, memories: Callable[[], Sequence[Memory]]) -> None:
        self._memories = memories
        self.made: dict[str, Mesh] = {}
        """By hash; somebody may still have it, or nobody."""

    def put(self, memory: Memory, choice: int) -> str:
        """One process has a mesh that may be new; returns its hash."""
        mesh = a_mesh(choice)
        self.made[mesh.hash] = mesh
        return memory.meshes.put(mesh)

    def ask(self, memory: Memory, choice: int) -> None:
        """One process asks for a mesh of any time."""
        if self.made:
            self._is_right(memory, sorted(self.made)[choice % len(self.made)])

    def check_converged(self, wait: Callable[[], None]) -> None:
        """Everybody asks for all that anybody has, and gets it within `TIME`; `wait` lets a moment pass."""
        memories = self._memories()
        had = sorted(hash for hash in self.made if any(memory.meshes.store.get(hash) for memory in memories))
        end = memories[0].clock.monotonic() + TIME
        while lacking := [(memory, hash) for memory in memories for hash in had if not self._is_right(memory, hash)]:
            memory, hash = lacking[0]
            assert memory.clock.monotonic() < end, f"{memory.rid} does not get mesh {hash[:8]}, though somebody has it"
            wait()

    def _is_right(self, memory: Memory, hash: str) -> bool:
        """Whether it is here. Raises `AssertionError` if it is another one."""
        mesh = memory.meshes.get(hash)
        assert mesh is None or mesh == self.made[hash], "another mesh than was asked for"
        return mesh is not None
