"""Which source files run while one write reaches a peer's watch, and while observations become commands of the arm.

    python -m benchmarks.files_on_the_way
    python -m benchmarks.files_on_the_way --list

The write: two replicas in one process; an attribute of a node is written in one and watched in the other. The
observations: a scenario from rendered images, in lockstep. Its first simulated seconds are traced: then the arm gets
its first targets. The simulated reality, the judge and the recorder do not count. A file counts if any of its functions
runs. No reader has to open more files to follow the way. `docs/explanation/follow.md` names those that he opens, in
order: the column "read". The command checks that the code of each of them runs.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from agents.scenario.run.runner import Silent, run_lockstep
from agents.scenario.run.staging import make_run
from dsr import LocalNetwork, ManualClock, Memory

PACKAGES = ("dsr", "agents", "simulation_handler", "surprise", "planner")
_BESIDE = ("agents/plant/", "agents/scenario/", "agents/recorder/", "agents/viewer/")
"""These play and judge the run; no robot has them on the way."""
_ROOT = Path(__file__).parents[1]


WALKS = "docs/explanation/follow.md"
WRITE, OBSERVATION = "## One write", "## One observation"
"""Sections of the page `WALKS`."""
_PATH = re.compile(r"`((?:dsr|agents|simulation_handler|surprise|planner)/[a-z0-9_/]+\.py)`")


def documented(section: str) -> list[str]:
    """Files that the section of `WALKS` with this heading names, each once, in order."""
    text = (_ROOT / WALKS).read_text(encoding="utf-8")
    _, _, rest = text.partition(f"\n{section}")
    return list(dict.fromkeys(_PATH.findall(rest.partition("\n## ")[0])))


class Trace:
    """Notes all code of this thread that runs while it is on. A context manager."""

    def __init__(self) -> None:
        self._seen: set[CodeType] = set()

    def __enter__(self) -> Trace:
        self.begin()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def begin(self) -> None:
        """Note from now on."""
        sys.setprofile(self._note)

    def end(self) -> None:
        """Note no more; harmless when repeated."""
        sys.setprofile(None)

    def files(self) -> list[str]:
        """Source files of the system whose functions ran, relative to the root."""
        inside = [Path(code.co_filename) for code in self._seen if code.co_filename.startswith(str(_ROOT))]
        names = {path.relative_to(_ROOT).as_posix() for path in inside}
        return sorted(name for name in names if name.split("/")[0] in PACKAGES and not name.startswith(_BESIDE))

    def _note(self, frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            self._seen.add(frame.f_code)


def of_a_write() -> list[str]:
    """Files that run from `update_node` in one replica to the change that a watch of another delivers."""
    clock = ManualClock()
    network = LocalNetwork(clock, seed=0)
    with (
        Memory("way", "writer", transport=network.connect("writer"), clock=clock) as writer,
        Memory("way", "reader", transport=network.connect("reader"), clock=clock) as reader,
    ):
        writer.add_node("cube", "object", size=(0.1, 0.1, 0.1))
        _deliver(clock, network, writer, reader)
        watch = reader.watch()
        for side in (0.2, 0.3):  # the first shows all that is done only once
            trace = Trace()
            with trace:
                writer.update_node("cube", size=(side, side, side))
                _deliver(clock, network, writer, reader)
                changes = watch.poll()
        if [change.name for change in changes] != ["cube"]:
            raise AssertionError(f"the write did not arrive: {changes}")
        return trace.files()


def _deliver(clock: ManualClock, network: LocalNetwork, *memories: Memory) -> None:
    """Let all that was written arrive."""
    for _ in range(10):
        clock.advance(0.05)
        for memory in memories:
            memory.flush()
        network.deliver()
        for memory in memories:
            memory.poll()


class _Window(Silent):
    """Traces the beginning of a run, up to `end` (s)."""

    def __init__(self, end: float) -> None:
        self.trace = Trace()
        self._end = end

    def running(self, elapsed: float) -> None:
        """Note what runs, until the end."""
        if elapsed < self._end:
            self.trace.begin()
        else:
            self.trace.end()


def of_observations(scenario: str, seconds: float, seed: int) -> list[str]:
    """Files that run in so many s of a scenario (simulated), from its beginning."""
    run = make_run(scenario, seed=seed)
    short = msgspec.structs.replace(run.scenario, duration=seconds)
    window = _Window(seconds)
    try:
        run_lockstep(msgspec.structs.replace(run, scenario=short), window)
    finally:
        window.trace.end()
    return window.trace.files()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.files_on_the_way",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenario", default="towers", help="whose observations are followed (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=6.0, help="of it that are traced (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the scenario (default: %(default)s)")
    parser.add_argument("--list", action="store_true", help="name all files")
    options = parser.parse_args()
    ways = {
        "a write to a peer's watch": of_a_write(),
        "observations to commands of the arm": of_observations(options.scenario, options.seconds, options.seed),
    }
    console = Console()
    read = dict(zip(ways, (documented(WRITE), documented(OBSERVATION)), strict=True))
    table = Table("way", "read", "run", "by room")
    for way, files in ways.items():
        rooms = Counter(str(Path(file).parent) for file in files)
        by_room = ", ".join(f"{room} {count}" for room, count in rooms.most_common())
        table.add_row(way, str(len(read[way])), str(len(files)), by_room)
    console.print(table)
    for way, files in ways.items():
        if idle := [name for name in read[way] if name not in files]:
            console.print(f"{way}: {WALKS} names files that do not run: {', '.join(idle)}", style="red")
    if options.list:
        for way, files in ways.items():
            console.print(f"{way}:", *files, sep="\n  ", highlight=False)


if __name__ == "__main__":
    main()
