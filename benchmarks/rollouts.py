"""How many rollouts a second? Simulates variants of a scene, in this process and in workers, and as others would do it.

    python -m benchmarks.rollouts
    python -m benchmarks.rollouts --objects 10 --seconds 0.5 --json rollouts.json

A rollout is 0.4 s of a tabletop with stacks of two cubes, of which one cube was moved: as an explanation of a
surprise. Peers, in this process: a new physics client for each rollout; and one client that goes back to a snapshot
(saveState, restoreState) and puts the one cube elsewhere; both as Bullet is by default, with sleeping, and to the
end; and MuJoCo with one or two threads, to the end, if it is installed. Ours ends a rollout when all is at rest. The
rate is by the wall clock, which needs a quiet machine; the CPU time of a rollout is that of all processes. `128 with 2`
is how long 128 rollouts take two workers, which may be 0.5 s.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil
from rich.console import Console
from rich.table import Table

from dsr.clock import WALL_CLOCK
from simulation_handler.physics.rollouts import Placing, Pool, RolloutBody, RolloutScene
from simulation_handler.physics.simulator import TIME_STEP, Simulator

_PATIENCE = 600.0  # s
_WORLDS = 128  # of which a belief may want to know at once how they go on
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
_FLOOR = RolloutBody("_floor", (20.0, 20.0, 0.2), (0.0, 0.0, -0.8), fixed=True)
_TABLE = RolloutBody("table", (1.2, 1.2, 0.04), (0.0, 0.0, -0.02), fixed=True)


def main() -> None:
    """Measure what the command line asks for and print a row for each number of objects."""
    options = _parser().parse_args()
    rows = [measured(count, options.rollouts, options.seconds) for count in options.objects]
    Console().print(_table(rows))
    if options.json:
        options.json.write_text(json.dumps({"seconds": options.seconds, "rows": rows}, indent=1), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.rollouts", description=__doc__.partition("\n")[0])
    parser.add_argument("--objects", type=int, nargs="+", default=[4, 6, 10, 20], help="cubes (default: 4 6 10 20)")
    parser.add_argument("--rollouts", type=int, default=128, help="of each kind (default: 128)")
    parser.add_argument("--seconds", type=float, default=0.4, help="simulated in each (default: 0.4)")
    parser.add_argument("--json", type=Path, help="also write the rows to this file")
    return parser


def measured(objects: int, rollouts: int, seconds: float) -> dict[str, Any]:
    """Of each kind, for scenes of some objects: rollouts a second, and ms of CPU for one."""
    scenes = variants(objects, rollouts)
    row: dict[str, Any] = {"objects": objects}
    for workers in (0, 1, 2):
        with Pool(workers, _PATIENCE if workers else rollouts) as pool:
            pool.run(scenes[: 2 * workers + 2], 0.1)
            row[f"{workers} workers"] = _rate(partial(pool.run, scenes, seconds), rollouts, pool.pids)
    row["new client"] = _rate(lambda: [_in_new_client(scene, seconds) for scene in scenes[:20]], len(scenes[:20]))
    with Simulator() as sim:
        _load(sim, settled(objects))
        snapshot = sim.snapshot()
        row["snapshot"] = _rate(lambda: [_from_snapshot(sim, snapshot, scene, seconds) for scene in scenes], rollouts)
    return row | _by_mujoco(settled(objects), scenes, seconds)


def _by_mujoco(scene: RolloutScene, scenes: Sequence[RolloutScene], seconds: float) -> dict[str, dict[str, float]]:
    """The same by MuJoCo, by the number of threads; empty if it is not installed."""
    if not find_spec("mujoco"):
        return {}
    from benchmarks.peers.mujoco_rollouts import MujocoRollouts

    rates = {}
    for threads in (1, 2):
        with MujocoRollouts(scene, threads) as peer:
            rates[f"MuJoCo, {threads}"] = _rate(partial(peer.run, scenes, seconds), len(scenes))
    return rates


def settled(objects: int) -> RolloutScene:
    """Stacks of two cubes on a table, at rest; five stacks in a row."""
    size, cubes = (0.04, 0.04, 0.04), []
    for number in range(objects):
        stack, level = divmod(number, 2)
        row, column = divmod(stack, 5)
        position = (0.1 * column, -0.1 * row, 0.02 + 0.04 * level)
        cubes.append(RolloutBody(f"cube_{number:02}", size, position, mass=0.05))
    return RolloutScene((_FLOOR, _TABLE, *cubes))


def variants(objects: int, count: int) -> list[RolloutScene]:
    """The settled scene with one cube put beside the others, each time another one and elsewhere."""
    scene = settled(objects)
    cubes = [name for name in scene.names if name.startswith("cube")]
    return [
        scene.moved({cubes[number % objects]: ((0.1 * (number % 5), 0.1 + 0.001 * number, 0.021), _UPRIGHT)})
        for number in range(count)
    ]


def _rate(action: Callable[[], object], count: int, workers: Sequence[int] = ()) -> dict[str, float]:
    """How fast `count` of them are done, here and by processes with these ids."""
    begin, cpu = WALL_CLOCK.monotonic(), _cpu(workers)
    action()
    seconds = WALL_CLOCK.monotonic() - begin
    return {"per_s": count / seconds, "cpu_ms": 1e3 * (_cpu(workers) - cpu) / count}


def _cpu(others: Sequence[int]) -> float:
    """CPU time of this process and others, s."""
    times = [psutil.Process(pid).cpu_times() for pid in (None, *others)]
    return float(sum(time.user + time.system for time in times))


def _in_new_client(scene: RolloutScene, seconds: float) -> list[Placing]:
    with Simulator() as sim:
        _load(sim, scene)
        return _stepped(sim, seconds)


def _from_snapshot(sim: Simulator, snapshot: int, scene: RolloutScene, seconds: float) -> list[Placing]:
    sim.restore(snapshot)
    for body in scene.bodies:
        if not body.fixed and sim.position(body.name) != body.position:
            sim.place(body.name, body.position, body.rotation)
    return _stepped(sim, seconds)


def _load(sim: Simulator, scene: RolloutScene) -> None:
    for body in scene.bodies:
        sim.add_box(body.name, body.size, body.position, body.rotation, mass=body.mass, friction=body.friction)


def _stepped(sim: Simulator, seconds: float) -> list[Placing]:
    sim.step(round(seconds / TIME_STEP))
    return [sim.pose(name) for name in sim.names]


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="rollouts a second (ms of CPU for each)")
    for heading in (*rows[0], f"{_WORLDS} with 2"):
        table.add_column(heading, justify="right")
    for row in rows:
        objects, *kinds = row.values()
        together = _WORLDS / row["2 workers"]["per_s"]
        told = (f"{kind['per_s']:.0f} ({kind['cpu_ms']:.1f})" for kind in kinds)
        table.add_row(str(objects), *told, f"{together:.2f} s")
    return table


if __name__ == "__main__":
    main()
