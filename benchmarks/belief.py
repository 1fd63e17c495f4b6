"""How good is the belief? Plays scenarios in lockstep for many seeds and compares percept and belief with the truth.

    python -m benchmarks.belief --seeds 0-19
    python -m benchmarks.belief hovering_8 hovering_20 --seeds 0-4 --sensor poses --json belief.json

The peer of the belief is the percept of the same run; the limits are those of the scenario's expectations.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run

SCENARIOS = (
    "hovering", "hovering_1", "hovering_8", "hovering_20", "hovering_stack_2", "hovering_stack_3", "hovering_wrist",
)  # fmt: skip


def main() -> None:
    """Play what the command line asks for and print a row for each scenario; exit 1 if a run failed."""
    options = _parser().parse_args()
    jobs = [(name, seed, options.sensor) for name in options.scenarios for seed in options.seeds]
    context = multiprocessing.get_context("spawn")
    with context.Pool(options.processes, maxtasksperchild=1) as pool:
        results = list(
            track(pool.imap_unordered(_play, jobs), "playing", total=len(jobs), console=Console(stderr=True))
        )
    rows = [_row(name, [result for result in results if result["job"] == name]) for name in options.scenarios]
    Console().print(_table(rows, options.sensor))
    if options.json:
        options.json.write_text(json.dumps({"sensor": options.sensor, "rows": rows}, indent=1), encoding="utf-8")
    raise SystemExit(0 if all(row["passed"] == row["runs"] for row in rows) else 1)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.belief", description=__doc__.partition("\n")[0])
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS, help="names or files (default: the hovering family)")
    parser.add_argument("--seeds", type=_seeds, default=range(3), help="such as 0-19 or 7 (default: 0-2)")
    parser.add_argument("--sensor", choices=("pixels", "poses"), default="pixels")
    parser.add_argument("--processes", type=int, default=2, help="runs at a time (default: 2)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser


def _seeds(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def _play(job: tuple[str, int, str]) -> dict[str, Any]:
    name, seed, sensor = job
    result = run_lockstep(make_run(name, seed=seed, sensor=sensor))
    failed = [f"{verdict.text}: {verdict.actual}" for verdict in result.expectations if not verdict.passed]
    return {"job": name, "seed": seed, "passed": result.passed, "failed": failed, "metrics": result.metrics}


def _row(name: str, results: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians and worst values over all runs and objects, in SI units."""
    percepts = list(_values(results, "percept_error_"))
    beliefs = list(_values(results, "belief_error_"))
    return {
        "scenario": name,
        "runs": len(results),
        "passed": sum(result["passed"] for result in results),
        "percept_error_median_m": statistics.median(percepts) if percepts else None,
        "belief_error_median_m": statistics.median(beliefs),
        "belief_error_max_m": max(beliefs),
        "interpenetration_max_m": max(_values(results, "belief_overlap_max")),
        "height_error_max_m": max(map(abs, _values(results, "belief_height_error_"))),
        "drift_max_m": max(_values(results, "belief_drift_")),
        "failures": {result["seed"]: result["failed"] for result in results if result["failed"]},
    }


def _values(results: list[dict[str, Any]], prefix: str) -> Iterator[float]:
    for result in results:
        yield from (value for key, value in result["metrics"].items() if key.startswith(prefix) and key.endswith("_m"))


def _table(rows: list[dict[str, Any]], sensor: str) -> Table:
    table = Table(title=f"Belief against truth, lockstep, sensor {sensor} (mm)")
    for heading in ("scenario", "passed", "percept", "belief", "worst", "overlap", "height", "drift", "failed"):
        table.add_column(heading, justify="left" if heading in ("scenario", "failed") else "right")
    for row in rows:
        numbers = [row[key] for key in row if key.endswith("_m")]
        cells = ["-" if number is None else f"{number * 1e3:.2f}" for number in numbers]
        failed = "; ".join(f"seed {seed}: {texts[0]}" for seed, texts in row["failures"].items())
        table.add_row(row["scenario"], f"{row['passed']}/{row['runs']}", *cells, failed)
    return table


if __name__ == "__main__":
    main()
