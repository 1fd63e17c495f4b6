"""How well does each arm pick and place? Boxes, cylinders, balls and cups of 10 to 80 mm, in lockstep, over seeds.

    python -m benchmarks.pick_place                                    # four arms, 19 things, seeds 0-1
    python -m benchmarks.pick_place --robots gen3 --forms ball --sizes 10,80 --seeds 0-9
    python -m benchmarks.pick_place --noise 0.003

The belief is the plant's truth, each object off by a constant error if there is noise. The truth judges: the thing must
be lifted off the table, and then stand within 10 mm of where it was to go, or within 10 mm and the error of the belief.
A size is the edge of a box and the diameter of all else. Cylinders are 60 mm high and cups 80 mm, which are 40 mm wide
or wider.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time  # CPU time is what is measured here
from typing import get_args

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.pick_bench import Bench, Block, BlockForm
from dsr.math3d.quaternions import Vector3
from dsr.math3d.transforms import Pose

ROBOTS = ("gen3", "panda", "ur5e", "open_manipulator_p")
FORMS: tuple[BlockForm, ...] = get_args(BlockForm)
SIZES = (10, 20, 40, 60, 80)
"""mm"""
LEAST_CUP = 40
"""mm, of a cup: fingers do not go into narrower ones, and nobody drinks from them"""

_FROM, _TO = (0.36, -0.10), (0.36, 0.10)  # m, where all four arms reach with a gripper that points down
_JITTER = 0.03  # m, of both places, by seed
_LIFTED = 0.06  # m; a pick lifts by 0.08 m, which a slip may shorten
_BESIDE = 0.01  # m from where it was to go
_HEIGHTS = {"cylinder": 0.06, "cup": 0.08}  # m


@dataclass(frozen=True)
class Carried:
    """What became of one thing that was to be picked and placed."""

    robot: str
    form: str
    size: int
    """mm"""
    seed: int
    said: str
    """By the arm, and what was seen to be wrong with that."""
    picked: bool = False
    placed: bool = False
    error: float = math.nan
    """m between where it stands and where it was to go"""
    seconds: float = 0.0
    """Simulated, for both."""
    cpu: float = 0.0
    """Seconds of processor time, for both."""


def block(form: BlockForm, size: int, place: tuple[float, float, float]) -> Block:
    """The thing of a form and size (mm) at x, y (m) and yaw (rad)."""
    wide = size / 1e3
    dimensions: Vector3 = (wide, wide, _HEIGHTS.get(form, wide))
    return Block("thing", place, dimensions, form=form)


def play(robot: str, form: BlockForm, size: int, seed: int, noise: float) -> Carried:
    """Pick one thing and put it down elsewhere."""
    rng = np.random.default_rng([seed, size, FORMS.index(form)])
    (x, y), (u, v) = (np.add(at, rng.uniform(-_JITTER, _JITTER, 2)).tolist() for at in (_FROM, _TO))
    thing = block(form, size, (x, y, rng.uniform(-math.pi, math.pi)))
    with Bench([thing], seed=seed, noise=noise, robot=robot) as bench:
        before, began, cpu = bench.pose("thing").t, bench.lockstep.clock.now(), process_time()
        said = bench.act("pick", target="thing")
        picked = said == "done" and bench.pose("thing").t[2] - before[2] > _LIFTED
        placed, error = False, math.nan
        if picked:
            goal = (u, v, thing.size[2] / 2)
            said = bench.act("place", target="thing", destination="table", target_pose=Pose(goal))
            bench.run(0.5)
            error = math.dist(bench.pose("thing").t, goal)
            placed = said == "done" and error < _BESIDE + 3 * noise
        seconds, cpu = bench.lockstep.clock.now() - began, process_time() - cpu
    if said == "done" and not placed:
        said = f"done, but it is {error * 1e3:.0f} mm beside" if picked else "done, but it lies there"
    return Carried(robot, form, size, seed, said, picked, placed, error, seconds, cpu)


def table(tries: Sequence[Carried]) -> Table:
    """Successes by robot and form for each size, with the times."""
    sizes = sorted({each.size for each in tries})
    shown = Table("arm", "form", *(f"{size} mm" for size in sizes), "s, median", "mm beside, median")
    for robot, form in dict.fromkeys((each.robot, each.form) for each in tries):
        rows = [each for each in tries if (each.robot, each.form) == (robot, form)]
        cells = [[each for each in rows if each.size == size] for size in sizes]
        rates = (f"{sum(each.placed for each in cell)}/{len(cell)}" if cell else "" for cell in cells)
        good = [each for each in rows if each.placed]
        seconds = f"{np.median([each.seconds for each in good]):.1f}" if good else ""
        beside = f"{np.median([each.error for each in good]) * 1e3:.1f}" if good else ""
        shown.add_row(robot, form, *rates, seconds, beside)
    return shown


def main() -> None:
    """Carry what the command line asks for and print a table; exit 1 if something was not picked and placed."""
    parser = argparse.ArgumentParser("python -m benchmarks.pick_place", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0-1", help="such as 0-19 or 7 (default: 0-1)")
    parser.add_argument("--robots", default=",".join(ROBOTS), help=f"by commas (default: {','.join(ROBOTS)})")
    parser.add_argument("--forms", default=",".join(FORMS), help=f"by commas (default: {','.join(FORMS)})")
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)), help="mm, by commas (default: 10 to 80)")
    parser.add_argument("--noise", type=float, default=0.0, help="m, constant error of each believed pose")
    parser.add_argument("--json", type=Path, help="also write the outcomes to this file")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    logging.disable(logging.WARNING)  # the lines below tell what failed
    console = Console()
    tries = [
        play(robot, form, size, seed, options.noise)
        for robot in options.robots.split(",")
        for form in FORMS
        if form in options.forms.split(",")
        for size in map(int, options.sizes.split(","))
        if form != "cup" or size >= LEAST_CUP
        for seed in range(int(first), int(last or first) + 1)
    ]
    for each in tries:
        if not each.placed:
            console.print(f"{each.robot}, {each.form} of {each.size} mm, seed {each.seed}: {each.said}")
    console.print(table(tries))
    good = sum(each.placed for each in tries)
    cpu = np.mean([each.cpu for each in tries])
    console.print(f"picked and placed {good}/{len(tries)}; {cpu:.1f} s of processor time each")
    if options.json:
        options.json.write_text(json.dumps([asdict(each) for each in tries], indent=1), encoding="utf-8")
    raise SystemExit(0 if good == len(tries) else 1)


if __name__ == "__main__":
    main()
