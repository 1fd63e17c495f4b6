"""Waits for those who hold the content of a world or a part that a process begins to hold."""

from __future__ import annotations

from collections.abc import Callable

from dsr.replication.replica import Replica

HOLDER_PATIENCE = 1.0
"""s to wait for a sign of anybody who holds it."""
_ROUNDS = 3
"""Exchanges that it takes where nothing moves by itself: who is there, request and reply, merge."""


def gathered(
    replica: Replica, move: Callable[[], None] | None, timeout: float, patience: float = HOLDER_PATIENCE
) -> bool:
    """Whether all content is here, or comes by further polls.

    Args:
        replica: that has just begun.
        move: lets messages arrive and be merged; None if threads do.
        timeout: s without anything of the content, after which nothing more is waited for.
        patience: s to wait, still, for a sign of anybody.
    """
    sync = replica.synchroniser
    if move is None:
        sync.joining.others_possible = True
        replica.wait_until(lambda: sync.joined, min(timeout, patience))
        joined = replica.wait_for_pieces(lambda: sync.joined, 0.0 if sync.joining.insists else timeout)
    else:
        came = -1
        while came < sync.pieces:
            came = sync.pieces
            for _ in range(_ROUNDS):
                move()
        joined = sync.joined
    if joined or (sync.peers and move is not None):
        return True
    if sync.joining.nobody_has_more:  # whoever holds it gave all, though nobody there may speak for others
        sync.nobody_there()
        return True
    return False
