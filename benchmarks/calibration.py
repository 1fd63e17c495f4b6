"""Does the whole system find out that its camera was bumped, and how well? From images, the truth from the plant.

    python -m benchmarks.calibration --trials 50 --seed 0 --json figures.json --plots plots
    python -m benchmarks.calibration mixed --trials 10 --seed 10 --sensor poses --json figures.json

Parts: `trials` (four cubes, the camera at the gripper bumped by up to 10 cm and 15 degrees along and about each axis,
all cubes still in view), `cubes` (1 to 6) and `layouts` (six), evaluated from four other arm poses, and `mixed`: cases
in which cubes were moved, or seen falsely, with and without the camera. Runs that are in the JSON file already are not
repeated, so a measurement may be made in pieces. A pose within 3 mm and 0.3 deg of the truth is right.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from agents.calibrator.solve.calibrate import calibrate
from agents.scenario.run.staging import Sensor
from benchmarks.calibration_runs import (
    EVENT_AT,
    bump,
    bumped_in_view,
    flip,
    in_view,
    observing,
    on_table,
    play,
    put,
    scene,
    spread,
)
from benchmarks.calibration_scene import LAYOUTS
from benchmarks.calibration_survey import SurveyConfig, Surveyor
from benchmarks.calibration_synthetic import SUCCESS, processor_time
from benchmarks.calibration_tables import PARTS, Row, cases, draw, holds, report
from benchmarks.options import whole_number
from dsr.clock import WALL_CLOCK
from dsr.math3d.transforms import Pose, log
from dsr.runtime.system import AgentSpec
from dsr.vocabulary.calibration import method_names

MIDDLE = (0.36, 0.0)
HALF = 0.08
"""m, half the width of the square at whose corners four cubes stand, give or take a centimetre"""

_BUMP = (0.10, math.radians(15.0))  # m, rad along and about each axis
_BY_HAND = (0.01, math.radians(2.0))  # as a mount is measured
_MOVE = (0.03, 0.08)  # m
_APART = 0.057  # m between the centres of cubes
_NEAR = (0.01, math.radians(1.0))  # m, rad, of a camera that was rightly taken for moved
_FRAMES = 60  # that show a cube falsely: six seconds


def main() -> None:
    """Measure what is not measured yet, print, and write JSON and plots; exit 1 if a target is missed."""
    parser = _parser()
    options = parser.parse_args()
    try:
        rows = _read(options.json)
    except (OSError, ValueError) as error:
        parser.error(f"--json {options.json}: {error}")
    wanted = [
        (part, case, seed)
        for part in options.parts or PARTS
        for case in cases(part)
        for seed in range(options.seed, options.seed + options.trials)
    ]
    known = {(row["part"], row["case"], row["seed"], row["sensor"]) for row in rows}
    todo = [one for one in wanted if (*one, options.sensor) not in known]
    for part, case, seed in track(todo, "sessions", console=Console(stderr=True), disable=not todo):
        rows.append(session(part, case, seed, options.sensor))
        if options.json:
            _write(rows, options.json)
    measured = [row for row in rows if row["sensor"] == options.sensor]
    report(Console(), measured)
    if options.plots:
        draw(measured, options.plots)
    raise SystemExit(0 if holds(measured) else 1)


def _read(file: Path | None) -> list[Row]:
    """The sessions that a file holds. Raises `OSError` or `ValueError`."""
    if file is None or not file.exists():
        return []
    rows = json.loads(file.read_text(encoding="utf-8"))
    if not isinstance(rows, list) or not all(isinstance(row, dict) and "sensor" in row for row in rows):
        raise ValueError("expected the sessions that this command has written")
    return rows


def _write(rows: Sequence[Row], file: Path) -> None:
    """Write all sessions; whoever interrupts that leaves the file as it was."""
    part = file.with_name(f"{file.name}.part")
    part.write_text(json.dumps(rows), encoding="utf-8")
    part.replace(file)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks.calibration", description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="*", choices=PARTS, help="default: all")
    parser.add_argument("--trials", type=whole_number(1), default=10, help="sessions of each case")
    parser.add_argument("--seed", type=whole_number(0), default=0, help="of the first one")
    parser.add_argument("--sensor", choices=("pixels", "poses"), default="pixels")
    parser.add_argument("--json", type=Path, help="keep the figures of all sessions in this file")
    parser.add_argument("--plots", type=Path, metavar="FOLDER", help="write CSV files and, with matplotlib, PNG")
    return parser


def session(part: str, case: str, seed: int, sensor: Sensor) -> Row:
    """Play one session; its figures."""
    rng = np.random.default_rng((PARTS.index(part), cases(part).index(case), seed))
    row: Row = {"part": part, "case": case, "seed": seed, "sensor": sensor}
    make: Mapping[str, Callable[[np.random.Generator, str, int, Sensor], Row]] = {
        "trials": _trial, "cubes": _survey, "layouts": _survey, "mixed": _mixed,
    }  # fmt: skip
    began = WALL_CLOCK.monotonic()
    return row | make[part](rng, case, seed, sensor) | {"seconds": WALL_CLOCK.monotonic() - began}


# ---- sessions


def _trial(rng: np.random.Generator, case: str, seed: int, sensor: Sensor) -> Row:
    """A bump; the end of the run, and what each method makes of what the calibrator had."""
    cubes = _corners(rng)
    moved = _displacement(rng, cubes, _BUMP)
    for duration in (4.0, 18.0):  # it takes longer only if one view does not tell
        found = play(scene(cubes, [bump(moved)], duration=EVENT_AT + duration), seed=seed, sensor=sensor)
        if found.result.metrics.get("times_calibrated"):
            break
    row = _outcome(found.result.metrics, []) | {"views": found.views}
    if found.before is None:  # it was not even doubted
        return row | {"methods": {}}
    truth, methods = found.before @ moved, {}
    for method in method_names():
        started = processor_time()
        solution = calibrate(found.sightings, found.before, method)
        methods[method] = {
            "error": log(truth.inverse() @ solution.pose).tolist(),
            "distance": truth.distance(solution.pose),
            "adopted": solution.is_adoptable,
            "seconds": processor_time() - started,
            "history": solution.history,
        }
    return row | {"methods": methods, "bump": found.before.distance(truth)}


def _survey(rng: np.random.Generator, case: str, seed: int, sensor: Sensor) -> Row:
    """A mount measured by hand from the beginning, a calibration on request, four other arm poses."""
    cubes = _square(rng, LAYOUTS[case]) if case in LAYOUTS else _scattered(rng, int(case))
    moved = _displacement(rng, cubes, _BY_HAND)
    surveyor = AgentSpec("surveyor", Surveyor, {"begin": SurveyConfig().begin})
    text = scene(cubes, [bump(moved, at=0.0)], duration=28.0)
    result = play(text, seed=seed, sensor=sensor, more=[surveyor], by_itself=False).result
    found = Surveyor.found
    return _outcome(result.metrics, []) | {
        "elsewhere": _mean(found["after"]), "elsewhere_before": _mean(found["before"]), "told": found["status"],
        "looks": len(found["after"]),
    }  # fmt: skip


def _mixed(rng: np.random.Generator, case: str, seed: int, sensor: Sensor) -> Row:
    """Cubes moved or seen falsely, with and without the camera; the decision at the end."""
    cubes = _corners(rng)
    duration = EVENT_AT + (16.0 if case == "all_moved_alike" else 8.0)
    is_bumped = case == "bumped_and_one_moved"
    if case == "one_flipped":
        angle, direction = rng.uniform(math.radians(15.0), math.radians(60.0)), rng.uniform(-math.pi, math.pi)
        events = [flip(0, angle * np.array([math.cos(direction), math.sin(direction), 0.0]), _FRAMES)]
    elif case == "all_moved_alike":
        events = [put(number, there) for number, there in enumerate(_moved_alike(rng, cubes))]
    else:
        count = 2 if case == "two_moved" else 1
        there = _moved(rng, cubes, count)
        moved = _displacement(rng, [*cubes[count:], *there], _BUMP) if is_bumped else None
        events = [put(number, pose) for number, pose in enumerate(there)] + ([bump(moved)] if moved else [])
    result, _, _, views = play(scene(cubes, events, duration=duration), seed=seed, sensor=sensor)
    row = _outcome(result.metrics, [verdict.actual for verdict in result.expectations if not verdict.passed])
    decided = row["times"] == 1 if is_bumped else row["times"] == 0
    beliefs = next(verdict.passed for verdict in result.expectations if verdict.text.startswith("belief_error"))
    near = row["metres"] < _NEAR[0] and row["radians"] < _NEAR[1]
    return row | {"right": bool(decided and beliefs and near), "views": views}


def _outcome(metrics: Mapping[str, float], wrong: Sequence[str]) -> Row:
    metres, radians = metrics.get("camera_error_m", 0.0), metrics.get("camera_error_rad", 0.0)
    return {
        "metres": metres,
        "radians": radians,
        "success": metres < SUCCESS[0] and radians < SUCCESS[1],
        "times": int(metrics.get("times_calibrated", 0)),
        "recovery": metrics.get("camera_recovery_time_s"),
        "wrong": list(wrong),
    }


# ---- scenes


def _corners(rng: np.random.Generator) -> list[Pose]:
    """Four cubes at the corners of a square, give or take a centimetre, turned at random."""
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    offsets = rng.uniform(-0.01, 0.01, (4, 2))
    return [
        on_table(MIDDLE[0] + 0.75 * HALF * x + dx, MIDDLE[1] + HALF * y + dy, rng.uniform(-math.pi, math.pi))
        for (x, y), (dx, dy) in zip(signs, offsets.tolist(), strict=True)
    ]


def _square(rng: np.random.Generator, half: float) -> list[Pose]:
    """Four cubes at the corners of a square, aligned: they may touch."""
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    quarter = 0.5 * math.pi * rng.integers(4)
    return [on_table(MIDDLE[0] + half * x, MIDDLE[1] + half * y, quarter) for x, y in signs]


def _scattered(rng: np.random.Generator, count: int) -> list[Pose]:
    while True:
        places = rng.uniform((-0.13, -0.16), (0.13, 0.16), (count, 2))
        cubes = [on_table(MIDDLE[0] + x, MIDDLE[1] + y, rng.uniform(-math.pi, math.pi)) for x, y in places.tolist()]
        if spread(cubes, _APART):
            return cubes


def _displacement(rng: np.random.Generator, cubes: Sequence[Pose], most: tuple[float, float]) -> Pose:
    """Of the camera, such that it still sees all cubes."""

    def draw() -> Pose:
        return Pose.from_rotvec(rng.uniform(-most[0], most[0], 3), rng.uniform(-most[1], most[1], 3))

    return bumped_in_view(cubes, draw)


def _moved(rng: np.random.Generator, cubes: Sequence[Pose], count: int) -> list[Pose]:
    """The first `count` cubes elsewhere, each by itself."""
    while True:
        there = []
        for cube in cubes[:count]:
            distance, direction = rng.uniform(*_MOVE), rng.uniform(-math.pi, math.pi)
            x, y, _ = cube.t
            place = x + distance * math.cos(direction), y + distance * math.sin(direction)
            there.append(on_table(*place, rng.uniform(-math.pi, math.pi)))
        if spread([*there, *cubes[count:]], _APART) and in_view(there, observing()):
            return there


def _moved_alike(rng: np.random.Generator, cubes: Sequence[Pose]) -> list[Pose]:
    """All cubes moved as one."""
    while True:
        distance, direction = rng.uniform(*_MOVE), rng.uniform(-math.pi, math.pi)
        turn = Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, rng.uniform(-0.3, 0.3)))
        shift = (distance * math.cos(direction), distance * math.sin(direction), 0.0)
        moved = Pose(shift) @ Pose((*MIDDLE, 0.0)) @ turn @ Pose((-MIDDLE[0], -MIDDLE[1], 0.0))
        there = [moved @ cube for cube in cubes]
        if in_view(there, observing()):
            return there


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


if __name__ == "__main__":
    main()
