"""What share of the hands that the plant renders does the real model find? By distance, view, figure and brightness.

    python -m benchmarks.rendered_hands
    python -m benchmarks.rendered_hands --renderer tiny --json rendered.json --out pictures

A hand is put before a camera of 640 x 480 (focal length 600 px) in eight directions, right and left, open and with a
cube in a pinch or under two fingertips. The camera looks at the hand from above, or inclined from the side of the
fingers (-) or the wrist (+). Every image is looked at as if there had been none before, so nothing is found by
following it. `found` is the share of hands with a landmark hand whose palm is less than a palm's length off; `side` how
many of those have the right side; `palm` and `tips` are errors in the image of the palm's middle and of the fingertips
in sight, in mm at the hand, median / 95 %; `false` counts hands found where none is.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.drawing import drawn
from agents.hand_tracker.model.found import FoundHand
from agents.hand_tracker.model.loading import load_landmarker
from agents.hand_tracker.sighting import PALM, TIPS
from agents.plant.config import PlantConfig
from agents.plant.hand_figure import palm_pose, relaxed
from agents.plant.hand_grips import take
from agents.plant.hand_sensor import landmarks_in_view
from agents.plant.hands import SimulatedHand
from agents.plant.reality import Reality
from agents.plant.renderer import RendererName
from agents.scenario.format.scenario import Event, HandEnter, ObjectSpec, Scenario
from dsr.errors import ConfigError
from dsr.math3d import quaternions
from dsr.math3d.transforms import Pose

Array = NDArray[np.float64]
Figure = Literal["open", "pinch", "touch"]
Kind = tuple[float, float, float]
"""Distance (m), view (degrees) and brightness."""

DISTANCES = (0.35, 0.5, 0.65, 0.9, 1.2, 1.6)
"""m, from the camera to the hand"""
VIEWS = (-50.0, -25.0, 0.0, 25.0, 50.0)
"""degrees, by which the camera leaves the vertical, towards the wrist's side if positive"""
FIGURES: tuple[Figure, ...] = ("open", "pinch", "touch")
BRIGHTNESSES = (1.0, 0.5, 0.25, 0.12)
"""Factors of the image's light."""
DIRECTIONS = 8
USUAL = 0.65
"""m, the distance at which view, figure and brightness are varied: that of the overhead camera to the table"""
_PLACE = np.array([0.35, 0.0, 0.02])


class Look(NamedTuple):
    """One hand in one image."""

    found: bool
    right_side: bool
    palm: float
    """m"""
    tips: list[float]
    """m"""
    false: int


def main() -> None:
    """Measure what the command line asks for and print a row for each kind of view."""
    options = _parser().parse_args()
    try:
        load_landmarker(HandTrackerConfig())().close()
    except ConfigError as error:
        raise SystemExit(f"rendered_hands: {error}") from None
    kinds = [*((distance, 0.0, 1.0) for distance in DISTANCES), *((USUAL, view, 1.0) for view in VIEWS)]
    kinds = list(dict.fromkeys([*kinds, *((USUAL, 0.0, brightness) for brightness in BRIGHTNESSES)]))
    looks: dict[tuple[Figure, Kind], list[Look]] = {(figure, kind): [] for kind in kinds for figure in FIGURES}
    stages = [(figure, number) for figure in FIGURES for number in (0, 1)]
    for figure, number in track(stages, "hands", console=Console(stderr=True), transient=True):
        for kind, look in _looks(figure, number, kinds, options.renderer, options.out):
            looks[figure, kind].append(look)
    rows = [_row(figure, kind, seen) for (figure, kind), seen in looks.items()]
    Console().print(_table(rows))
    if options.json:
        options.json.write_text(json.dumps({"rows": rows}, indent=1), encoding="utf-8")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.rendered_hands",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--renderer", default="auto", choices=("auto", "opengl", "tiny"), help="default: auto")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write the images there with what was found drawn in")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file, in SI units")
    return parser


def _looks(
    figure: Figure, number: int, kinds: list[Kind], renderer: RendererName, out: Path | None
) -> Iterator[tuple[Kind, Look]]:
    """A hand of a figure in all directions and views."""
    events: list[Event] = [HandEnter(at=60.0, hand=number, position=(0.35, 0.0, 0.2))]
    cube = ObjectSpec(name="cube", marker_id=3, position=(0.35, 0.0, 0.02))
    objects = [] if figure == "open" else [cube]
    scenario = Scenario(name="views", title="", duration=90.0, objects=objects, events=events)
    with closing(Reality(scenario, PlantConfig(sensor="pixels", renderer=renderer), number)) as reality:
        hand, camera = reality.hands[number], reality.camera
        for step in range(DIRECTIONS):
            turn = 2 * math.pi * (step + 0.3 * number) / DIRECTIONS
            _put(reality, hand, figure, turn)
            for kind in kinds:
                distance, view, brightness = kind
                camera.bump(camera.pose.inverse() @ _camera(distance, math.radians(view), turn))
                image = np.asarray(reality.frame(0.0).arrays["color"] * brightness, np.uint8)
                with closing(load_landmarker(HandTrackerConfig())()) as landmarker:
                    found = landmarker.detect(image, 0)
                if out is not None:
                    _draw(out / f"{figure}_{distance}_{view}_{brightness}_{number}_{step}.png", image, found)
                yield kind, _look(reality, hand, found)


def _camera(distance: float, view: float, turn: float) -> Pose:
    """world_from_camera, `distance` m from the hand's middle, inclined by `view` rad against the hand's direction."""
    away = np.array([math.cos(turn) * math.sin(view), math.sin(turn) * math.sin(view), math.cos(view)])
    down = quaternions.from_rotvec((math.pi, 0.0, 0.0))
    axis = np.array([-math.sin(turn), math.cos(turn), 0.0]) * view
    tilt = quaternions.from_rotvec((float(axis[0]), float(axis[1]), 0.0))
    place = _PLACE + (0.0, 0.0, 0.03) + distance * away
    return Pose((float(place[0]), float(place[1]), float(place[2])), quaternions.product(tilt, down))


def _put(reality: Reality, hand: SimulatedHand, figure: Figure, turn: float) -> None:
    """The hand over the table, coming from direction `turn` (rad), alone or at the cube."""
    side = (math.cos(turn), math.sin(turn))
    hand.is_present, hand.from_side = True, side
    if figure == "open":
        place = _PLACE + np.array([0.03 * side[0], 0.03 * side[1], 0.07])
        hand.pose = palm_pose((float(place[0]), float(place[1]), float(place[2])), side, 0.2)
        hand.tips = relaxed(hand.side)
    else:
        grip = take(reality.world, hand, "cube", figure, side, None)
        hand.pose, hand.tips = grip.pose, grip.closed


def _look(reality: Reality, hand: SimulatedHand, found: list[FoundHand]) -> Look:
    camera = reality.camera
    there = camera.pose.inverse().apply(hand.landmarks)
    pixels = camera.intrinsics.project(there) + 0.5
    per_pixel = float(there[:, 2].mean()) / camera.intrinsics.fx
    length = float(np.linalg.norm(pixels[9] - pixels[0]))
    middle = pixels[list(PALM)].mean(axis=0)
    off = [float(np.linalg.norm(one.landmarks[list(PALM), :2].mean(axis=0) - middle)) for one in found]
    near = [k for k, distance in enumerate(off) if distance < length]
    if not near:
        return Look(False, False, 0.0, [], len(found))
    best = min(near, key=lambda k: off[k])
    errors = np.linalg.norm(found[best].landmarks[:, :2] - pixels, axis=1) * per_pixel
    seen = landmarks_in_view(camera, reality.world, reality.hands, hand)
    tips = [float(errors[tip]) for tip in TIPS if seen[tip]]
    return Look(True, found[best].side == hand.side, off[best] * per_pixel, tips, len(found) - len(near))


def _draw(file: Path, image: NDArray[np.uint8], found: list[FoundHand]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(file), drawn(image, found)[..., ::-1])


def _row(figure: Figure, kind: Kind, looks: list[Look]) -> dict[str, Any]:
    """In SI units."""
    distance, view, brightness = kind
    seen = [look for look in looks if look.found]
    return {
        "figure": figure,
        "distance_m": distance,
        "view_rad": math.radians(view),
        "brightness": brightness,
        "hands": len(looks),
        "found": len(seen) / len(looks),
        "right_side": sum(look.right_side for look in seen) / len(seen) if seen else None,
        "false": sum(look.false for look in looks),
        **_quantiles("palm", [look.palm for look in seen]),
        **_quantiles("tips", [error for look in seen for error in look.tips]),
    }


def _quantiles(name: str, errors: list[float]) -> dict[str, float | None]:
    shares = (("median", 0.5), ("p95", 0.95))
    return {f"{name}_{label}_m": float(np.quantile(errors, share)) if errors else None for label, share in shares}


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Rendered hands that the model finds; errors in mm, median / 95 %")
    for heading in ("distance, view, light", "figure", "found", "side", "false", "palm", "tips"):
        table.add_column(heading, justify="left" if heading in ("distance, view, light", "figure") else "right")
    for row in rows:
        view = f"{row['distance_m']:.2f} m, {math.degrees(row['view_rad']):.0f}°, {row['brightness']:.0%}"
        side = "-" if row["right_side"] is None else f"{row['right_side']:.0%}"
        errors = [_pair(row, name) for name in ("palm", "tips")]
        table.add_row(view, row["figure"], f"{row['found']:.0%}", side, str(row["false"]), *errors)
    return table


def _pair(row: dict[str, Any], name: str) -> str:
    values = [row[f"{name}_{label}_m"] for label in ("median", "p95")]
    return " / ".join("-" if value is None else f"{value * 1e3:.0f}" for value in values)


if __name__ == "__main__":
    main()
