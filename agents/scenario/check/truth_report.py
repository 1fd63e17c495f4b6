"""The report of `dsr scenario truth`: events, phases and final poses of the true course, for people and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated

import msgspec
import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from agents.scenario.check.faults import faults
from agents.scenario.judge.course import why_missing
from agents.scenario.run.runner import true_course
from agents.scenario.run.staging import make_run
from agents.scenario.run.story import describe
from agents.scenario.truth.history import History, Sample
from agents.scenario.truth.phases import STEP, Phase, containers, phases, supports
from dsr.cli.common import JsonFileOption, JsonOption, check_writable, console, for_people, put_json
from dsr.math3d.quaternions import rotate
from dsr.math3d.transforms import Pose

TOLD_TURN = math.radians(5)
"""rad, the smallest turn of an object on its way that the table tells"""
Seven = tuple[float, float, float, float, float, float, float]


class EventReport(msgspec.Struct, frozen=True, kw_only=True):
    """The course of one event."""

    number: int
    """Number of the event in the file, from 1."""
    do: str
    text: str
    """The event's effect in words, with its fields."""
    begin: float | None = None
    """s after the start; None if it has not begun"""
    end: float | None = None
    """s after the start; None if it has not ended"""
    missing: str = ""
    """Why it has not happened; empty if it has."""


class FinalPose(msgspec.Struct, frozen=True, kw_only=True):
    """The pose of an object at the end."""

    object: str
    pose: Seven
    """world_from_object: m, then a quaternion (x, y, z, w)"""
    rests_on: tuple[str, ...]
    inside: tuple[str, ...]


class TruthReport(msgspec.Struct, frozen=True, kw_only=True):
    """The true course of a scenario without any agent."""

    scenario: str
    seed: int
    end: float
    """Time of the end, s after the start"""
    events: list[EventReport]
    phases: list[Phase]
    final: list[FinalPose]
    gone: list[str]
    """Objects that are not in the scene at the end."""
    tracks: dict[str, list[tuple[float, Seven]]]
    """Pose of each object over time: s after the start, and world_from_object, whenever it had changed (20 times a
    second).
    """


def truth_report(history: History, seed: int) -> TruthReport:
    """The report of a course that was played to its end."""
    scenario, samples = history.scenario, history.window(0.0, history.end)
    last = samples[-1]
    return TruthReport(
        scenario=scenario.name,
        seed=seed,
        end=history.end,
        events=[_event(history, number) for number in range(1, len(scenario.events) + 1)],
        phases=phases(history),
        final=[
            FinalPose(
                object=spec.name,
                pose=_seven(last.truth[spec.name]),
                rests_on=supports(scenario, last, spec.name),
                inside=containers(scenario, last, spec.name),
            )
            for spec in scenario.objects
            if spec.name in last.truth
        ],
        gone=[spec.name for spec in scenario.objects if spec.name not in last.truth],
        tracks={spec.name: list(_track(spec.name, samples)) for spec in scenario.objects},
    )


def show_truth(report: TruthReport, console: Console) -> None:
    """Print events, phases and final poses."""
    console.print(f"{report.scenario}, seed {report.seed}: the true course of {report.end:.1f} s, without any agent")
    if report.events:
        console.print(_event_table(report.events))
    console.print(_phase_table(report.phases) if report.phases else "Nothing moves.")
    console.print(_final_table(report))
    if report.gone:
        console.print(f"not in the scene at the end: {', '.join(report.gone)}")


def _event(history: History, number: int) -> EventReport:
    event = history.scenario.events[number - 1]
    kill = history.kills.get(number)
    begin, end = history.spans.get(number, (kill, kill))
    missing = why_missing(history, number)
    if begin is None and event.when is not None:
        missing += f": waits for {event.when}"
    tag = str(event.__struct_config__.tag)
    return EventReport(number=number, do=tag, text=describe(event), begin=begin, end=end, missing=missing)


def _track(name: str, samples: Iterable[Sample]) -> Iterable[tuple[float, Seven]]:
    noted: Pose | None = None
    for sample in samples:
        pose = sample.truth.get(name)
        if pose is not None and (noted is None or not STEP.covers(noted, pose)):
            yield sample.time, _seven(pose)
        noted = pose if noted is None or pose is None or not STEP.covers(noted, pose) else noted


def _event_table(events: Iterable[EventReport]) -> Table:
    table = _table("Events", "from", "to", "event", "what the experimenter does")
    for event in sorted(events, key=lambda event: math.inf if event.begin is None else event.begin):
        what = f"{escape(event.text)}\n[red]{escape(event.missing)}[/]" if event.missing else escape(event.text)
        table.add_row(_seconds(event.begin), _seconds(event.end), str(event.number), what)
    return table


def _phase_table(found: Iterable[Phase]) -> Table:
    table = _table("Course", "from", "to", "object", "what", "then at (m)", "on / in")
    for phase in found:
        place = "-" if phase.position is None else _place(phase.position)
        where = _where(phase.rests_on, phase.inside)
        table.add_row(_seconds(phase.begin), _seconds(phase.end), phase.object, _what(phase), place, where)
    return table


def _what(phase: Phase) -> str:
    if phase.gone:
        return "is removed"
    texts = ["comes"] if phase.comes else [f"moves {phase.moved:.2f} m"]
    if phase.turned > TOLD_TURN:
        texts.append(f"turns {math.degrees(phase.turned):.0f}°")
    if phase.held_by:
        texts.append(f"held by {', '.join(phase.held_by)}")
    if phase.fell_at is not None:
        texts.append(f"falls {phase.fell:.2f} m at {phase.fell_at:.2f} s")
    return ", ".join(texts)


def _final_table(report: TruthReport) -> Table:
    table = _table(f"Poses at {report.end:.1f} s", "object", "at (m)", "yaw", "tilt", "on / in")
    for final in report.final:
        position, rotation = final.pose[:3], final.pose[3:]
        x_axis, z_axis = rotate(rotation, (1.0, 0.0, 0.0)), rotate(rotation, (0.0, 0.0, 1.0))
        yaw = math.atan2(x_axis[1], x_axis[0])
        tilt = math.acos(max(-1.0, min(1.0, z_axis[2])))
        where = _where(final.rests_on, final.inside)
        table.add_row(final.object, _place(position), _degrees(yaw), _degrees(tilt), where)
    return table


def _table(title: str, *columns: str) -> Table:
    """A table narrow enough for 80 columns; numbers stand on one line each."""
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(column, no_wrap=column in ("from", "to", "then at (m)", "at (m)"), overflow="fold")
    return table


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle))}°"


def _where(rests_on: Iterable[str], inside: Iterable[str]) -> str:
    texts = [f"on {name}" for name in rests_on] + [f"in {name}" for name in inside]
    return ", ".join(texts) or "-"


def _place(position: tuple[float, ...]) -> str:
    return " ".join(f"{value + 0.0:.3f}" for value in position)


def _seconds(time: float | None) -> str:
    return "-" if time is None else f"{time:.2f}"


def _seven(pose: Pose) -> Seven:
    return (*pose.t, *pose.q)


def truth(
    scenario: Annotated[str, typer.Argument(help="A built-in scenario (see `dsr scenario list`) or a TOML file.")],
    seed: Annotated[int, typer.Option(min=0, help="Varies where the objects start.")] = 0,
    as_json: JsonOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Show what truly happens in a scenario, without any agent: events, when what moves and where it comes to rest.

    Plays only the simulated world with the experimenter's events, without images.
    What waits for the robot does not happen, for nothing moves the arm.

    The exit code is 1 if an event could not be carried out, puts or drives things into one another, or begins
    while an earlier one of the same hand or object is still going on.
    """
    check_writable(json_file)
    run = make_run(scenario, seed=seed)
    history = true_course(run)
    report = truth_report(history, seed)
    if not as_json:
        show_truth(report, console)
        if run.scenario.mission is not None:
            console.print("The robot does nothing here: what its mission would bring about does not happen.")
    put_json(report, as_json=as_json, file=json_file)
    found = faults(history)
    for fault in found:
        _, index = fault.path
        for_people(as_json).print(f"[red]✗[/] event {int(index) + 1}: {escape(fault.text)}")
    raise typer.Exit(1 if found else 0)
