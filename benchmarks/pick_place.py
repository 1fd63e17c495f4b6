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
import tempfile
from pathlib import Path
from time import process_time  # CPU time is what is measured here
from typing import Any

import msgspec
import numpy as np
from rich.console import Console

from agents.arm_controller import ArmController
from agents.plant import Plant
from agents.plant.messages import Truth
from agents.scene_setup import SceneSetup
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec
from dsr.transforms import Pose

CUBE = 0.04
"""m"""
PLACES = ((0.42, 0.08), (0.30, 0.08), (0.30, -0.08), (0.42, -0.08))
TOWERS = (("cube_3", "cube_4"), ("cube_6", "cube_5"))
_JITTER = 0.02  # m, of the places, by seed
_PATIENCE = 30.0  # s for one action


class Bench:
    """An arm in front of a table with cubes, in lockstep, with the truth as its belief. A context manager.

    Args:
        places: x, y (m) and yaw (rad) of the cubes `cube_3`, `cube_4`, ... on the table.
        seed: of the run.
        noise: m, standard deviation of the constant error of each object's believed x and y.
    """

    def __init__(self, places: list[tuple[float, float, float]], *, seed: int = 0, noise: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        self._errors: dict[str, tuple[float, float, float]] = {
            f"cube_{3 + index}": (*rng.normal(0.0, noise, 2).tolist(), 0.0) for index in range(len(places))
        }
        with tempfile.TemporaryDirectory(prefix="dsr-pick-") as folder:
            file = Path(folder) / "cubes.toml"
            file.write_text(_scenario(places), encoding="utf-8")
            self.lockstep = Lockstep(
                [
                    AgentSpec("plant", Plant, {"scenario": str(file), "sensor": "poses"}),
                    AgentSpec("scene_setup", SceneSetup, {"scenario": str(file)}),
                    AgentSpec("arm_controller", ArmController),
                ],
                seed=seed,
                strict=True,
            )
        self.memory = self.lockstep.memory
        self.truth: Truth | None = None
        self.lockstep.bus.subscribe(self.lockstep.keys.truth(), self._believe)
        self._actions = 0
        self.memory.add_node("mind", "mind")
        self.run(1.0)

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.lockstep.close()

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.lockstep.run_for(seconds)

    def request(self, skill: str, **attributes: Any) -> str:
        """Ask for an action; returns the name of its node."""
        self._actions += 1
        name = f"action_1_{self._actions}"
        self.memory.add_node(name, "action", skill=skill, status="planned", request="run", **attributes)
        return name

    def act(self, skill: str, **attributes: Any) -> str:
        """Ask for an action and wait for its end; returns how that went: status, and why."""
        name = self.request(skill, **attributes)
        end = self.lockstep.clock.now() + _PATIENCE
        while self.lockstep.clock.now() < end:
            self.run(0.1)
            node = self.memory.node(name)
            if node.get("status") not in ("planned", "running"):
                return f"{node['status']} {node.get('explanation', '')}".strip()
        return "still running"

    def pose(self, name: str) -> Pose:
        """Where the object truly is, in the world."""
        assert self.truth is not None
        seven = self.truth.objects[name]
        return Pose(seven[:3], seven[3:])

    def lower(self, name: str, by: float) -> None:
        """Let the object be believed `by` m too low."""
        x, y, z = self._errors[name]
        self._errors[name] = (x, y, z - by)

    def _believe(self, key: str, payload: bytes) -> None:
        self.truth = msgspec.msgpack.decode(payload, type=Truth)
        for name, seven in self.truth.objects.items():
            pose = Pose(seven[:3], seven[3:], self.truth.stamp)
            if name in self.memory:
                believed = Pose(tuple(np.add(pose.t, self._errors[name])), pose.q, pose.stamp)
                self.memory.add_edge("world", name, "Virtual_RT", pose=believed)


def play(seed: int, noise: float) -> dict[str, Any]:
    """Build the two towers; returns the outcome of each pick and place."""
    rng = np.random.default_rng(seed)
    places = [
        (x + rng.uniform(-_JITTER, _JITTER), y + rng.uniform(-_JITTER, _JITTER), rng.uniform(-math.pi, math.pi))
        for x, y in PLACES
    ]
    outcomes: list[dict[str, Any]] = []
    with Bench(places, seed=seed, noise=noise) as bench:
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


def _scenario(places: list[tuple[float, float, float]]) -> str:
    """A scenario file with cubes at these places."""
    cubes = "".join(
        f'\n[[object]]\nname = "cube_{3 + index}"\nmarker_id = {3 + index}\nknown = true\n'
        f"position = [{x}, {y}, {CUBE / 2}]\nyaw = {yaw}\n"
        for index, (x, y, yaw) in enumerate(places)
    )
    return f'name = "cubes"\ntitle = "Cubes to pick"\nduration = 3600.0\n{cubes}'


if __name__ == "__main__":
    main()
