"""The commands `dsr hands fetch | status | try`: get the real model of hands, and see what it finds."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import JsonOption, add_names, add_numbers, console, errors, for_people, print_json, shown
from dsr.errors import ConfigError
from dsr.files.data_files import read_file

_MOST_BYTES = 64 << 20
"""Of a picture: one of 20 megapixels has less without compression"""

app = typer.Typer(name="hands", no_args_is_help=True, help="Get the real model of hands, and see what it finds.")


class RunnerChoice(enum.StrEnum):
    """Values of `--runner`."""

    LITERT = "litert"
    MEDIAPIPE = "mediapipe"


@app.callback()
def hands() -> None:
    """Get the real model of hands, and see what it finds."""


@app.command()
def fetch(
    to: Annotated[Path | None, typer.Option(metavar="FILE", help="Put it there instead of your cache folder.")] = None,
    from_wheel: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Take it out of this wheel of mediapipe, without a network.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Also if it is there already, and whole.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Get MediaPipe's model of hands (Apache-2.0), which hand trackers then use.

    It is part of a wheel of the package mediapipe, which pip downloads as it is configured on this machine (36 MB).
    Of that 8 MB are kept: a file hand_landmarker.task with the two networks, whose checksums are known.
    To run it: pip install 'dsr-memory[hands]'. To find hands by their colour all the same: finder = "colour".
    """
    from agents.hand_tracker.model import fetch as fetching
    from agents.hand_tracker.model.files import check_contents, fetched_file, read_model, write_model

    file = to or fetched_file()
    said = for_people(as_json)
    if not force and file.exists():
        try:
            there = read_model(file)
            check_contents(there.contents, there.where)
        except ConfigError as error:
            said.print(f"fetching it anew: {shown(str(error))}", soft_wrap=True)
        else:
            if from_wheel is None:
                _tell_fetched(file, as_json=as_json, new=False)
                return
    fetching.check_place(file)
    if from_wheel is not None:
        contents = fetching.from_wheel(from_wheel)
    else:
        contents = fetching.from_index(errors.print, quiet=as_json)
    try:
        write_model(contents, file)
    except OSError as error:
        raise ConfigError(f"the model was not kept: {fetching.why_not_written(error, file)}") from error
    _tell_fetched(file, as_json=as_json, new=True)


@app.command()
def status(as_json: JsonOption = False) -> None:
    """Tell whether the model is there and whole, what can run it here, and how hands are found by default.

    The exit code is 0 if the default finder of hands is the model, and it works.
    """
    from agents.hand_tracker.config import HandTrackerConfig
    from agents.hand_tracker.model.files import fetched_file
    from agents.hand_tracker.model.loading import load_landmarker, wants_model

    config = HandTrackerConfig()
    wrong = ""
    try:
        load_landmarker(config)().close()
    except ConfigError as error:
        wrong = str(error)
    finder = "model" if wants_model(config) and not wrong else "colour"
    if as_json:
        print_json({"file": str(fetched_file()), "finder": finder, "wrong": wrong})
    else:
        console.print(f"model   {fetched_file()}", soft_wrap=True)
        console.print(f"state   {shown(wrong) or 'whole, and LiteRT runs it'}", soft_wrap=True)
        told = "by the model" if finder == "model" else "by skin colour and depth"
        console.print(f"hands   are found {told}, unless `finder` says otherwise")
    raise typer.Exit(0 if finder == "model" else 1)


@app.command("try")
def try_images(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE...", help="Pictures with hands.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Also write the pictures there with the hands drawn in.")
    ] = None,
    model: Annotated[str, typer.Option(metavar="FILE", help="Instead of the fetched one.")] = "",
    runner: Annotated[RunnerChoice, typer.Option(help="What runs the model.")] = RunnerChoice.LITERT,
    as_json: JsonOption = False,
) -> None:
    """Find hands in pictures with the model: how many, which, how sure, where their index fingertips are.

    The exit code is 0 if hands were found in all of them.
    """
    drawings = _drawings(images, out)
    rows = [_look(image, drawing, model, runner) for image, drawing in zip(images, drawings, strict=True)]
    if as_json:
        print_json(rows)
    else:
        console.print(_table(rows))
    raise typer.Exit(0 if all(row["hands"] for row in rows) else 1)


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "picture", "hand")
    add_numbers(table, "sure", "index fingertip")
    for row in rows:
        for hand in row["hands"] or [None]:
            place = "" if hand is None else "{:.0f}, {:.0f} px".format(*hand["landmarks_px"][8])
            sure = "" if hand is None else f"{hand['side_score']:.0%}"
            table.add_row(shown(row["picture"]), "none" if hand is None else hand["side"], sure, place)
    return table


def _drawings(images: list[Path], out: Path | None) -> list[Path | None]:
    """The file for each picture's drawing. Raises `ConfigError` if one would take the place of another picture."""
    if out is None:
        return [None for _ in images]
    files = [out / f"{image.stem}.png" for image in images]
    if len(set(files)) < len(files):
        raise ConfigError(f"--out {out}: two of the pictures have one name; try them one after the other")
    if taken := {file.resolve() for file in files} & {image.resolve() for image in images}:
        raise ConfigError(f"--out {out}: {min(taken).name} would be overwritten; name another folder")
    return list(files)


def _look(image: Path, drawing: Path | None, model: str, runner: RunnerChoice) -> dict[str, Any]:
    """What is found in one picture; each is looked at as if there had been none before. Raises `ConfigError`."""
    import cv2
    import numpy as np

    from agents.hand_tracker.config import HandTrackerConfig
    from agents.hand_tracker.drawing import drawn
    from agents.hand_tracker.model.found import FAILURES
    from agents.hand_tracker.model.loading import load_landmarker

    data = np.frombuffer(read_file(image, _MOST_BYTES), np.uint8)
    try:
        read = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    except cv2.error:
        read = None
    if read is None:
        raise ConfigError(f"{str(image)!r} is no picture that can be read")
    color = np.asarray(cv2.cvtColor(read, cv2.COLOR_BGR2RGB), np.uint8)
    landmarker = load_landmarker(HandTrackerConfig(finder="model", model=model, runner=runner.value))()
    try:
        found = landmarker.detect(color, 0)
    except FAILURES as error:
        raise ConfigError(f"the model failed at {str(image)!r}: {error}") from error
    finally:
        landmarker.close()
    if drawing is not None:
        try:
            drawing.parent.mkdir(parents=True, exist_ok=True)
            written = cv2.imwrite(str(drawing), cv2.cvtColor(drawn(color, found), cv2.COLOR_RGB2BGR))
        except OSError as error:
            raise ConfigError(f"{str(drawing.parent)!r} cannot be written ({error})") from error
        if not written:
            raise ConfigError(f"{str(drawing)!r} cannot be written")
    told = [
        {
            "side": hand.side,
            "side_score": hand.side_score,
            "landmarks_px": hand.landmarks.tolist(),
            "shape_m": hand.shape.tolist(),
        }
        for hand in found
    ]
    return {"picture": str(image), "hands": told}


def _tell_fetched(file: Path, *, as_json: bool, new: bool) -> None:
    if as_json:
        print_json({"file": str(file), "new": new})
        return
    console.print(f"[green]✓[/] {'' if new else 'already there: '}{shown(str(file))}", soft_wrap=True)
    console.print("Hand trackers use it from their next start on; `dsr hands status` tells whether it runs here.")
