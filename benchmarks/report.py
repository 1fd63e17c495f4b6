"""What a person sees of the rows, before and after they are measured."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from benchmarks.group import Group
from benchmarks.rows import Row, Spec, number
from dsr.cli.common import add_names, add_numbers

_VERDICTS = {True: "[green]yes[/]", False: "[red]no[/]", None: "-"}


def rows_table(rows: Sequence[Row]) -> Table:
    """The measured rows, each with its peers and its note below."""
    table = Table(title="dsr bench", caption="ratio: our value by that of the first peer")
    add_names(table, "row, peers")
    add_numbers(table, "value", "target", "ratio", "meets")
    for row in rows:
        target = f"{number(row.of_peer)} of peer" if row.of_peer else "-" if row.target is None else number(row.target)
        ratio = "-" if row.ratio is None else number(row.ratio)
        table.add_row(_described(row), f"{number(row.value)} {row.unit}", target, ratio, _VERDICTS[row.meets])
    return table


def _described(row: Row) -> str:
    peers = ", ".join(f"{peer.name} {number(peer.value)}" for peer in row.peer or ())
    return "\n".join([escape(row.row), *(f"[dim]{escape(line)}[/]" for line in (peers, row.note) if line)])


def specs_table(chosen: Sequence[tuple[Group, Sequence[Spec]]]) -> Table:
    """The rows that can be measured."""
    table = Table()
    add_names(table, "group", "row, how it is measured")
    add_numbers(table, "target")
    for group, specs in chosen:
        for index, spec in enumerate(specs):
            row = f"{escape(spec.row)}\n[dim]{escape(spec.about)}[/]" if spec.about else escape(spec.row)
            table.add_row("" if index else group.name, row, _target(spec), end_section=spec is specs[-1])
    return table


def _target(spec: Spec) -> str:
    side = "≤" if spec.better == "lower" else "≥"
    if spec.of_peer is not None:
        return f"{side} {number(spec.of_peer)} of the first peer's {spec.unit}"
    return spec.unit if spec.target is None else f"{side} {number(spec.target)} {spec.unit}"
