"""`dsr calibrate hand-eye`: where a real camera is on the hand, or beside the robot, from images of a target."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import JsonOption, add_names, add_numbers, check_writable, console, for_people, print_json, shown
from dsr.config.extras import check_installed
from dsr.errors import ConfigError
from dsr.files.private_files import write_json

if TYPE_CHECKING:
    from agents.calibrator.hand_eye.report import HandEyeReport

_LENSES = ("pinhole", "plumb_bob", "rational_polynomial", "equidistant")
_MOST_OFF = 1.0
"""m or rad, standard deviation of the hand: one that is off by more is not known at all"""
_TARGETS = "circles:10x10:0.01, chessboard:8x6:0.025 (inner corners), tag36h11:7:0.05 (id 7), tags:FILE, square:0.2; m."


def hand_eye(
    images: Annotated[Path, typer.Option(metavar="DIR", help="Folder with the images.")],
    poses: Annotated[Path, typer.Option(metavar="FILE", help="CSV or JSON: the hand's pose, or joints, by image.")],
    target: Annotated[str, typer.Option(help=_TARGETS)],
    intrinsics: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML or JSON: fx, fy, cx, cy and the distortion.")
    ] = None,
    fit_intrinsics: Annotated[
        bool, typer.Option("--fit-intrinsics", help="Find them too; from those of --intrinsics on, if they are told.")
    ] = False,
    lens: Annotated[
        str, typer.Option(metavar="MODEL", help=f"With --fit-intrinsics: {', '.join(_LENSES)}.")
    ] = "plumb_bob",
    eye_to_hand: Annotated[
        bool, typer.Option("--eye-to-hand", help="The camera stands, and the hand holds the target.")
    ] = False,
    urdf: Annotated[Path | None, typer.Option(metavar="FILE", help="The poses are joints of this robot.")] = None,
    base: Annotated[str, typer.Option(metavar="LINK", help="With --urdf: the base; default: its root.")] = "",
    hand: Annotated[str, typer.Option(metavar="LINK", help="With --urdf: the hand.")] = "end_effector_link",
    fit_joints: Annotated[
        bool, typer.Option("--fit-joints", help="With --urdf: find a constant error of each joint, too.")
    ] = False,
    position_std: Annotated[
        float | None,
        typer.Option(
            min=0.0, max=_MOST_OFF, metavar="M", help="Error of the hand's position; default: as images show."
        ),
    ] = None,
    rotation_std: Annotated[
        float | None,
        typer.Option(min=0.0, max=_MOST_OFF, metavar="RAD", help="Error of the hand's rotation, likewise."),
    ] = None,
    joint_std: Annotated[
        float | None,
        typer.Option(min=0.0, max=_MOST_OFF, metavar="RAD", help="With --urdf: error of each joint, such as rounding."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write the result: .toml or .json.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find where a real camera is, from images of a target and the robot's poses; and how well that is known.

    The hand carries the camera and the target stands; with --eye-to-hand it is the other way round. Take 10 images or
    more, each with the robot at rest, from directions 30 degrees apart, and turn the camera about its axis as well.

    FILE of --poses begins with a line image,x,y,z,qx,qy,qz,qw: the hand in the base, m and a unit quaternion. The page
    docs/how-to/hand_eye.md has all formats. The exit code is 0 only if the result can be relied on.
    """
    check_installed(("cv2",), "dsr calibrate hand-eye")
    if lens not in _LENSES:
        raise ConfigError(f"--lens {lens}: expected {', '.join(_LENSES)}")
    if intrinsics is None and not fit_intrinsics:
        raise ConfigError("tell --intrinsics FILE, or have them found by --fit-intrinsics")
    if urdf is None and (fit_joints or joint_std is not None or base):
        raise ConfigError("--fit-joints, --joint-std and --base go with --urdf only")
    if urdf is not None and (position_std is not None or rotation_std is not None):
        raise ConfigError("with --urdf, tell --joint-std instead of --position-std and --rotation-std")
    if output is not None and output.suffix not in (".toml", ".json"):
        raise ConfigError(f"--output {output}: expected a name that ends in .toml or .json")
    check_writable(output, "--output")
    from agents.calibrator.hand_eye import calibrate, reading
    from agents.calibrator.hand_eye.targets import read_target

    wanted = read_target(target)
    chain = None if urdf is None else reading.read_chain(urdf, base, hand)
    hands = reading.read_hands(images, poses, chain)
    pictures = reading.read_images(hands.images)
    size = pictures[0].shape[1], pictures[0].shape[0]
    setting = calibrate.Setting(
        is_in_hand=not eye_to_hand,
        lens=next(one for one in get_args(calibrate.Lens) if one == lens) if fit_intrinsics else None,
        fits_joints=fit_joints,
        position_std=position_std,
        rotation_std=rotation_std,
        joint_std=joint_std,
    )
    told = None if intrinsics is None else reading.intrinsics_for(intrinsics, size)
    names = [image.name for image in hands.images]
    report = calibrate.calibrate_hand_eye(names, hands, pictures, wanted, told, setting)
    if as_json:
        print_json(msgspec.to_builtins(report))
    else:
        _show(report)
    if output is not None:
        _write(report, output)
        for_people(as_json).print(f"result     {shown(str(output))}", soft_wrap=True)
    raise typer.Exit(1 if report.problem else 0)


def _show(report: HandEyeReport) -> None:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "image")
    add_numbers(table, "px", "own px", "mm", "distance", "weight")
    add_names(table, "")
    for view in report.views:
        numbers = (view.px, view.own_px, view.mm, math.sqrt(view.distance), view.weight)
        cells = (f"{number:.2f}" for number in numbers)
        table.add_row(shown(view.image), *cells, f"[red]drop:[/] {shown(view.drop)}" if view.drop else "")
    console.print(table)
    if report.not_found:
        console.print(f"the target was not found in {shown(', '.join(report.not_found))}", soft_wrap=True)
    console.print(f"{_parents(report)[0]} -> camera:", highlight=False)
    console.print(_pose_line("mount", report.mount).replace("[", "\\["), soft_wrap=True)
    stds = zip("xyz", report.std_mm, report.std_deg, strict=True)
    known = ", ".join(f"{axis} {mm:.2f} mm and {deg:.3f} deg" for axis, mm, deg in stds)
    console.print(f"one standard deviation along and about the camera's axes: {known}", soft_wrap=True)
    scatter = ", ".join(f"{shown(name)} {std:.2g}" for name, std in report.hand_std.items())
    console.print(
        f"points scatter by {report.pixel_std:.2f} px, alike by {report.smooth_std:.2f} px; hand (m, rad): {scatter}",
        soft_wrap=True,
    )
    percent = 1e2 * (report.target_scale - 1.0)
    console.print(
        f"target is {percent:+.2f} ± {1e2 * report.target_scale_std:.2f} % larger than told, by the robot's moves",
        soft_wrap=True,
    )
    if report.intrinsics_std:
        told = (f"{name} {report.intrinsics[name]:.2f}" for name in ("fx", "fy", "cx", "cy"))
        console.print(f"intrinsics: {', '.join(told)}, distortion {report.intrinsics['distortion']}", soft_wrap=True)
    for name, offset in report.joint_offsets.items():
        console.print(f"add to {shown(name)}: {offset:+.5f}", soft_wrap=True)
    if report.advice:
        console.print(shown(report.advice), soft_wrap=True)
    if report.problem:
        console.print(f"[bold red]{shown(report.problem)}[/]", soft_wrap=True)


def _write(report: HandEyeReport, file: Path) -> None:
    if file.suffix == ".json":
        write_json(msgspec.to_builtins(report), file)
        return
    carrier, holder = _parents(report)
    lines = [
        f"# dsr calibrate hand-eye, {report.target}: the camera's optical frame in the frame of the {carrier}; m, xyzw",
        _pose_line("mount", report.mount),
        f"covariance = {list(report.covariance)} # of the mount, in the camera's frame, m and rad, row by row",
        f"# the target in the frame of the {holder}",
        _pose_line("target", report.target_pose),
        "",
        "[intrinsics]",
        *(f"{name} = {_toml(value)}" for name, value in report.intrinsics.items() if value not in ("", ())),
    ]
    if report.joint_offsets:
        lines += ["", "[joint_offsets]", *(f'"{name}" = {value!r}' for name, value in report.joint_offsets.items())]
    try:
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot be written: {error.strerror}", file=str(file)) from error


def _parents(report: HandEyeReport) -> tuple[str, str]:
    return ("hand", "base") if report.is_in_hand else ("base", "hand")


def _pose_line(name: str, numbers: tuple[float, ...]) -> str:
    translation, rotation = (", ".join(f"{x:.8f}" for x in part) for part in (numbers[:3], numbers[3:]))
    return f"{name} = {{ translation = [{translation}], rotation = [{rotation}] }}"


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return str(list(value)) if isinstance(value, tuple) else repr(value)
