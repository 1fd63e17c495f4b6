"""What security costs: the latency of single updates at 100 Hz, with TLS and all checks and without, by turns.

    python -m benchmarks.security

Two processes each, 1000 nodes x 5 attributes, from before the call that writes until a read in the other process.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import tempfile
from pathlib import Path
from typing import Literal

from benchmarks.links import Closable, DsrLink, Received, Sender
from benchmarks.pairs import Latencies
from benchmarks.timing import percentile
from dsr.clock import WALL_CLOCK
from dsr.connecting import SECURITY
from dsr.security.authority import SecurityFolder
from dsr.security.policy import Grant, checked, write_policy

_ROUNDS, _BURST, _WARM_UP = 8, 200, 20
_KINDS: tuple[Literal["attribute", "RT"], ...] = ("attribute", "RT")


class SecuredLink(DsrLink, frozen=True):
    """The same over a secured graph."""

    folder: str = ""
    """The security folder; none: no security."""

    def writer(self) -> Sender:
        """See `DsrLink`; in a process of its own."""
        os.environ[SECURITY] = self.folder
        return super().writer()

    def reader(self, received: Received) -> Closable:
        """See `DsrLink`; in a process of its own."""
        os.environ[SECURITY] = self.folder
        return super().reader(received)


def main() -> None:
    """Measure and print."""
    with contextlib.ExitStack() as stack:
        folder = make_folder(Path(stack.enter_context(tempfile.TemporaryDirectory())) / "keys")
        links = {
            (kind, secured): SecuredLink(f"security-{kind}-{secured}", kind, folder=str(folder) if secured else "")
            for kind in _KINDS
            for secured in (False, True)
        }
        pairs = {name: stack.enter_context(Latencies(link)) for name, link in links.items()}
        samples: dict[tuple[str, bool], list[float]] = {name: [] for name in links}
        for pair in pairs.values():
            pair.burst(_WARM_UP)
        for _ in range(_ROUNDS):
            for name, pair in pairs.items():
                samples[name] += [seconds * 1e3 for seconds in pair.burst(_BURST)]
    for kind in _KINDS:
        for secured in (False, True):
            print(f"{kind:9}  {'secured' if secured else 'open':7}  {_line(samples[kind, secured])}")


def _line(times: list[float]) -> str:
    p99 = percentile(times, 0.99)
    return f"p50 {statistics.median(times):.3f} ms  p99 {p99:.3f} ms  ({len(times)} samples)"


def make_folder(path: Path) -> Path:
    """Certificates for a writer and a reader that may write everything."""
    everything = Grant(("*",), ("*",), ("*",))
    policy = checked({"writer": everything, "reader": everything})
    folder = SecurityFolder(path)
    folder.create(WALL_CLOCK.now())
    for name in policy.agents:
        folder.issue(name, WALL_CLOCK.now())
    write_policy(folder.policy, policy)
    return path


if __name__ == "__main__":
    main()
