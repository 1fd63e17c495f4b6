"""Hand-eye calibration of a Kinova Gen3's wrist camera by a printed square, ours beside Powell's method.

Joint angles are told, partly rounded to 0.01 rad: half of that is up to 8 mm at 0.8 m. Eight views are fitted, the
others predicted, for several random splits. Powell's method minimises the mean distance of the corners, without
derivatives, as the authors of the CORTEX paper did it. Least squares fit offsets of the joints too, as if nothing else
was wrong with these.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares, minimize

from agents.calibrator.hand_eye.calibrate import Setting, observed, solve
from agents.calibrator.hand_eye.model import Parameters, ViewModel
from agents.calibrator.hand_eye.observations import Observations
from agents.calibrator.hand_eye.reading import ToldHands, joint_poses, read_chain, read_images
from agents.calibrator.hand_eye.start import find_start
from agents.calibrator.hand_eye.targets import read_target
from benchmarks.real.held_out import Mount, errors, table_of
from benchmarks.real.recordings import DataError, Outcome, RealBenchmark, needed
from dsr.math3d.transforms import Array, Pose, exp
from dsr.vocabulary.intrinsics import Intrinsics

ROUNDING = 0.01 / math.sqrt(12.0)
"""rad, standard deviation of what is rounded to 0.01 rad"""
_URDF = Path(__file__).parents[2] / "etc/robots/gen3.urdf"
_FOCAL_STEP = 100.0
"""px that Powell's numbers of the intrinsics count by, so that all numbers are about as large"""


_WORST = 1e6
"""mm, cost of what shows no corners"""
_FITTED, _SPLITS, _SEED = 8, 6, 0
"""Views that are fitted, random splits, and their seed"""


def run(folder: Path) -> Outcome:
    """Predict the views that were not fitted, by each method."""
    views, lens, images = _read(folder)
    methods: dict[str, Callable[[Observations], Mount]] = {
        "ours": lambda train: _ours(train, lens, fits_joints=True),
        "ours, joints as told": lambda train: _ours(train, lens, fits_joints=False),
        "Powell, lens given": lambda train: _powell(train, lens, fits_lens=False),
        "Powell, lens fitted": lambda train: _powell(train, lens, fits_lens=True),
        "least squares": lambda train: _least_squares(train, lens),
    }
    found: dict[str, list[Array]] = {name: [] for name in methods}
    rng = np.random.default_rng(_SEED)
    for _ in range(_SPLITS):
        order = rng.permutation(len(views)).tolist()
        train, test = views.subset(order[:_FITTED]), views.subset(order[_FITTED:])
        for name, method in methods.items():
            found[name].append(errors(method(train), test))
    every = list(range(len(views)))
    found["ours, all but one"] = [
        errors(methods["ours"](views.subset([row for row in every if row != left])), views.subset([left]))
        for left in every
    ]
    found["ours, all views"] = [errors(methods["ours"](views), views)]
    found["least squares, all views"] = [errors(_least_squares(views, lens), views)]
    table, figures = table_of(found)
    own = _own_errors(views, lens)
    remarks = [
        f"The square is found in {len(views)} of {images} images.",
        f"{_FITTED} views are fitted, the others predicted; {_SPLITS} random splits. mm: distances from rays.",
        "The rows of all views judge the views that were fitted: nothing is predicted.",
        f"The corners of a view are {own:.2f} px off the best pose of that view alone (median): joints limit this.",
    ]
    return Outcome(table, remarks, {"views": len(views), "images": images, "own_px": own, "methods": figures})


def _ours(train: Observations, lens: Intrinsics, *, fits_joints: bool) -> Mount:
    setting = Setting(lens="pinhole", fits_joints=fits_joints, joint_std=ROUNDING)
    return Mount.of(solve(train, lens, setting).fitted.parameters)


def _powell(train: Observations, lens: Intrinsics, *, fits_lens: bool) -> Mount:
    """The mount of least mean distance (mm) of the corners, from the same start as ours."""
    start = find_start(train, lens, 0)
    model = ViewModel(train.reordered(start.orders))
    slips = np.tile(np.eye(4), (len(train), 1, 1))

    def mount(numbers: Array) -> Mount:
        focal, cx, cy = _FOCAL_STEP * numbers[12:] if fits_lens else np.zeros(3)
        moved = Intrinsics(lens.fx + focal, lens.fy + focal, lens.cx + cx, lens.cy + cy, lens.width, lens.height)
        return Mount(start.mount @ exp(numbers[:6]).matrix, start.target @ exp(numbers[6:12]).matrix, moved)

    def cost(numbers: Array) -> float:
        guess = mount(np.asarray(numbers, np.float64))
        now = Parameters(guess.camera, guess.target, 0.0, guess.intrinsics, slips, np.zeros(0))
        found = np.linalg.norm(model.residuals(now), axis=2) * model.points(now)[..., 2] / guess.intrinsics.fx
        return 1e3 * float(found.mean()) if np.isfinite(found).all() else _WORST

    found = minimize(cost, np.zeros(15 if fits_lens else 12), method="Powell")
    return mount(np.asarray(found.x, np.float64))


def _least_squares(train: Observations, lens: Intrinsics) -> Mount:
    """Mount, target and its size, lens and a constant error of each joint that leave the least squares of the mm."""
    start = find_start(train, lens, 0)
    model = ViewModel(train.reordered(start.orders))
    effects = train.joint_effects
    assert effects is not None

    def mount(numbers: Array) -> Mount:
        focal, cx, cy = _FOCAL_STEP * numbers[12:15]
        moved = Intrinsics(lens.fx + focal, lens.fy + focal, lens.cx + cx, lens.cy + cy, lens.width, lens.height)
        camera, target = start.mount @ exp(numbers[:6]).matrix, start.target @ exp(numbers[6:12]).matrix
        return Mount(camera, target, moved, float(numbers[15]), numbers[16:])

    def off(numbers: Array) -> Array:
        guess = mount(np.asarray(numbers, np.float64))
        assert guess.offsets is not None
        slips = np.array([exp(effect @ guess.offsets).matrix for effect in effects])
        now = Parameters(guess.camera, guess.target, guess.scale, guess.intrinsics, slips, np.zeros(0))
        mm = 1e3 * model.residuals(now) * model.points(now)[..., 2:] / guess.intrinsics.fx
        return np.nan_to_num(mm, nan=_WORST).ravel()

    return mount(np.asarray(least_squares(off, np.zeros(16 + effects.shape[2])).x, np.float64))


def _own_errors(views: Observations, lens: Intrinsics) -> float:
    """px, the median view's root mean square distance of its corners from those of the pose that fits them best."""
    model = ViewModel(views.reordered(find_start(views, lens, 0).orders))
    found = []
    for pixels in model.observations.pixels:
        rays = np.ascontiguousarray(lens.rays(pixels)[:, :2])
        _, turn, move = cv2.solvePnP(views.points, rays, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        turn, move = cv2.solvePnPRefineLM(views.points, rays, np.eye(3), None, turn, move)
        seen = lens.project(Pose.from_rotvec(move.ravel(), turn.ravel()).apply(views.points))
        found.append(math.sqrt(float(((seen - pixels) ** 2).sum(axis=1).mean())))
    return float(np.median(found))


def _read(folder: Path) -> tuple[Observations, Intrinsics, int]:
    (file,) = needed(folder, "views.json")
    try:
        told = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(f"{file} is no JSON") from error
    target = read_target(f"square:{told['square_side_m']}")
    images = read_images(needed(folder, *told["images"]))
    found = [target.find(image) for image in images]
    rows = [index for index, corners in enumerate(found) if corners is not None]
    chain = read_chain(_URDF, "", "end_effector_link")
    hands = ToldHands((), *joint_poses(chain, np.array(told["joints_rad"], np.float64)[rows]), chain.names)
    height, width = images[0].shape
    focal = told["focal_px_authors"]
    cx, cy = told["principal_point_px_authors"]
    lens = Intrinsics(focal, focal, cx, cy, width, height)
    pixels, names = np.array([found[index] for index in rows]), [told["images"][index] for index in rows]
    views = observed(names, hands, pixels, target, (width, height), Setting(joint_std=ROUNDING))
    return views, lens, len(images)


BENCHMARK = RealBenchmark(
    "gen3",
    f"""Hand-eye calibration of a real Gen3's wrist camera by a printed square, beside Powell's method.

Corners are predicted from joint angles, by a mount fitted to {_FITTED} other views.""",
    "Published without a licence: GitHub robocomp/manipulation_kinova_gen3 (b5afddf).\n"
    "Needed: views.json (joints_rad, images, square_side_m, focal and principal point in px) and the images.",
    run,
)
