"""Hand-eye calibration of a Kinova Gen3's wrist camera by a printed square, ours beside Powell's method.

Joint angles are told, partly rounded to 0.01 rad: half of that is up to 8 mm at 0.8 m. Eight views are fitted, the
others predicted, for several random splits. Powell's method minimises the mean distance of the corners, without
derivatives, as the authors of the CORTEX paper did it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from agents.calibrator.hand_eye.calibrate import Setting, observed, solve
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.reading import Hands, joint_poses, read_chain, read_images
from agents.calibrator.hand_eye.start import find_start
from agents.calibrator.hand_eye.targets import read_target
from benchmarks.real.held_out import Mount, errors, row, show
from benchmarks.real.subcommand import MissingDataError, Subcommand
from dsr.math3d.transforms import Array, exp
from dsr.vocabulary.intrinsics import Intrinsics

ROUNDING = 0.01 / math.sqrt(12.0)
"""rad, standard deviation of what is rounded to 0.01 rad"""
_URDF = Path(__file__).parents[2] / "etc/robots/gen3.urdf"
_FOCAL_STEP = 100.0
"""px that Powell's numbers of the intrinsics count by, so that all numbers are about as large"""


def run(data: Path, options: argparse.Namespace) -> list[dict[str, Any]]:
    """Measure on a folder with views.json and the images that it names."""
    views, lens = _read(data)
    methods = {
        "ours": lambda train: _ours(train, lens, fits_joints=True),
        "ours, no errors of joints": lambda train: _ours(train, lens, fits_joints=False),
        "Powell, authors' intrinsics": lambda train: _powell(train, lens, fits_lens=False),
        "Powell, intrinsics too": lambda train: _powell(train, lens, fits_lens=True),
    }
    found: dict[str, list[Array]] = {name: [] for name in methods}
    rng = np.random.default_rng(options.seed)
    for _ in range(options.splits):
        order = rng.permutation(len(views)).tolist()
        train, test = views.subset(order[: options.fit]), views.subset(order[options.fit :])
        for name, method in methods.items():
            found[name].append(errors(method(train), test))
    rows = []
    for name, parts in found.items():
        medians = np.array([np.median(part[:, 1]) for part in parts])
        spread = {"mm_best_split": float(medians.min()), "mm_worst_split": float(medians.max())}
        rows.append(row(name, np.concatenate(parts), **spread))
    everything = errors(methods["ours"](views), views)
    rows.append(row("ours, all views fitted and judged", everything, mm_best_split=math.nan, mm_worst_split=math.nan))
    show(f"{options.fit} of {len(views)} views fitted, the others predicted; {options.splits} splits", rows)
    return rows


def _ours(train: Observations, lens: Intrinsics, *, fits_joints: bool) -> Mount:
    setting = Setting(lens="pinhole", fits_joints=fits_joints, joint_std=ROUNDING)
    return Mount.of(solve(train, lens, setting).fitted.parameters)


def _powell(train: Observations, lens: Intrinsics, *, fits_lens: bool) -> Mount:
    """The mount of least mean distance (mm) of the corners, from the same start as ours."""
    start = find_start(train, lens, 0)
    ordered = train.reordered(start.orders)

    def mount(numbers: Array) -> Mount:
        focal, cx, cy = _FOCAL_STEP * numbers[12:] if fits_lens else np.zeros(3)
        moved = Intrinsics(lens.fx + focal, lens.fy + focal, lens.cx + cx, lens.cy + cy, lens.width, lens.height)
        return Mount(start.mount @ exp(numbers[:6]).matrix, start.target @ exp(numbers[6:12]).matrix, moved)

    def cost(numbers: Array) -> float:
        found = errors(mount(np.asarray(numbers, np.float64)), ordered)[:, 1]
        return float(found.mean()) if np.isfinite(found).all() else 1e6

    found = minimize(cost, np.zeros(15 if fits_lens else 12), method="Powell", options={"maxiter": 30})
    return mount(np.asarray(found.x, np.float64))


def _read(data: Path) -> tuple[Observations, Intrinsics]:
    try:
        told = json.loads((data / "views.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise MissingDataError(f"{data / 'views.json'} cannot be read") from error
    target = read_target(f"square:{told['square_side_m']}")
    images = read_images([data / name for name in told["images"]])
    found = [target.find(image) for image in images]
    rows = [index for index, corners in enumerate(found) if corners is not None]
    sys.stderr.write(f"the square is found in {len(rows)} of {len(images)} images\n")
    chain = read_chain(_URDF, "", "end_effector_link")
    hands = Hands((), *joint_poses(chain, np.array(told["joints_rad"], np.float64)[rows]), chain.names)
    height, width = images[0].shape
    lens = Intrinsics(
        told["focal_px_authors"], told["focal_px_authors"], *told["principal_point_px_authors"], width, height
    )
    pixels, names = np.array([found[index] for index in rows]), [told["images"][index] for index in rows]
    return observed(names, hands, pixels, target, (width, height), Setting(joint_std=ROUNDING)), lens


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--fit", type=int, default=8, metavar="N", help="views to fit (default: 8)")
    parser.add_argument("--splits", type=int, default=10, metavar="N", help="random splits (default: 10)")


SUBCOMMAND = Subcommand(
    "gen3",
    "Hand-eye calibration of a real Gen3's wrist camera by a printed square, beside Powell's method.",
    "https://github.com/robocomp/manipulation_kinova_gen3",
    run,
    _options,
)
