"""Which boxes does the arm pick? Boxes of many heights and widths, free-standing and beside others, for some seeds.

    python -m benchmarks.pick_sizes --seeds 0-2
    python -m benchmarks.pick_sizes --heights 10,35 --widths 40 --beside none,wall:20 --seeds 0-9 --noise 0.002

Boxes are square and weigh as wood. A try is a success if the box is in the gripper in the end, above where it stood,
and nothing beside it was moved. What is not tried, because the arm says at once that it cannot, is counted apart.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.pick_bench import Bench, Block

HEIGHTS = (10, 15, 20, 25, 30, 35, 40, 60, 80)
WIDTHS = (10, 20, 40, 60, 80)
"""mm"""
BESIDE = ("none", "wall:10", "wall:40", "neighbour:10", "neighbour:20", "slot:30")
"""What stands beside the box, and how far away (mm)"""

_DENSITY = 500.0  # kg/m^3, of wood
_WALL = (0.02, 0.30, 0.15)  # m; higher than the palm gets above the lowest box
_WALL_MASS = 50.0  # kg: nothing that the arm does moves it unnoticed
_PLACE = (0.40, 0.0)  # m, in the middle of where things are put
_JITTER = 0.03  # m, of the place, by seed
_LIFTED = 0.06  # m; a pick lifts by 0.08 m, which a slip may shorten
_MOVED = 0.002  # m by which something was pushed


class Beside(NamedTuple):
    """What stands beside the box."""

    kind: str
    """none, wall, neighbour (as the box), or slot: a wall on either side"""
    gap: float
    """m between it and the box"""

    def blocks(self, size: float, height: float, place: tuple[float, float, float], side: int) -> list[Block]:
        """What stands at quarter turn `side` of the box of `size` x `size` x `height` m at `place`."""
        x, y, yaw = place
        found = []
        for number in range({"none": 0, "slot": 2}.get(self.kind, 1)):
            is_wall = self.kind != "neighbour"
            extent = _WALL if is_wall else (size, size, height)
            turn = yaw + (side + 2 * number) * math.pi / 2
            away = (size + extent[0]) / 2 + self.gap
            at = (x + away * math.cos(turn), y + away * math.sin(turn), math.remainder(turn, math.tau))
            mass = _WALL_MASS if is_wall else _mass(size, height)
            found.append(Block(f"{'wall' if is_wall else 'neighbour'}_{number + 1}", at, extent, mass))
        return found


class Try(msgspec.Struct, frozen=True):
    """What became of one pick."""

    beside: str
    height: int
    """mm"""
    width: int
    """mm"""
    seed: int
    said: str
    """By the arm, and what was seen to be wrong with that."""
    success: bool
    seconds: float
    """Simulated, until it ended."""


def attempt(beside: str, height: int, width: int, seed: int, noise: float) -> Try:
    """Pick one box of `width` x `width` x `height` mm; what is `beside` it is as in `BESIDE`."""
    rng = np.random.default_rng([seed, height, width])
    x, y = (at + rng.uniform(-_JITTER, _JITTER) for at in _PLACE)
    place, size = (x, y, rng.uniform(-math.pi, math.pi)), (width / 1e3, width / 1e3, height / 1e3)
    others = _beside(beside).blocks(size[0], size[2], place, int(rng.integers(4)))
    box = Block("box", place, size, _mass(size[0], size[2]))
    with Bench([box, *others], seed=seed, noise=noise) as bench:
        before = {block.name: bench.pose(block.name).t for block in (box, *others)}
        began = bench.lockstep.clock.now()
        said = bench.act("pick", target="box")
        seconds = bench.lockstep.clock.now() - began
        bench.run(0.5)
        after = {name: bench.pose(name).t for name in before}
    pushed = [block.name for block in others if math.dist(before[block.name], after[block.name]) > _MOVED]
    if said == "done" and after["box"][2] - before["box"][2] < _LIFTED:
        said = "done, but it lies there"
    if pushed:
        said = f"{said}, but {pushed[0].partition('_')[0]} was moved"
    return Try(beside, height, width, seed, said, said == "done", seconds)


def main() -> None:
    """Pick what the command line asks for and print a table for each kind of surroundings."""
    parser = argparse.ArgumentParser("python -m benchmarks.pick_sizes", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0-2", help="such as 0-19 or 7 (default: 0-2)")
    parser.add_argument("--heights", type=_numbers, default=HEIGHTS, help="mm, such as 10,35 (default: 10 to 80)")
    parser.add_argument("--widths", type=_numbers, default=WIDTHS, help="mm, such as 10,80 (default: 10 to 80)")
    parser.add_argument("--beside", default=",".join(BESIDE), help=f"with gaps in mm (default: {','.join(BESIDE)})")
    parser.add_argument("--noise", type=float, default=0.0, help="m, constant error of each believed pose")
    parser.add_argument("--json", type=Path, help="also write the outcomes to this file")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    logging.disable(logging.WARNING)  # the tables tell what failed
    console, tries = Console(), list[Try]()
    for beside in options.beside.split(","):
        found = [
            attempt(beside, height, width, seed, options.noise)
            for height in options.heights
            for width in options.widths
            for seed in seeds
        ]
        console.print(_table(beside, found), *_causes(found), sep="\n")
        tries += found
    console.print(f"picked {sum(each.success for each in tries)}/{len(tries)}")
    if options.json:
        options.json.write_text(json.dumps(msgspec.to_builtins(tries), indent=1), encoding="utf-8")


def _table(title: str, tries: Sequence[Try]) -> Table:
    """Successes by height and width."""
    widths = sorted({each.width for each in tries})
    table = Table("high \\ wide (mm)", *map(str, widths), title=title)
    for height in sorted({each.height for each in tries}):
        cells = [[each for each in tries if (each.height, each.width) == (height, width)] for width in widths]
        table.add_row(str(height), *(f"{sum(each.success for each in cell)}/{len(cell)}" for cell in cells))
    return table


def _causes(tries: Iterable[Try]) -> list[str]:
    """Why tries have failed, the most frequent first, with how often, the sizes, and how long that took."""
    failed = [each for each in tries if not each.success]
    counts = Counter(each.said for each in failed)
    lines = []
    for said, count in counts.most_common():
        such = [each for each in failed if each.said == said]
        sizes = sorted({(each.height, each.width) for each in such})
        shown = " ".join(f"{height}x{width}" for height, width in sizes)
        lines.append(f"{count} x {said} (in {max(each.seconds for each in such):.1f} s at most): {shown}")
    return lines


def _beside(text: str) -> Beside:
    kind, _, gap = text.partition(":")
    return Beside(kind, float(gap or 0.0) / 1e3)


def _mass(size: float, height: float) -> float:
    """Kg"""
    return _DENSITY * size * size * height


def _numbers(text: str) -> list[int]:
    return [int(word) for word in text.split(",")]


if __name__ == "__main__":
    main()
