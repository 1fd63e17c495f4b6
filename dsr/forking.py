"""Guards resources that a forked child must not use: connections, threads and file locks stay with the parent."""

from __future__ import annotations

import os
import weakref
from typing import Protocol


class Abandonable(Protocol):
    """Something of which a forked child gets an unusable copy."""

    def abandon(self) -> None:
        """Make this copy harmless; called in the child, where no other thread runs."""


_owned: weakref.WeakSet[Abandonable] = weakref.WeakSet()


def leave_to_parent(item: Abandonable) -> None:
    """Have `item` abandoned in children that are forked from now on."""
    _owned.add(item)


def _abandon_all() -> None:
    for item in list(_owned):
        item.abandon()


os.register_at_fork(after_in_child=_abandon_all)
