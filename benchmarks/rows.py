"""What a benchmark reports: rows with a value, the target it should meet and the peers beside it."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import Literal

import msgspec

Better = Literal["lower", "higher"]


class Spec(msgspec.Struct, frozen=True):
    """A row before it is measured."""

    row: str
    """What is measured; the same text in every run."""
    unit: str
    target: float | None = None
    """In the row's unit; None for a row that only informs."""
    better: Better = "lower"
    about: str = ""
    """How it is measured, and what its peers measure."""
    of_peer: float | None = None
    """Target of the ratio to the first peer. Where that was measured it counts, not `target`: machines differ."""


class Peer(msgspec.Struct, frozen=True):
    """What something else needs, or reaches, for the same work in the same run."""

    name: str
    value: float
    """In the row's unit."""


class Row(msgspec.Struct, frozen=True):
    """A measured row."""

    row: str
    value: float
    unit: str
    target: float | None
    peer: list[Peer] | None
    """The first is the one that `ratio` compares with; None if no peer applies or none is installed."""
    ratio: float | None
    """`value` by that of the first peer."""
    meets: bool | None
    """Whether the target that counts is met; None without any."""
    note: str = ""
    of_peer: float | None = None
    """Target of `ratio`, if that counts."""


def judged(spec: Spec, value: float, peers: Sequence[Peer] = (), note: str = "") -> Row:
    """The row of a value that was measured."""
    ratio = value / peers[0].value if peers and peers[0].value else None
    of_peer = None if ratio is None else spec.of_peer
    meets = _meets(spec, value, spec.target) if of_peer is None else _meets(spec, ratio, of_peer)
    return Row(spec.row, value, spec.unit, spec.target, list(peers) or None, ratio, meets, note, of_peer)


def _meets(spec: Spec, value: float | None, target: float | None) -> bool | None:
    if target is None or value is None:
        return None
    return value <= target if spec.better == "lower" else value >= target


def median_row(spec: Spec, rows: Sequence[Row]) -> Row:
    """One row for several runs: medians, judged again; the note tells the spread."""
    if len(rows) == 1:
        return rows[0]
    values = [row.value for row in rows]
    names = [peer.name for peer in rows[0].peer or ()]
    peers = [
        Peer(name, statistics.median(p.value for row in rows for p in row.peer or () if p.name == name))
        for name in names
    ]
    spread = f"median of {len(rows)} runs, {number(min(values))} to {number(max(values))}"
    return judged(spec, statistics.median(values), peers, "; ".join(filter(None, [rows[-1].note, spread])))


def number(value: float) -> str:
    """A number for people: three digits, thousands apart."""
    if abs(value) >= 1000:
        digits = max(0, len(f"{abs(value):.0f}") - 3)
        return f"{round(value, -digits):,.0f}".replace(",", " ")
    return f"{value:.3g}"
