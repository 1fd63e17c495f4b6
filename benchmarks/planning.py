"""Planning: from the graph to a plan with its skills, beside the bare solver on the same problem.

n cubes stand in towers of two that must be taken apart and built anew, each cube on another one. Ours reads the graph,
writes PDDL, runs the solver, checks its plan and finds places; the peer is only `fast-downward.py` as a process, from
its start to its end. They take turns.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks import workload
from benchmarks.group import Group, Run
from benchmarks.rows import Peer, Spec, number
from benchmarks.timing import duration, percentile, sleep
from dsr import Memory, Pose
from dsr.clock import WALL_CLOCK
from dsr.vocabulary.goals import Goal
from dsr.vocabulary.relations import Relation
from planner.config import PlannerConfig
from planner.making import PlanMaker
from planner.pddl import DOMAIN, problem
from planner.solver import PACKAGE, find_solver
from planner.state import read_state

_SIDE = 0.04  # m
_SPACING = 0.12  # m
_COLUMNS = 5
_PEER = "bare solver"
_POLL = 0.001  # s
_ABOUT = (
    "graph to PDDL, solver, plan, places on the table; peer: fast-downward.py --alias lama-first on the same problem"
)
SPECS = {count: Spec(f"planning, {count} cubes", "ms", about=_ABOUT) for count in (4, 6, 20)}
RATIOS = {
    count: Spec(f"planning over the bare solver, {count} cubes", "x", 1.2, about=_ABOUT) for count in SPECS
}  # fmt: skip


def measure(run: Run) -> None:
    """All sizes, one after the other."""
    if not run.has(PACKAGE):
        return
    for count in SPECS:
        run.step(f"planning: {count} cubes")
        _measure(run, count)


def _measure(run: Run, count: int) -> None:
    memory = workload.local_memory()
    goal = _set_scene(memory, count)
    config = PlannerConfig(most_reach=0.8)
    ours, bare = [], []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.pddl"
        file.write_text(problem(read_state(memory, config), goal), encoding="utf-8")
        for _ in range(run.pick(15, 3)):
            ours.append(1e3 * duration(lambda: _plan(memory, goal, config)))
            bare.append(1e3 * duration(lambda: _run_solver(file)))
    value, peer = percentile(ours, 0.5), percentile(bare, 0.5)
    around = percentile([1e3 * duration(lambda: problem(read_state(memory, config), goal)) for _ in range(20)], 0.5)
    note = (
        f"of it graph to PDDL {number(around)} ms; slowest {number(max(ours))} ms, of the peer {number(max(bare))} ms"
    )
    run.row(SPECS[count], value, [Peer(_PEER, peer)], note)
    run.row(RATIOS[count], value / peer, [Peer(_PEER, 1.0)])


def _set_scene(memory: Memory, count: int) -> Goal:
    """Towers of two; wanted are the towers of two from the cubes of one tower and the next."""
    memory.add_node("world", "world")
    memory.add_node("table", "table", size=(1.2, 1.2, 0.03))
    memory.add_edge("world", "table", "RT", pose=Pose((0.4, 0.0, 0.0)))
    memory.add_node("gripper", "gripper")
    for index in range(count):
        tower, above = divmod(index, 2)
        place = (0.3 + _SPACING * (tower // _COLUMNS), _SPACING * (tower % _COLUMNS - 2))
        memory.add_node(_name(index), "cube", size=(_SIDE, _SIDE, _SIDE))
        memory.add_edge("world", _name(index), "Virtual_RT", pose=Pose((*place, _SIDE * (0.5 + above))))
        memory.add_edge(_name(index), _name(index - 1) if above else "table", "on", source="contact")
    pairs = [(index, (index + 3) % count) for index in range(0, count, 2)]
    return Goal(tuple(Relation("on", (_name(above), _name(below))) for above, below in pairs))


def _name(index: int) -> str:
    return f"cube_{index}"


def _plan(memory: Memory, goal: Goal, config: PlannerConfig) -> None:
    maker = PlanMaker(WALL_CLOCK, config, logging.getLogger(__name__))
    for _ in maker.make(read_state(memory, config), goal, ()):
        sleep(_POLL)


def _run_solver(file: Path) -> None:
    command = [sys.executable, str(find_solver()), "--alias", "lama-first", str(DOMAIN), str(file)]
    subprocess.run(command, cwd=file.parent, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT, check=True)


GROUP = Group("planning", [*SPECS.values(), *RATIOS.values()], measure)
