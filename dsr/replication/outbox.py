"""Changes that wait to be sent: in bundles, and bounded however long the network is stuck."""

from __future__ import annotations

from dsr.crdt.context import Dot
from dsr.crdt.delta import Delta, Write, beats

BUNDLE = 500
"""Changes in one message: few enough that a peer merges them without a hiccup."""
MAX_BUNDLES = 64
"""More waiting bundles are made one, with only the winning write of each attribute."""
MAX_WAITING = 200_000
"""Changes that may wait for a congested network; beyond, the synchroniser's repair delivers them."""

_Register = tuple[Dot, str]


class Outbox:
    """Local changes that are not sent yet. Callers serialise the calls."""

    def __init__(self) -> None:
        self.overflowed = 0
        """How often everything was given up because too much waited."""
        self._under_way: tuple[list[Delta], Delta] = ([], Delta())
        """What was taken, until it is `sent`."""
        self._bundles = [Delta()]
        self._samples: dict[_Register, Write] = {}
        self.waits = False
        """Whether anything was added since the last `take`."""

    def add(self, delta: Delta, *, together: bool = False) -> None:
        """Take over a delta of this replica; of stream samples only the newest of each attribute is kept.

        `together` says that it must not travel later than the delta before it.
        """
        self.waits = True
        bundle = self._bundles[-1]
        waiting = bundle.writes
        if len(waiting) + len(bundle.adds) >= BUNDLE and not together:
            bundle = self._next_bundle()
            waiting = bundle.writes
        for write in delta.writes:
            if write.dot is None:
                self._samples[write.owner, write.attribute] = write
            else:
                waiting.append(write)
        if delta.context:
            bundle.extend_context(delta.context)
            if delta.adds or delta.removed:
                bundle.adds += delta.adds
                bundle.removed += delta.removed

    def take(self) -> tuple[list[Delta], Delta]:
        """Bundles of durable changes and the stream samples; what was taken before and not `sent` comes again.

        Ctrl-C at any line loses nothing. What comes twice harms nobody.
        """
        before, samples = self._under_way
        bundles = list(before)
        for bundle in self._bundles:
            if bundle.writes or bundle:
                bundles.append(bundle)
        self._under_way = bundles, Delta(writes=[*samples.writes, *self._samples.values()])
        self._bundles, self._samples, self.waits = [Delta()], {}, False
        return self._under_way

    def sent(self) -> None:
        """Forget what was taken."""
        self._under_way = [], Delta()

    def _next_bundle(self) -> Delta:
        if len(self._bundles) >= MAX_BUNDLES:
            self._conflate()
        self._bundles.append(Delta())
        return self._bundles[-1]

    def _conflate(self) -> None:
        """Make one bundle of all; the dots of the writes that lost count as seen with those that won."""
        whole = Delta()
        winners: dict[_Register, Write] = {}
        for bundle in self._bundles:
            whole.adds += bundle.adds
            whole.removed += bundle.removed
            whole.extend_context(bundle.context)
            for write in bundle.writes:
                known = winners.setdefault((write.owner, write.attribute), write)
                if beats(write, known):
                    winners[write.owner, write.attribute] = write
        whole.writes = list(winners.values())
        self._bundles = [whole]
        if len(whole) > MAX_WAITING:
            self.overflowed += 1
            self._bundles, self._samples = [Delta()], {}
