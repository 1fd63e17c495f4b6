"""Does the arm ever move on blindly? Injects one fault into each run, in the middle of a motion, and times the stop.

    python -m benchmarks.arm_faults                      # 500 runs, about a quarter of an hour
    python -m benchmarks.arm_faults --seeds 0-35
    python -m benchmarks.arm_faults --fault jump --seeds 0-4

The simulated arm has driver, agent and memory of a real one, in lockstep. In every second run, by chance, it picks a
cube. In the others it goes to joint positions that somebody wrote by hand. A fault comes while the arm moves, at a time
that the seed gives. A wrong target, for an action or by hand, comes while the arm rests. A run is good if

- the arm brakes within the time that the table names (`within`), or never begins to move;
- it then stands still for a second, and says why.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from rich.console import Console
from rich.table import Table

from agents.drivers import ArmState
from agents.plant import Plant
from agents.plant.arm import SimulatedArm
from benchmarks.faulty_devices import BlinkingCamera, LyingArm
from benchmarks.pick_bench import Bench, cubes
from dsr.clock import ManualClock
from dsr.errors import AgentError
from dsr.math3d.transforms import Pose
from dsr.vocabulary.halting import HaltOrder, send_order

RUNS = 500
PLACES = ((0.42, 0.08), (0.30, 0.08), (0.30, -0.08), (0.42, -0.08))
CAMERA = "camera_overhead"
BELOW = (1.0, 0.0, 0.0, 0.0)
"""Quaternion (x, y, z, w) of a tool that points down"""
AT_ONCE = 0.1
"""s within which the arm brakes after most faults"""
THREE_FRAMES = 0.35
"""s, likewise after the loss of a camera at 10 Hz: three intervals, and a tick"""
GETS_ON = 0.4
"""s, likewise after the joints of a lying driver stand still: 0.3 s, a sample, and the ticks of agent and plant"""
TURNS = 2.0
"""s, likewise after the velocities of a lying driver stay what they are: they are true until the arm's change"""
MOVES = 0.05
"""rad/s of the fastest joint from which the arm moves"""
STILL = 0.01
"""rad/s of the fastest joint below which the arm stands still"""
STAYS = 2e-3
"""rad that the joints of an arm may move while it stands still"""
WATCHED = 1.0
"""s for which an arm must stand still"""
PATIENCE = 3.0
"""s in which an arm that does not brake counts as one that moves on"""
TURN = 1.4
"""rad of the first joint, away from the forbidden zone, that a target by hand asks for: 2.4 s"""
_JITTER = 0.02  # m, of the places, by seed
_ZONE = {"lower": [0.35, 0.25, 0.0], "upper": [0.65, 0.55, 0.6]}  # m, world: beside the cubes


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong."""

    name: str
    inject: Callable[[Bench, np.random.Generator], None]
    said: str
    """Words of the reason that somebody must tell"""
    within: float = AT_ONCE
    """s until the arm brakes"""
    at_rest: bool = False
    """Whether it is a wrong target, which must not move the arm at all"""
    by_hand: bool = False
    """Whether it only makes sense while the arm goes to a target by hand"""


def _lie(change: Callable[[ArmState, np.random.Generator], ArmState]) -> Callable[[Bench, np.random.Generator], None]:
    def inject(bench: Bench, rng: np.random.Generator) -> None:
        number = int(rng.integers(0, 2**31))
        LyingArm.lie = lambda state: change(state, np.random.default_rng(number))

    return inject


def _with_joint(
    state: ArmState, rng: np.random.Generator, change: Callable[[float], float], joint: int = -1
) -> ArmState:
    index = int(rng.integers(0, 7)) if joint < 0 else joint
    positions = list(state.positions)
    positions[index] = change(positions[index])
    return replace(state, positions=tuple(positions))


def _swapped(state: ArmState, rng: np.random.Generator) -> ArmState:
    """Two joints far apart tell each other's positions."""
    order = [2, 1, 0, 3, 4, 5, 6]
    return replace(state, positions=tuple(state.positions[index] for index in order))


def _renamed(state: ArmState, rng: np.random.Generator) -> ArmState:
    index = int(rng.integers(0, 7))
    return replace(state, names=tuple("elbow" if n == index else name for n, name in enumerate(state.names)))


def _frozen(*, stamps_go_on: bool) -> Callable[[Bench, np.random.Generator], None]:
    """A driver that tells the last sample for ever: as it was, or with new stamps as if the arm had been stalled."""

    def inject(bench: Bench, rng: np.random.Generator) -> None:
        kept: list[ArmState] = []

        def lie(state: ArmState) -> ArmState:
            kept.append(state)
            if not stamps_go_on or len(kept) == 1:
                return kept[0]
            return replace(kept[0], stamp=state.stamp, velocities=(0.0,) * len(state.velocities))

        LyingArm.lie = lie

    return inject


def _same_velocities(bench: Bench, rng: np.random.Generator) -> None:
    """A driver that tells the velocities of one moment for ever."""
    kept: list[ArmState] = []

    def lie(state: ArmState) -> ArmState:
        kept.append(state)
        return replace(state, velocities=kept[0].velocities)

    LyingArm.lie = lie


def _partition(*groups: Iterable[str]) -> Callable[[Bench, np.random.Generator], None]:
    return lambda bench, rng: bench.lockstep.network.partition(*groups)


def _blind(bench: Bench, rng: np.random.Generator) -> None:
    BlinkingCamera.blind = True


def _halt(bench: Bench, rng: np.random.Generator) -> None:
    send_order(bench.lockstep.bus, bench.lockstep.keys, HaltOrder("1", True, "anna", "a hand"))


def _halt_alone(bench: Bench, rng: np.random.Generator) -> None:
    """An emergency stop whose controller has just died."""
    bench.lockstep.kill("arm_controller")
    _halt(bench, rng)


def _halt_twice(bench: Bench, rng: np.random.Generator) -> None:
    """Two orders of different people, as one presses the button while another types."""
    _halt(bench, rng)
    send_order(bench.lockstep.bus, bench.lockstep.keys, HaltOrder("2", True, "ben", "a hand"))


def _appear(kind: str, size: tuple[float, float, float]) -> Callable[[Bench, np.random.Generator], None]:
    """A thing or a zone comes to where a target by hand leads the tool."""

    def inject(bench: Bench, rng: np.random.Generator) -> None:
        goal = _arm(bench).model.chain.forward(bench.memory.node("arm")["target_joints"])
        edge = "RT" if kind == "zone" else "Virtual_RT"
        bench.memory.add_node("newcomer", kind, size=size)
        bench.memory.add_edge("world", "newcomer", edge, pose=Pose(goal.t))

    return inject


def _reach_in(bench: Bench, rng: np.random.Generator) -> None:
    """Somebody's hand comes to the gripper."""
    arm = _arm(bench)
    x, y, z = arm.link_pose(arm.model.tool).t
    side = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.15))
    bench.memory.add_node("hand_1", "hand")
    bench.memory.add_edge("world", "hand_1", "RT", pose=Pose((x, y + side, z)))


def _move_to(x: float, y: float, z: float) -> Callable[[Bench, np.random.Generator], None]:
    def inject(bench: Bench, rng: np.random.Generator) -> None:
        dx, dy = rng.uniform(-_JITTER, _JITTER, 2).tolist()
        _ask(bench, Pose((x + dx, y + dy, z), BELOW), rng)

    return inject


def _ask(bench: Bench, target: Pose, rng: np.random.Generator) -> None:
    """Ask for the tool to go there: as an action, or by hand."""
    if rng.random() < 0.5:
        bench.request("move", target_pose=target)
    else:
        bench.memory.update_node("arm", target_pose=target)


def _into_cube(bench: Bench, rng: np.random.Generator) -> None:
    x, y, _ = bench.pose(f"cube_{3 + int(rng.integers(0, 4))}").t
    _ask(bench, Pose((x, y, -0.01), BELOW), rng)


def _beyond_limits(bench: Bench, rng: np.random.Generator) -> None:
    joints = [*_arm(bench).positions]
    joints[1] = float(rng.choice([-1.0, 1.0]) * rng.uniform(2.4, 6.0))
    bench.memory.update_node("arm", target_joints=joints)


def _too_few(bench: Bench, rng: np.random.Generator) -> None:
    bench.memory.update_node("arm", target_joints=[0.1] * int(rng.integers(1, 7)))


FAULTS = {
    fault.name: fault
    for fault in (
        Fault("wrong joint names", _lie(_renamed), "does not know joint"),
        Fault("positions beyond limits", _lie(lambda s, r: _with_joint(s, r, lambda q: 2.6, 1)), "beyond its limits"),
        Fault("positions that jump", _lie(lambda s, r: _with_joint(s, r, lambda q: q + 0.3, 0)), "jumped"),
        Fault("positions that are no numbers", _lie(lambda s, r: _with_joint(s, r, lambda q: float("nan"))), "finite"),
        Fault("stamps far ahead", _lie(lambda s, r: replace(s, stamp=s.stamp + 100.0)), "ahead of the clock"),
        Fault("joints that are swapped", _lie(_swapped), "jumped"),
        Fault("velocities of 0", _lie(lambda s, r: replace(s, velocities=(0.0,) * 7)), "tells 0.00 rad/s"),
        Fault("constant velocities", _lie(lambda s, r: replace(s, velocities=(0.2,) * 7)), "tells 0.20 rad/s"),
        Fault("velocities that stay as they were", _same_velocities, "rad/s, and has gone", TURNS),
        Fault("a fault of the device", _lie(lambda s, r: replace(s, fault="servo 3 is too hot")), "too hot"),
        Fault("joints that do not follow", _frozen(stamps_go_on=True), "stands still", GETS_ON),
        Fault("stale joint states", _frozen(stamps_go_on=False), "no sample of the arm"),
        Fault("dead controller", lambda bench, rng: bench.lockstep.kill("arm_controller"), "no sign of life"),
        Fault("controller cut off", _partition(["plant-1", "observer"], ["arm_controller-1"]), "no sign of life"),
        Fault("lost memory", _partition(["plant-1", "arm_controller-1"], ["observer"]), "nobody else holds the memory"),
        Fault("lost camera", _blind, "no frame for", THREE_FRAMES),
        Fault("emergency stop", _halt, "halted by anna"),
        Fault("emergency stop, twice", _halt_twice, "halted by"),
        Fault("emergency stop, controller dead", _halt_alone, "halted by anna"),
        Fault("a hand at the gripper", _reach_in, "stands still: hand_1 is near"),
        Fault("a thing in the way", _appear("cube", (0.1, 0.1, 0.1)), "newcomer is in the way", by_hand=True),
        Fault("a zone in the way", _appear("zone", (0.2, 0.2, 0.2)), "newcomer is in the way", by_hand=True),
        Fault("target in a cube", _into_cube, "in the way", at_rest=True),
        Fault("target in the table", _move_to(0.36, 0.0, -0.05), "in the way", at_rest=True),
        Fault("target in a forbidden zone", _move_to(0.45, 0.35, 0.2), "cupboard is in the way", at_rest=True),
        Fault("target beyond the joints' limits", _beyond_limits, "expected", at_rest=True),
        Fault("target of too few joints", _too_few, "expected 7", at_rest=True),
    )
}


@dataclass
class Outcome:
    """What came of one run; times in s from the fault, None for never."""

    seed: int
    fault: str
    brakes: float | None = None
    """Until the arm began to brake; 0 for an arm that never moved"""
    still: float | None = None
    """Until it stood still"""
    stays: bool = False
    """Whether it stood still then"""
    reason: str = ""
    """What was said"""
    good: bool = False


def _arm(bench: Bench) -> SimulatedArm:
    plant = bench.lockstep.runner("plant").agent
    assert isinstance(plant, Plant) and isinstance(plant._reality.arm, SimulatedArm)
    return plant._reality.arm


def _speed(bench: Bench) -> float:
    return float(np.abs(_arm(bench).velocities).max())


def play(seed: int, fault: Fault) -> Outcome:
    """Play one run with a fault."""
    rng = np.random.default_rng([seed, 24])
    places = [(x + rng.uniform(-_JITTER, _JITTER), y + rng.uniform(-_JITTER, _JITTER), rng.uniform(-3.1, 3.1))
              for x, y in PLACES]  # fmt: skip
    LyingArm.lie, BlinkingCamera.blind = None, False
    here = "benchmarks.faulty_devices"
    config = {
        "driver": f"{here}:LyingArm",
        "cameras": {CAMERA: {"driver": f"{here}:BlinkingCamera"}},
        "forbidden": {"cupboard": _ZONE},
    }
    with _bench(places, seed, config) as bench:
        if not fault.at_rest:
            by_hand = fault.by_hand or rng.random() < 0.5
            if by_hand:
                first, *others = _arm(bench).positions
                bench.memory.update_node("arm", target_joints=(first + TURN, *others))
            else:
                bench.request("pick", target=f"cube_{3 + int(rng.integers(0, 4))}")
            bench.run(float(rng.uniform(0.3, 1.2 if by_hand else 2.2)))
            bench.lockstep.run_for(10.0, lambda now: _speed(bench) > MOVES)
        return _watched(bench, Outcome(seed, fault.name), fault, rng)


def _bench(places: list[tuple[float, float, float]], seed: int, config: dict[str, Any]) -> Bench:
    BlinkingCamera.clock = clock = ManualClock()
    return Bench(cubes(places), seed=seed, arm=config, clock=clock)


def _watched(bench: Bench, outcome: Outcome, fault: Fault, rng: np.random.Generator) -> Outcome:
    """Inject the fault, and see what the arm does."""
    began, arm = bench.lockstep.clock.now(), _arm(bench)
    before = np.array(arm.positions)
    fault.inject(bench, rng)

    def look(now: float) -> bool:
        if outcome.brakes is None and (arm.is_braking or not arm.is_driven):
            outcome.brakes = 0.0 if fault.at_rest else now - began
        if outcome.brakes is not None and outcome.still is None and _speed(bench) < STILL and not arm.is_driven:
            outcome.still = now - began
        if fault.said not in outcome.reason:  # what is over is no longer said of a target by hand
            outcome.reason = _reason(bench)
        return outcome.still is not None

    bench.lockstep.run_for(PATIENCE, look)
    place = before if fault.at_rest else np.array(arm.positions)
    bench.run(WATCHED)
    outcome.stays = outcome.still is not None and float(np.abs(np.array(arm.positions) - place).max()) < STAYS
    if fault.said not in outcome.reason:
        outcome.reason = _reason(bench)
    in_time = outcome.brakes is not None and outcome.brakes <= fault.within + 1e-6
    outcome.good = in_time and outcome.stays and fault.said in outcome.reason
    return outcome


def _reason(bench: Bench) -> str:
    """What device and controller say, and the actions in the memory of the controller."""
    plant: Any = bench.lockstep.runner("plant").agent
    said: list[str] = [plant._reality.arm_state(0.0).fault]
    try:
        agent = bench.lockstep.runner("arm_controller").agent
    except AgentError:  # it was killed
        return said[0]
    nodes = [*agent.memory.nodes("action"), agent.memory.node("arm")]
    return "; ".join(filter(None, [agent.degraded, *said, *(node.get("explanation", "") for node in nodes)]))


def table(outcomes: list[Outcome]) -> Table:
    """A row for each fault."""
    shown = Table(title="Faults of an arm", title_justify="left", box=None)
    shown.add_column("fault")
    for column in ("runs", "stopped,\nwith reason", "moved on", "within\ns", "brakes after\ns, median", "worst",
                   "stands still after\ns, median", "worst"):  # fmt: skip
        shown.add_column(column, justify="right")
    for name, fault in FAULTS.items():
        runs = [outcome for outcome in outcomes if outcome.fault == name]
        if not runs:
            continue
        brakes = [run.brakes for run in runs if run.brakes is not None] or [float("nan")]
        still = [run.still for run in runs if run.still is not None] or [float("nan")]
        numbers = (
            ["no motion", "", "", ""]
            if fault.at_rest and all(run.stays for run in runs)
            else [f"{value:.2f}" for value in (np.median(brakes), max(brakes), np.median(still), max(still))]
        )
        blindly = sum(not run.stays for run in runs)
        shown.add_row(name, str(len(runs)), str(sum(run.good for run in runs)), str(blindly), f"{fault.within:.2f}",
                      *numbers)  # fmt: skip
    return shown


def main() -> None:
    """Play what the command line asks for and print a table; exit 1 if a run was not good."""
    parser = argparse.ArgumentParser("python -m benchmarks.arm_faults", description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", default=f"0-{RUNS - 1}", help=f"such as 0-35 or 7 (default: 0-{RUNS - 1})")
    parser.add_argument("--fault", choices=FAULTS, help="only this one (default: one after the other, by seed)")
    parser.add_argument("--json", type=Path, help="also write the outcomes to this file")
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    kinds = list(FAULTS.values())
    outcomes = [
        play(seed, FAULTS[options.fault] if options.fault else kinds[seed % len(kinds)])
        for seed in range(int(first), int(last or first) + 1)
    ]
    console = Console(width=140)
    console.print(table(outcomes))
    for bad in (outcome for outcome in outcomes if not outcome.good):
        console.print(f"seed {bad.seed}, {bad.fault}: brakes {bad.brakes}, stays {bad.stays}, said {bad.reason!r}")
    good = sum(outcome.good for outcome in outcomes)
    console.print(f"{good}/{len(outcomes)} stopped in time and said why; "
                  f"{sum(not outcome.stays for outcome in outcomes)} moved on")  # fmt: skip
    if options.json:
        options.json.write_text(json.dumps([asdict(outcome) for outcome in outcomes], indent=1), encoding="utf-8")
    raise SystemExit(0 if good == len(outcomes) else 1)


if __name__ == "__main__":
    main()
