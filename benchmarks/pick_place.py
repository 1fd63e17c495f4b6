"""How well does the arm pick and place? Stacks four cubes into two towers in lockstep, for many seeds.

    python -m benchmarks.pick_place --seeds 0-19
    python -m benchmarks.pick_place --seeds 0-19 --noise 0.003

The belief is the plant's truth, each object off by a constant error if there is noise; with it, the place error is
between cube and support as they truly are in the end, so that it holds what perception contributes.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from time import process_time  # CPU time is what is measured here
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.pick_bench import CUBE, Bench, cubes

PLACES = ((0.42, 0.08), (0.30, 0.08), (0.30, -0.08), (0.42, -0.08))
TOWERS = (("cube_3", "cube_4"), ("cube_6", "cube_5"))
_JITTER = 0.02  # m, of the places, by seed


def play(seed: int, noise: float) -> dict[str, Any]:
    """Build the two towers; returns the outcome of each pick and place."""
    rng = np.random.default_rng(seed)
    places = [
        (x + rng.uniform(-_JITTER, _JITTER), y + rng.uniform(-_JITTER, _JITTER), rng.uniform(-math.pi, math.pi))
        for x, y in PLACES
    ]
    outcomes: list[dict[str, Any]] = []
    with Bench(cubes(places), seed=seed, noise=noise) as bench:
        for cube, support in TOWERS:
            began, cpu = bench.lockstep.clock.now(), process_time()
            said = [bench.act("pick", target=cube)]
            if said[-1] == "done":
                said.append(bench.act("place", target=cube, destination=support))
            outcome = {"seconds": bench.lockstep.clock.now() - began, "cpu": process_time() - cpu, "said": said[-1]}
            bench.run(0.5)
            there, goal = bench.pose(cube).t, bench.pose(support).t
            error = math.dist(there[:2], goal[:2])
            stands = abs(there[2] - goal[2] - CUBE) < 0.003 and error < CUBE / 2
            outcomes.append({**outcome, "error": error, "success": stands and said == ["done", "done"]})
    return {"seed": seed, "outcomes": outcomes}


def main() -> None:
    """Play what the command line asks for and print one row; exit 1 if a pick or place failed."""
    parser = argparse.ArgumentParser("python -m benchmarks.pick_place", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0-4", help="such as 0-19 or 7 (default: 0-4)")
    parser.add_argument("--noise", type=float, default=0.0, help="m, constant error of each believed pose")
    parser.add_argument("--json", type=Path, help="also write the outcomes to this file")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    runs = [play(seed, options.noise) for seed in range(int(first), int(last or first) + 1)]
    console = Console()
    tries = [{**outcome, "seed": run["seed"]} for run in runs for outcome in run["outcomes"]]
    for failed in (outcome for outcome in tries if not outcome["success"]):
        console.print(f"seed {failed['seed']}: {failed['said']}, {failed['error'] * 1e3:.1f} mm beside")
    good = [outcome for outcome in tries if outcome["success"]]
    errors = [outcome["error"] * 1e3 for outcome in good] or [math.nan]
    console.print(
        f"picked and placed {len(good)}/{len(tries)}; place error {np.median(errors):.2f} mm median, "
        f"{np.percentile(errors, 95):.2f} mm 95 %; {np.mean([each['seconds'] for each in tries]):.1f} s simulated, "
        f"{np.mean([each['cpu'] for each in tries]):.2f} s CPU each"
    )
    if options.json:
        options.json.write_text(json.dumps(runs, indent=1), encoding="utf-8")
    raise SystemExit(0 if len(good) == len(tries) else 1)


if __name__ == "__main__":
    main()
