"""How well does our runner of MediaPipe's model find hands in real photos? Beside MediaPipe's own programs.

    python -m benchmarks.real hands --data PHOTOS --mediapipe hands-env/bin/python

PHOTOS is a folder of pictures with hands (.jpg, .png), subfolders included. Without it, the three photos of the tests
are looked at (npm fingerpose 0.1.0, MIT). MediaPipe's repository has 40 photos of the data set HaGRID, in
mediapipe/model_maker/python/vision/gesture_recognizer/testdata; they show real persons and are not in this project.

`--mediapipe` names the Python of another environment, with mediapipe 0.10.21: `python3.11 -m venv hands-env;
hands-env/bin/pip install mediapipe==0.10.21`. That version has two programs with these networks: `graph`, the one
published with them (mediapipe.solutions.hands), and `tasks`. Later versions have `tasks` alone. Without it, only what
ours finds is told.

`found` counts hands. A row of two compares the hands that both found: the share with the same side, and the mean
distance of the 21 landmarks, in the image in % of a palm's length (wrist to middle knuckle), in space in mm, median and
95 %. `ours, turned` turns its first square by 26.6 degrees too far, as `tasks` does: that takes 90 for degrees where
radians are expected, and 90 rad is a quarter turn and 26.6 degrees. `ms` is processor time a photo, without loading.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import time
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from agents.frame_images import Color
from agents.hand_tracker.config import HandTrackerConfig
from agents.hand_tracker.drawing import drawn
from agents.hand_tracker.model.files import ModelFiles
from agents.hand_tracker.model.found import FoundHand
from agents.hand_tracker.model.litert import LiteRtLandmarker
from agents.hand_tracker.model.loading import configured_model
from agents.hand_tracker.model.regions import Region
from agents.hand_tracker.sighting import Side
from dsr.errors import ConfigError

NAME = "hands"
"""What this is called on the command line of `python -m benchmarks.real`."""
FIXTURES = Path(__file__).parents[2] / "tests" / "agents" / "hand_tracker" / "photos"
SAME = 1.0
"""Palm lengths between landmarks of two hands, on average, up to which they are one hand."""
TOO_FAR = 90.0 - 14 * 2 * math.pi - math.pi / 2
"""rad, by which `tasks` turns a square about a palm too far"""
_PALM_SCALE, _PALM_SHIFT = 2.6, 0.5  # of the square about a palm, as in agents/hand_tracker/model/regions.py
_SUFFIXES = (".jpg", ".jpeg", ".png")

Found = dict[str, list[FoundHand]]
"""Hands by photo."""


class _Turned(LiteRtLandmarker):
    """As `tasks` lays its squares."""

    def _palms(self, color: Color) -> list[Region]:
        return [_turned(region) for region in super()._palms(color)]


def main(arguments: Sequence[str]) -> None:
    """Measure what the command line asks for and print the tables."""
    options = _parser().parse_args(arguments)
    photos = _photos(options.data)
    try:
        files = configured_model(HandTrackerConfig(model=options.model))
        programs, seconds = _ours(files, photos)
    except ConfigError as error:
        raise SystemExit(f"hands: {error}") from None
    version = ""
    if options.mediapipe:
        version, theirs, their_seconds = _theirs(options.mediapipe, files.where, photos)
        programs |= theirs
        seconds |= their_seconds
    pairs = [(a, b) for a, b in _PAIRS if a in programs and b in programs]
    report = {
        "photos": len(photos),
        "mediapipe": version,
        "found": {name: _counts(found, seconds[name]) for name, found in programs.items()},
        "compared": [{"pair": pair, **_compare(*(programs[name] for name in pair))} for pair in pairs],
    }
    if options.out:
        _draw(options.out, photos, programs["ours"])
    _show(report)
    if options.json:
        options.json.write_text(json.dumps(report, indent=1), encoding="utf-8")


_PAIRS = (("ours", "graph"), ("ours", "tasks"), ("ours, turned", "tasks"), ("tasks", "graph"))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m benchmarks.real hands", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=FIXTURES, metavar="DIR", help="folder of photos")
    parser.add_argument(
        "--mediapipe", default="", metavar="PYTHON", help="also MediaPipe's programs, run by this Python"
    )
    parser.add_argument("--model", default="", metavar="FILE", help="default: the one that `dsr hands fetch` got")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write the photos there with our hands drawn in")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the report to this file, in SI units")
    return parser


def _photos(folder: Path) -> list[Path]:
    photos = sorted(file for file in folder.rglob("*") if file.suffix.lower() in _SUFFIXES)
    if not photos:
        raise SystemExit(f"hands: no photos in {str(folder)!r}; expected files {', '.join(_SUFFIXES)}")
    return photos


def _ours(files: ModelFiles, photos: Iterable[Path]) -> tuple[dict[str, Found], dict[str, list[float]]]:
    programs: dict[str, Found] = {"ours": {}, "ours, turned": {}}
    seconds: dict[str, list[float]] = {name: [] for name in programs}
    for photo in photos:
        for name, kind in (("ours", LiteRtLandmarker), ("ours, turned", _Turned)):
            with closing(kind(files, HandTrackerConfig().least_score)) as landmarker:
                begun = time.process_time()
                programs[name][str(photo)] = landmarker.detect(_read(photo), 0)
                seconds[name].append(time.process_time() - begun)
    return programs, seconds


def _theirs(python: str, model: str, photos: Sequence[Path]) -> tuple[str, dict[str, Found], dict[str, list[float]]]:
    """MediaPipe's version, and what its programs find. Ends the program if they cannot be run."""
    script = Path(__file__).with_name("mediapipe_peer.py")
    try:
        done = subprocess.run(
            [python, str(script), model, *map(str, photos)], capture_output=True, text=True, check=True
        )
    except FileNotFoundError:
        raise SystemExit(f"hands: no Python {python!r}") from None
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"hands: MediaPipe failed:\n{error.stderr[-2000:]}") from None
    told = json.loads(done.stdout)
    found = {name: {photo: list(map(_hand, row["hands"])) for photo, row in rows.items()}
             for name, rows in told["programs"].items()}  # fmt: skip
    seconds = {name: [row["seconds"] for row in rows.values()] for name, rows in told["programs"].items()}
    return str(told["version"]), found, seconds


def _hand(told: dict[str, Any]) -> FoundHand:
    side: Side = told["side"]
    return FoundHand(np.array(told["landmarks"]), np.array(told["shape"]), side, 1.0)


def _turned(region: Region) -> Region:
    """The same palm's square, turned too far and moved along that."""
    far = _PALM_SHIFT * region.side / _PALM_SCALE
    x, y = (at + sign * far * part(region.turn) for at, sign, part in zip(
        region.centre, (-1.0, 1.0), (math.sin, math.cos), strict=True))  # fmt: skip
    turn = region.turn + TOO_FAR
    return Region((x + far * math.sin(turn), y - far * math.cos(turn)), region.side, turn)


def _read(photo: Path) -> NDArray[np.uint8]:
    image = cv2.imread(str(photo))
    if image is None:
        raise SystemExit(f"hands: {str(photo)!r} is no picture that can be read")
    return np.ascontiguousarray(image[..., ::-1], np.uint8)


def _counts(found: Found, seconds: list[float]) -> dict[str, Any]:
    return {
        "hands": sum(map(len, found.values())),
        "photos_with_hands": sum(bool(hands) for hands in found.values()),
        "median_cpu_s": float(np.median(seconds)),
    }


def _compare(mine: Found, theirs: Found) -> dict[str, Any]:
    """Of the hands that both found."""
    image, space, sides = [], [], []
    alone = 0
    for photo, hands in theirs.items():
        for hand in hands:
            length = float(np.linalg.norm(hand.landmarks[9, :2] - hand.landmarks[0, :2]))
            off = {k: float(np.linalg.norm(other.landmarks[:, :2] - hand.landmarks[:, :2], axis=1).mean()) / length
                   for k, other in enumerate(mine[photo])}  # fmt: skip
            nearest = min(off, key=lambda k: off[k], default=None)
            if nearest is None or off[nearest] > SAME:
                alone += 1
                continue
            other = mine[photo][nearest]
            image.append(off[nearest])
            space.append(float(np.linalg.norm(other.shape - hand.shape, axis=1).mean()))
            sides.append(other.side == hand.side)
    return {
        "both": len(image),
        "only_second": alone,
        "only_first": sum(map(len, mine.values())) - len(image),
        "same_side": float(np.mean(sides)) if sides else None,
        **_quantiles("image_palm_lengths", image),
        **_quantiles("space_m", space),
    }


def _quantiles(name: str, values: list[float]) -> dict[str, float | None]:
    shares = (("median", 0.5), ("p95", 0.95))
    return {f"{name}_{label}": float(np.quantile(values, share)) if values else None for label, share in shares}


def _draw(folder: Path, photos: Iterable[Path], found: Found) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for photo in photos:
        cv2.imwrite(str(folder / f"{photo.stem}.png"), drawn(_read(photo), found[str(photo)])[..., ::-1])


def _show(report: dict[str, Any]) -> None:
    console = Console()
    title = f"{report['photos']} photos" + (f", mediapipe {report['mediapipe']}" if report["mediapipe"] else "")
    table = Table("program", "hands found", "photos with hands", "ms", title=title)
    for name, row in report["found"].items():
        table.add_row(name, str(row["hands"]), str(row["photos_with_hands"]), f"{row['median_cpu_s'] * 1e3:.0f}")
    console.print(table)
    if not report["compared"]:
        return
    table = Table("pair", "both", "only one", "same side", "image, % palm", "space, mm")
    for row in report["compared"]:
        image = "{:.2f} / {:.2f}".format(*(100 * row[f"image_palm_lengths_{k}"] for k in ("median", "p95")))
        space = "{:.2f} / {:.2f}".format(*(1e3 * row[f"space_m_{k}"] for k in ("median", "p95")))
        only = f"{row['only_first']} + {row['only_second']}"
        table.add_row(" - ".join(row["pair"]), str(row["both"]), only, f"{row['same_side']:.0%}", image, space)
    console.print(table)
