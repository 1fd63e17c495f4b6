"""Learns how likely cameras recognise a thing of which they see a part, by the plant alone: no belief takes part."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from agents.plant.config import PlantConfig
from agents.scenario.format.model import CameraSpec, Scenario
from agents.scenario.generate.episode import generate
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import make_run
from agents.scenario.truth.history import History
from benchmarks.learning.rates import Vector
from dsr.believing.absence import Recognition
from dsr.math3d.transforms import Pose
from dsr.vocabulary.intrinsics import Intrinsics
from simulation_handler.perception.visibility import CameraView, RayVisibility
from simulation_handler.shapes.geometry import Solid

Array = NDArray[np.float64]

CURVES = Recognition(tag=0.5, tag_width=0.1, color=0.5, color_width=0.1)
"""To which little evidence is drawn"""
_PRIOR = (0.5, 1.5)  # 1, standard deviations around that: of the half, and of the logarithm of the width
_PERIOD = 0.5  # s between two looks
_ALIKE = 0.05  # of the share, within which looks at one thing say the same, and count once


class Look(NamedTuple):
    """One moment of one thing that rests."""

    thing: str
    """Names of episode and thing"""
    tagged: bool
    share: float
    """1, of its tag or image, that is to be seen by the model of visibility"""
    is_recognised: bool
    """By the plant's account."""


def looks_at(family: str, seed: int) -> list[Look]:
    """Play an episode by the plant alone, and look at its things."""
    with tempfile.TemporaryDirectory(prefix="dsr-learning-") as folder:
        file = Path(folder) / f"{family}-{seed}.toml"
        file.write_text(generate(family, seed).text, encoding="utf-8")
        return list(_looks(true_course(make_run(file, seed=seed, sensor="poses"), sensor="poses")))


def learn_recognition(looks: Sequence[Look]) -> tuple[Recognition, Vector]:
    """The posterior means of both curves, and their standard errors: of widths, those of their logarithms."""
    found: dict[str, float] = {}
    errors: Vector = {}
    for name, tagged in (("tag", True), ("color", False)):
        alike = {
            (one.thing, round(one.share / _ALIKE), one.is_recognised): one for one in looks if one.tagged == tagged
        }
        shares = np.array([one.share for one in alike.values()])
        seen = np.array([one.is_recognised for one in alike.values()], dtype=bool)
        begin = getattr(CURVES, name), getattr(CURVES, f"{name}_width")
        for field, value, error in zip((name, f"{name}_width"), *_learn_curve(shares, seen, begin), strict=True):
            found[field], errors["recognition", field] = value, error
    return msgspec.convert(found, Recognition), errors


def shares_of(scenario: Scenario, places: Mapping[str, Pose]) -> dict[str, float]:
    """Share (0 to 1) of the tag or image of each thing that the camera sees, if all are at these places."""
    assert isinstance(scenario.camera, CameraSpec), "random episodes have a camera on a stand"
    config = PlantConfig()
    lens = Intrinsics.from_fov(config.width, config.height, config.fov)
    rays = RayVisibility(
        [CameraView("camera", scenario.camera.pose, lens)],
        by_color=[spec.name for spec in scenario.objects if spec.marker_id is None],
    )
    solids = [
        Solid(spec.name, spec.size, places[spec.name].t, places[spec.name].q, shape=spec.shape)
        for spec in scenario.objects
        if spec.name in places
    ]
    return {name: share for (_, name), share in rays.shares(solids).items()}


def _looks(history: History) -> Iterator[Look]:
    """Without moments in which the camera is covered, something moves, or a hand is there that may hide things."""
    scenario, due = history.scenario, 0.0
    tagged = {spec.name for spec in scenario.objects if spec.marker_id is not None}
    for sample in history.samples:
        if sample.time >= due and sample.in_view and not (sample.moving or sample.grasped or sample.touched):
            due = sample.time + _PERIOD
            for name, share in shares_of(scenario, sample.truth).items():
                yield Look(f"{scenario.name} {name}", name in tagged, share, name in sample.in_view)


def _learn_curve(
    shares: Array, seen: NDArray[np.bool_], begin: tuple[float, float]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Logistic regression: half and width, and their standard errors, by a grid of halves and logarithms of widths."""
    half, log = np.meshgrid(np.linspace(0.0, 1.0, 101), np.linspace(math.log(0.01), math.log(0.5), 81), indexing="ij")
    cost = 0.5 * ((half - begin[0]) / _PRIOR[0]) ** 2 + 0.5 * ((log - math.log(begin[1])) / _PRIOR[1]) ** 2
    for share, is_seen in zip(shares.tolist(), seen.tolist(), strict=True):
        cost += np.logaddexp(0.0, (half - share if is_seen else share - half) / np.exp(log))
    weights = np.exp(cost.min() - cost)
    weights /= weights.sum()
    middle, logarithm = (float((weights * values).sum()) for values in (half, log))
    errors = [
        math.sqrt(float((weights * (values - mean) ** 2).sum())) for values, mean in ((half, middle), (log, logarithm))
    ]
    return (middle, math.exp(logarithm)), (errors[0], errors[1])
