"""Does the arm find ways, and how good are they? Our planner beside OMPL's RRT-Connect in random scenes.

    python -m benchmarks.motion                          # 200 scenes, about ten minutes
    python -m benchmarks.motion --seeds 0-19 --robot panda
    python -m benchmarks.motion --longer 60              # is there a way where ours finds none? OMPL has 60 s for each

In each scene 6 to 14 boxes stand on a table or hang above it, and the arm goes from one free posture to another one.
Both planners have the same arm, check of collisions, distance of checked points, and processor time. OMPL also checks
a straight line at once, and simplifies what it finds. Corners are cut and times given alike. Lengths and times of the
motion are medians of the scenes that both solve. OMPL (extra `bench`) is left out where it is missing.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time  # CPU time is what is measured here
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from agents.arm_controller.model.arm_model import load_arm
from agents.arm_controller.model.figure import Figure
from agents.arm_controller.motion.obstacles import Load, Obstacles
from agents.arm_controller.motion.routes import SPARE, BlockedError, Finding, JointGoal, Router
from agents.arm_controller.motion.search import is_free
from agents.arm_controller.motion.trajectory import MotionLimits, Trajectory
from agents.arm_controller.scene import Obstacle
from agents.arm_controller.skills.ways import CLEARANCE
from dsr.files.built_in import ETC
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
ROBOTS = ("gen3", "panda", "ur5e", "open_manipulator_p")
OURS, OMPL = "ours", "OMPL RRT-Connect"
LIMIT = 3.0
"""s of processor time that each planner has for one scene"""
LEAST_WAY = 1.0
"""rad that the joint with the largest motion has to go at least: less is free nearly always"""
_REACHES = {"open_manipulator_p": 0.6, "panda": 0.8, "ur5e": 0.8, "gen3": 0.8}  # m, of boxes from the base
_OPENING = 0.04  # m between the fingers on the way
_LIMITS = MotionLimits(0.5, 5.0, 100.0)  # as the arm controller's by default


@dataclass(frozen=True)
class Scene:
    """One problem: from one free posture to another one."""

    seed: int
    obstacles: Obstacles
    things: Sequence[Obstacle]
    start: Array
    goal: Array

    def free(self, rows: Array) -> NDArray[np.bool_]:
        """(m,) which joint positions (m, n) are free."""
        return self.obstacles.free(rows, Load(_OPENING), SPARE)


@dataclass(frozen=True)
class Outcome:
    """What one planner made of a scene."""

    seed: int
    planner: str
    found: bool
    length: float = 0.0
    """rad, of all joints together (Euclid)"""
    duration: float = 0.0
    """s of the motion"""
    seconds: float = 0.0
    """Processor time until it was found or given up"""


class Problems:
    """Random scenes for one arm.

    Args:
        robot: name of a description in `etc/robots`.
    """

    def __init__(self, robot: str) -> None:
        model = load_arm(ETC / "robots" / f"{robot}.urdf")
        self.chain = model.chain
        self.figure = Figure(model)
        self.router = Router(model.chain, Pose.identity())
        self._reach = _REACHES[robot]
        self.lower = np.where(model.chain.turning, -np.pi, model.chain.lower)
        self.upper = np.where(model.chain.turning, np.pi, model.chain.upper)

    def scene(self, seed: int) -> Scene:
        """The scene of that seed."""
        rng = np.random.default_rng(seed)
        things = [Obstacle("table", Pose((0.0, 0.0, -0.02)), (2.4, 2.4, 0.04)), *self._boxes(rng)]
        obstacles = Obstacles(self.figure, things, Pose.identity())
        while True:
            rows = rng.uniform(self.lower, self.upper, (64, len(self.lower)))
            tips = self.chain.frames(rows)[:, -1, :3, 3]
            good = rows[obstacles.free(rows, Load(_OPENING), SPARE) & (tips[:, 0] > 0.0) & (tips[:, 2] < 0.6)]
            if len(good) >= 2 and np.abs(good[1] - good[0]).max() > LEAST_WAY:
                return Scene(seed, obstacles, things, good[0], good[1])

    def _boxes(self, rng: np.random.Generator) -> list[Obstacle]:
        found = []
        for number in range(int(rng.integers(6, 15))):
            away, around = rng.uniform(0.3, self._reach), rng.uniform(-1.6, 1.6)
            x, y, z = rng.uniform(0.05, 0.2), rng.uniform(0.05, 0.3), rng.uniform(0.05, 0.5)
            base = 0.0 if rng.random() < 0.7 else rng.uniform(0.3, 0.7)
            turn = Pose.from_rotvec((away * np.cos(around), away * np.sin(around), base + z / 2), (0, 0, around))
            found.append(Obstacle(f"box_{number}", turn, (x, y, z)))
        return found

def ours(problems: Problems, scene: Scene) -> Outcome:
    """The arm controller's planner: simple ways first, then a search."""
    began, limits, load, goal = process_time(), _LIMITS, Load(_OPENING), JointGoal(scene.goal)
    travel = max(thing.top for thing in scene.things) + problems.figure.reach + CLEARANCE
    try:
        found: Trajectory | None = problems.router.plan(scene.start, goal, load, scene.obstacles, travel, limits)
    except BlockedError:
        rng = np.random.default_rng(scene.seed)
        found = _in_time(problems.router.search(scene.start, goal, load, scene.obstacles, limits, rng), began)
    return _outcome(scene, OURS, found, process_time() - began)


def _in_time(finding: Finding, began: float) -> Trajectory | None:
    """What a search finds within the limit."""
    while process_time() - began < LIMIT:
        try:
            next(finding)
        except StopIteration as end:
            trajectory: Trajectory = end.value
            return trajectory
        except BlockedError:
            return None
    return None


class Ompl:
    """RRT-Connect of OMPL, with its simplification.

    Args:
        base: module `ompl.base`.
        geometric: module `ompl.geometric`.
        util: module `ompl.util`.
        limit: s of processor time for one scene.
    """

    def __init__(self, base: Any, geometric: Any, util: Any, limit: float = LIMIT) -> None:
        self._base, self._geometric, self._limit = base, geometric, limit
        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(1)  # once for all scenes: OMPL has one seed for a process

    def __call__(self, problems: Problems, scene: Scene) -> Outcome:
        """Solve the scene."""
        began, base = process_time(), self._base
        space = base.RealVectorStateSpace(len(scene.start))
        bounds = base.RealVectorBounds(len(scene.start))
        for index, (low, high) in enumerate(zip(problems.lower, problems.upper, strict=True)):
            bounds.setLow(index, float(low))
            bounds.setHigh(index, float(high))
        space.setBounds(bounds)
        setup = self._geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        read = _reader(len(scene.start))
        setup.setStateValidityChecker(lambda state: bool(scene.free(read(state)[None]).all()))
        information.setMotionValidator(self._validator(information, scene, read))
        setup.setStartAndGoalStates(_state(space, scene.start), _state(space, scene.goal))
        setup.setPlanner(self._geometric.RRTConnect(information))
        in_time = base.PlannerTerminationCondition(lambda: process_time() - began > self._limit)
        if setup.solve(in_time).asString() != "Exact solution":
            return _outcome(scene, OMPL, None, process_time() - began)
        path = setup.getSolutionPath()
        setup.getPathSimplifier().simplify(path, in_time)
        way = np.array([read(state) for state in path.getStates()])
        try:
            found: Trajectory | None = problems.router.along(way, Load(_OPENING), scene.obstacles, _LIMITS)
        except BlockedError:
            found = None
        return _outcome(scene, OMPL, found, process_time() - began)

    def _validator(self, information: Any, scene: Scene, read: Callable[[Any], Array]) -> Any:
        """Checks a straight line with few calls, as our planner does."""

        class Lines(self._base.MotionValidator):  # type: ignore[misc, name-defined]
            def checkMotion(self, one: Any, other: Any) -> bool:  # noqa: N802 - OMPL's name
                return is_free(read(one), read(other), scene.free)

        return Lines(information)


def _reader(joints: int) -> Callable[[Any], Array]:
    return lambda state: np.array([state[index] for index in range(joints)])


def _state(space: Any, positions: Array) -> Any:
    state = space.allocState()
    for index, position in enumerate(positions.tolist()):
        state[index] = position
    return state


def _outcome(scene: Scene, planner: str, found: Trajectory | None, seconds: float) -> Outcome:
    if found is None:
        return Outcome(scene.seed, planner, False, seconds=seconds)
    length = float(np.linalg.norm(np.diff(found.positions, axis=0), axis=1).sum())
    return Outcome(scene.seed, planner, True, length, found.duration, seconds)


def planners() -> list[Callable[[Problems, Scene], Outcome]]:
    """Our planner, and OMPL's where it is installed."""
    try:
        from ompl import base, geometric, util
    except ImportError:
        return [ours]
    return [ours, Ompl(base, geometric, util)]


def missed_by_ours(problems: Problems, seeds: Sequence[int], limit: float) -> Iterator[Outcome]:
    """OMPL's outcome of each of the scenes that our planner does not solve, with `limit` s of processor time.

    The scenes that OMPL does not solve either have no way, as far as so much search can tell.
    """
    from ompl import base, geometric, util

    longer = Ompl(base, geometric, util, limit)
    for seed in seeds:
        scene = problems.scene(seed)
        if not ours(problems, scene).found:
            yield longer(problems, scene)


def table(outcomes: Sequence[Outcome]) -> Table:
    """Successes, and medians of what each planner found and of what it took."""
    shown = Table("planner", "found", "length (rad)", "motion (s)", "sum of CPU as a ratio of ours")
    names = list(dict.fromkeys(outcome.planner for outcome in outcomes))
    seconds = {name: sum(each.seconds for each in outcomes if each.planner == name) for name in names}
    found = {name: {each.seed for each in outcomes if each.planner == name and each.found} for name in names}
    both = set.intersection(*found.values())
    for name in names:
        rows = [each for each in outcomes if each.planner == name and each.seed in both]
        medians = (np.median([getattr(each, field) for each in rows] or [np.nan]) for field in ("length", "duration"))
        tries = sum(each.planner == name for each in outcomes)
        cells = (f"{len(found[name])}/{tries}", *(f"{value:.2f}" for value in medians))
        shown.add_row(name, *cells, f"{seconds[name] / max(seconds[OURS], 1e-9):.2f}")
    return shown


def main() -> None:
    """Solve the scenes that the command line asks for and print a table."""
    parser = argparse.ArgumentParser("python -m benchmarks.motion", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default="0-199", help="such as 0-19 or 7 (default: 0-199)")
    parser.add_argument("--robot", choices=ROBOTS, default=ROBOTS[0], help="which arm (default: gen3)")
    parser.add_argument("--json", type=Path, help="also write the outcomes to this file")
    parser.add_argument("--longer", type=float, help="s that OMPL has for scenes which ours misses; no comparison then")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    problems, console = Problems(options.robot), Console()
    if options.longer:
        for outcome in missed_by_ours(problems, seeds, options.longer):
            how = f"OMPL finds {outcome.length:.1f} rad" if outcome.found else "OMPL finds nothing either"
            console.print(f"scene {outcome.seed}: missed by ours; {how} in {outcome.seconds:.1f} s of processor time")
        return
    peers = planners()
    if len(peers) == 1:
        console.print("OMPL is not installed (extra `bench`): our planner alone")
    scenes = (problems.scene(seed) for seed in seeds)
    outcomes = [solve(problems, scene) for scene in scenes for solve in peers]
    console.print(table(outcomes))
    if options.json:
        options.json.write_text(json.dumps([asdict(outcome) for outcome in outcomes], indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
