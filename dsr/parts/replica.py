"""The replica of a base of which parts are held: it takes the replicas of those along."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from dsr.crdt.delta import Delta
from dsr.crdt.pieces import Piece
from dsr.network.keys import WHOLE
from dsr.replication.portions import parts_in, portion
from dsr.replication.replica import Replica
from dsr.replication.statistics import Statistics


class PartedReplica(Replica):
    """The replica of the base; what is written here goes out with that of its part."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.parts: dict[str, Replica] = {}
        """Replicas of the parts that are held, by name."""
        self._touched: dict[str, None] = {}

    def commit(self, delta: Delta) -> None:
        """See `Replica.commit`; each portion goes to the replica of its part."""
        for part in parts_in(delta):
            if part == WHOLE:
                super().commit(portion(delta, WHOLE))
            elif part in self.parts:
                self.parts[part].commit(portion(delta, part))
                self._touched[part] = None

    def send_soon(self) -> None:
        """See `Replica.send_soon`."""
        super().send_soon()
        while self._touched:
            with contextlib.suppress(KeyError):  # another thread has taken the last one
                part, _ = self._touched.popitem()
                if part in self.parts:
                    self.parts[part].send_soon()

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """See `Replica.hold`; what is in one part goes together."""
        with contextlib.ExitStack() as held:
            held.enter_context(super().hold())
            for replica in self.parts.values():
                held.enter_context(replica.hold())
            yield

    def _pieces(self) -> Iterator[Piece]:
        yield from super()._pieces()
        for replica in self.parts.values():
            yield from replica._pieces()

    @property
    def statistics(self) -> Statistics:
        """See `Replica.statistics`; of all parts together. Far stamps are noticed once for all."""
        parts = [replica.statistics._replace(far_stamps=0) for replica in self.parts.values()]
        return Statistics(*map(sum, zip(super().statistics, *parts, strict=True)))
