"""Draws the pictures of the docs: what is found in images whose licence lets them be shown.

    python -m benchmarks.pictures docs/images --grid DIR

`hands_found.jpg`: the real model on photos of the tests and on hands that the plant renders. `tags_found.jpg`: tags on
cubes that the plant renders, as the overhead camera of a scenario sees them. `grid_found.jpg`, with --grid: a grid of
circles in a photo of the recording of `python -m benchmarks.real hand-eye`, whose --data is DIR.
"""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from agents.frame_images import images
from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.drawing import drawn
from agents.hand_tracker.model.loading import load_landmarker
from agents.plant.config import PlantConfig
from agents.plant.reality import Reality
from agents.plant.world import RATE_HZ, STEP
from agents.scenario.format.scenario import HandEnter, Scenario, find_scenario, load_scenario
from agents.scene_estimator.config import SceneEstimatorConfig
from agents.scene_estimator.detection import TagDetector
from agents.scene_estimator.pose import estimate_tag_pose
from benchmarks.real import hand_eye
from benchmarks.real.drawing import Picture, closeup, draw_tag

_PHOTOS = Path(__file__).parents[1] / "tests/agents/hand_tracker/photos"
_HEIGHT = 360
"""px, of the pictures that stand beside each other"""
_SHOWN = "8.png"
"""Of the recording: the grid is seen askew there"""
_HOVERING = "hovering"
"""The scenario with the tags"""


def main() -> None:
    """Write what the command line asks for."""
    options = _parser().parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.folder / "hands_found.jpg"), hands())
    cv2.imwrite(str(options.folder / "tags_found.jpg"), tags())
    if options.grid is not None:
        cv2.imwrite(str(options.folder / "grid_found.jpg"), dict(hand_eye.draw(options.grid))[_SHOWN])


def hands() -> Picture:
    """Photos, and a picture of rendered hands, with the bones of the hands that the model finds."""
    photos = [np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1] for path in sorted(_PHOTOS.glob("*.jpg"))]
    shown = []
    for color in (*photos, _rendered_hands()):
        with closing(load_landmarker(HandTrackerConfig(finder="model"))()) as landmarker:
            picture = drawn(color, landmarker.detect(np.ascontiguousarray(color), 0))[..., ::-1]
        shown.append(_of_height(np.ascontiguousarray(picture)))
    return np.asarray(np.hstack(shown), np.uint8)


def tags() -> Picture:
    """Close-ups of tags on rendered cubes, with the corners that are found, and outline and axes of the pose."""
    config = SceneEstimatorConfig()
    scenario = load_scenario(find_scenario(_HOVERING))
    with closing(Reality(scenario, PlantConfig(sensor="pixels"), 0)) as reality:
        color, depth, lens = images(reality.frame(0.0))
    sizes = {spec.marker_id: config.tag_ratio * min(spec.size[:2]) for spec in scenario.objects}
    shown = []
    for tag in TagDetector().detect(color):
        side = sizes[tag.marker_id]
        picture, enlarged, there = closeup(np.ascontiguousarray(color[..., ::-1]), tag, lens)
        draw_tag(picture, enlarged, estimate_tag_pose(tag, depth, lens, side, config.noise), side, there)
        shown.append(_of_height(picture))
    return np.asarray(np.hstack(shown), np.uint8)


def _of_height(picture: NDArray[np.uint8]) -> Picture:
    """As large as the others beside it."""
    width = round(picture.shape[1] * _HEIGHT / picture.shape[0])
    return np.asarray(cv2.resize(picture, (width, _HEIGHT), interpolation=cv2.INTER_AREA), np.uint8)


def _rendered_hands() -> NDArray[np.uint8]:
    """Two hands above the table, as the overhead camera sees them."""
    enter = [
        HandEnter(at=0.1, hand=number, position=(0.35, y, 0.08), side=(0.9, y)) for number, y in enumerate((-0.1, 0.1))
    ]
    scenario = Scenario(name="hands", title="", duration=3.0, objects=[], events=list(enter))
    with closing(Reality(scenario, PlantConfig(sensor="pixels"), 0)) as reality:
        for step in range(2 * RATE_HZ):
            reality.step(step * STEP)
        return images(reality.frame(2.0))[0]


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("python -m benchmarks.pictures", description=__doc__, formatter_class=raw)
    parser.add_argument("folder", type=Path, help="where they are written")
    parser.add_argument("--grid", type=Path, metavar="DIR", help="the recording with the grid")
    return parser


if __name__ == "__main__":
    main()
