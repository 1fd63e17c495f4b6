"""Years of the whole memory on one seed in one process: all faults that can be simulated, and what must hold.

    python -m benchmarks.years --years 10 --replicas 5 --json years.json
    python -m benchmarks.years --seed 1234 --days 5       # one history again
    python -m benchmarks.years --steps failure-1234.json  # the shortened one, step by step

Each history is some days long and has its own seed. A day begins with work and faults, goes on with the healing of
all and a look at what must hold, and ends with hours of sleep: all processes stand still, and their clocks go on.
A failing history is run again with fewer steps, as long as it fails in the same way, and written down.
Exit 0 only if nothing failed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from benchmarks.years.running import Outcome, Setting, run, shortest
from benchmarks.years.steps import DAY, Step

YEAR = 365.25 * DAY
DAYS = 5
"""days of each history: long enough for what lasts, and short enough to be shortened"""
STEPS = 300


@dataclass
class Report:
    """What all histories came to."""

    histories: int = 0
    lived: float = 0.0
    """s in which all did what was due."""
    slept: float = 0.0
    seconds: float = 0.0
    """s of processor time."""
    met: Counter[str] = field(default_factory=Counter)
    kills: Counter[str] = field(default_factory=Counter)
    problems: dict[int, str] = field(default_factory=dict)
    """What was wrong, by seed."""

    @property
    def simulated(self) -> float:
        """s, nights included."""
        return self.lived + self.slept

    def add(self, seed: int, outcome: Outcome) -> None:
        """Take one history in."""
        self.histories += 1
        self.lived += outcome.lived
        self.slept += outcome.slept
        self.met += outcome.met
        self.kills += outcome.kills
        if outcome.problem:
            self.problems[seed] = outcome.problem


def main() -> None:
    """Run what the command line asks for; exit 1 if something was wrong."""
    options = _parser().parse_args()
    if options.steps:
        raise SystemExit(_again(options.steps))
    report = Report()
    with contextlib.suppress(KeyboardInterrupt):  # what was run until then is told
        for seed in _seeds(options, report):
            setting = Setting(seed, options.replicas, options.days, STEPS)
            begin = time.process_time()
            outcome = run(setting)
            report.seconds += time.process_time() - begin
            report.add(seed, outcome)
            if outcome.problem:
                _tell(setting, outcome.problem, options.folder)
    if report.histories:
        Console().print(_table(report))
    if options.json:
        options.json.write_bytes(msgspec.json.format(msgspec.json.encode(report)))
    raise SystemExit(1 if report.problems else 0)


def _seeds(options: argparse.Namespace, report: Report) -> Iterator[int]:
    """The seed that was asked for, or one after the other until `report` has as many years as were asked for."""
    if options.seed is not None:
        yield options.seed
        return
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("years", total=options.years)
        for seed in count(options.first):
            yield seed
            progress.update(task, completed=report.simulated / YEAR)
            if report.simulated >= options.years * YEAR:
                return


def _tell(setting: Setting, problem: str, folder: Path) -> None:
    """Say how a failure is seen again, and write down the fewest steps that show it."""
    console = Console()
    console.print(f"seed {setting.seed}: {problem}", markup=False)
    console.print(f"again: python -m benchmarks.years --seed {setting.seed} --days {setting.days} "
                  f"--replicas {setting.places}", markup=False)  # fmt: skip
    steps = shortest(setting, setting.history(), problem)
    file = folder / f"failure-{setting.seed}.json"
    file.write_text(json.dumps({"setting": asdict(setting), "steps": steps}, indent=1), encoding="utf-8")
    console.print(f"{len(steps)} steps are enough: python -m benchmarks.years --steps {file}", markup=False)


def _again(file: Path) -> int:
    """Run the steps of a file, and print them; 1 if they still fail."""
    data = json.loads(file.read_text(encoding="utf-8"))
    steps = [Step(*step) for step in data["steps"]]
    for step in steps:
        print(step)
    problem = run(Setting(**data["setting"]), steps).problem
    print(problem or "nothing was wrong")
    return 1 if problem else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.years", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--years", type=float, default=0.1, help="in all histories, nights included (default: 0.1)")
    parser.add_argument("--replicas", type=int, default=5, help="processes of each history, 2 to 9 (default: 5)")
    parser.add_argument("--days", type=int, default=DAYS, help=f"of each history (default: {DAYS})")
    parser.add_argument("--first", type=int, default=0, help="seed of the first history (default: 0)")
    parser.add_argument("--seed", type=int, help="run only the history of this seed")
    parser.add_argument("--steps", type=Path, help="run the steps of this file, which a failure left")
    parser.add_argument("--folder", type=Path, default=Path(), help="where failures are written (default: here)")
    parser.add_argument("--json", type=Path, help="write the counts to this file")
    return parser


def _table(report: Report) -> Table:
    table = Table(title=f"{report.simulated / YEAR:.2f} years in {report.histories} histories", show_header=False)
    table.add_column("", no_wrap=True)
    table.add_column("", justify="right")
    table.add_row("faults", f"{sum(report.met.values())}")
    for kind, number in sorted(report.met.items(), key=lambda item: -item[1]):
        table.add_row(f"  {kind}", f"{number}")
    for call, number in sorted(report.kills.items(), key=lambda item: -item[1]):
        table.add_row(f"  killed at {call}", f"{number}")
    table.add_row("lived, hours", f"{report.lived / 3600.0:.2f}")
    table.add_row("processor, s", f"{report.seconds:.1f}")
    table.add_row("lived time over processor time", f"{report.lived / report.seconds:.0f}")
    table.add_row("all time over processor time", f"{report.simulated / report.seconds:.0f}")
    table.add_row("failed", f"[red]{len(report.problems)}[/red]" if report.problems else "0")
    return table


if __name__ == "__main__":
    main()
