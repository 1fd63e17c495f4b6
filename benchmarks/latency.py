"""Latency of single updates at 100 Hz, between two processes, beside raw Zenoh, raw TCP and ZeroMQ.

From before the call that writes until a read in the other process gives the value. Each transport has two processes
of its own; they take turns in short bursts, so that what disturbs the machine disturbs all of them. All messages have
the size of ours, and Zenoh's our quality of service. The peers are done when the bytes are in a callback or in the
reading thread.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.links import DsrLink, Link
from benchmarks.pairs import Latencies
from benchmarks.peers.tcp_link import TcpLink
from benchmarks.peers.zenoh_link import ZenohLink
from benchmarks.ports import reserved_endpoint, reserved_port
from benchmarks.rows import Peer, Spec
from benchmarks.timing import percentile

_BETWEEN = "update between two processes, 100 Hz, one way, written to readable"
_BUSY = "the same while the reader's main thread is busy in Python"
_ATTRIBUTE, _RT, _WATCH = "attribute", "RT", "attribute, by a watch"
ZENOH = "raw Zenoh"
_ABOUT = "1000 nodes x 5 attributes; peers: as many bytes, until the reader's callback or thread has them"


class _Specs(NamedTuple):
    p50: Spec
    p99: Spec
    p50_ratio: Spec
    p99_ratio: Spec
    busy: Spec


def _specs(kind: str, busy: float | None) -> _Specs:
    """`busy` is the target of the p99 of a busy reader over that of a busy reader of raw Zenoh."""
    return _Specs(
        Spec(f"{kind} {_BETWEEN}, p50", "ms", 0.5, about=_ABOUT),
        Spec(f"{kind} {_BETWEEN}, p99", "ms", 3.0, about=_ABOUT),
        Spec(f"{kind} {_BETWEEN}, p50 over raw Zenoh", "x", 1.3, about=_ABOUT),
        Spec(f"{kind} {_BETWEEN}, p99 over raw Zenoh", "x", 3.0, about=_ABOUT),
        Spec(f"{_BUSY}, {kind}, p99", "ms", 3.0, about="the peers' readers are busy too", of_peer=busy),
    )


SPECS = {kind: _specs(kind, busy) for kind, busy in ((_ATTRIBUTE, None), (_RT, 0.3))}
_Samples = dict[str, list[float]]
"""ms, by link."""


def measure(run: Run) -> None:
    """Measure all links quietly, then with busy readers."""
    with contextlib.ExitStack() as stack:
        pairs: dict[str, Latencies] = {}
        for name, link in _links(run):
            run.step(f"latency: starting {name}")
            pairs[name] = stack.enter_context(Latencies(link))
        quiet = _take_turns(run, pairs, busy=False)
        busy = _take_turns(run, pairs, busy=True)
    for kind, specs in SPECS.items():
        _report(run, specs, kind, quiet, busy)
    run.curve("latency", {"quiet": quiet, "busy": busy})


def _links(run: Run) -> Iterator[tuple[str, Link]]:
    attribute, rt = workload.message_size(rt=False), workload.message_size(rt=True)
    yield _ATTRIBUTE, DsrLink("latency-attribute", "attribute")
    yield _RT, DsrLink("latency-rt", "RT")
    yield _WATCH, DsrLink("latency-watch", "attribute", watched=True)
    yield _peer(ZENOH, _ATTRIBUTE), ZenohLink(reserved_endpoint(), attribute)
    yield _peer(ZENOH, _RT), ZenohLink(reserved_endpoint(), rt, reliable=False)
    yield "raw TCP", TcpLink(reserved_port(), attribute)
    if run.has("zmq"):
        from benchmarks.peers.zmq_link import ZmqLink

        yield "ZeroMQ", ZmqLink(reserved_port(), attribute)


def _peer(name: str, kind: str) -> str:
    return f"{name}, {kind}"


def _take_turns(run: Run, pairs: dict[str, Latencies], *, busy: bool) -> _Samples:
    rounds, count = run.pick(8, 2), run.pick(200, 100)
    samples: _Samples = {name: [] for name in pairs}
    for name, pair in pairs.items():
        run.step(f"latency: warming up {name}")
        pair.warm_up()
    for number in range(rounds):
        for name, pair in pairs.items():
            run.step(f"latency: {name}{', reader busy' if busy else ''}, round {number + 1} of {rounds}")
            samples[name] += [seconds * 1e3 for seconds in pair.burst(count, busy=busy)]
    return samples


def _report(run: Run, specs: _Specs, kind: str, quiet: _Samples, busy: _Samples) -> None:
    names = {_peer(ZENOH, kind): ZENOH, "raw TCP": "raw TCP", "ZeroMQ": "ZeroMQ"}

    def peers(samples: _Samples, share: float) -> list[Peer]:
        return [Peer(label, percentile(samples[name], share)) for name, label in names.items() if name in samples]

    note = f"{len(quiet[kind])} samples"
    for spec, ratio_spec, share in ((specs.p50, specs.p50_ratio, 0.5), (specs.p99, specs.p99_ratio, 0.99)):
        value, others = percentile(quiet[kind], share), peers(quiet, share)
        watch = f"; an iterating watch has it after {percentile(quiet[_WATCH], share):.2f} ms"
        run.row(spec, value, others, note + (watch if kind == _ATTRIBUTE else ""))
        base = others[0].value
        run.row(ratio_spec, value / base, [Peer(peer.name, peer.value / base) for peer in others])
    run.row(specs.busy, percentile(busy[kind], 0.99), peers(busy, 0.99), f"p50 {percentile(busy[kind], 0.5):.2f} ms")


GROUP = Group("latency", [spec for specs in SPECS.values() for spec in specs], measure)
