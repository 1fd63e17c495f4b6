"""Attacks on working memories over Zenoh on the loopback interface: a row each, held or broken, with the effect.

    python -m benchmarks.attacks [NAME...] --json attacks.json

Exit 0 only if all held. Without names, all attacks run, each in an open graph, a secured one, or both.
"""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.attacks.arenas import zenoh_arena
from benchmarks.attacks.attack import Attack, Outcome
from benchmarks.attacks.registry import attacks
from dsr.clock import WALL_CLOCK


@dataclass(frozen=True)
class Row:
    """One attack in one graph."""

    attack: str
    graph: str
    """`open` or `secured`."""
    outcome: Outcome
    seconds: float
    """That it took, with the start of the memories."""


def main() -> None:
    """Attack as the command line asks; exit 1 if something did not hold."""
    known = attacks()
    options = _parser(known.values()).parse_args()
    unknown = [name for name in options.names if name not in known]
    if unknown:
        raise SystemExit(f"no attack {', '.join(unknown)}; there are: {', '.join(known)}")
    logging.getLogger("dsr").addHandler(logging.NullHandler())  # what the victims say is not the result
    rows = [
        _run(attack, graph)
        for attack in (known[name] for name in options.names or known)
        for graph in attack.settings
    ]
    Console().print(_table(rows))
    if options.json:
        content = [{**asdict(row), "holds": known[row.attack].holds} for row in rows]
        options.json.write_text(json.dumps({"rows": content}, indent=1), encoding="utf-8")
    raise SystemExit(0 if all(row.outcome.held for row in rows) else 1)


def _run(attack: Attack, graph: str) -> Row:
    begin = WALL_CLOCK.monotonic()
    with zenoh_arena(attack.grants if graph == "secured" else None) as arena:
        outcome = attack.run(arena)
    return Row(attack.name, graph, outcome, WALL_CLOCK.monotonic() - begin)


def _parser(known: Iterable[Attack]) -> argparse.ArgumentParser:
    names = "\n".join(f"  {attack.name}: {attack.sentence}" for attack in known)
    parser = argparse.ArgumentParser(
        "python -m benchmarks.attacks",
        description=(__doc__ or "").partition("\n")[0],
        epilog=f"attacks:\n{names}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which attacks (default: all)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser


def _table(rows: list[Row]) -> Table:
    table = Table(title="attacks")
    table.add_column("attack", no_wrap=True)
    for heading in ("graph", "", "effect"):
        table.add_column(heading)
    table.add_column("s", justify="right", no_wrap=True)
    for row in rows:
        verdict = "held" if row.outcome.held else "[red]BROKEN[/red]"
        table.add_row(row.attack, row.graph, verdict, row.outcome.effect, f"{row.seconds:.1f}")
    return table


if __name__ == "__main__":
    main()
