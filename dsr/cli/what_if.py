"""`dsr what-if`: what would become of the objects if some were elsewhere, held or gone?"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from dsr.cli.common import (
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    WorldOption,
    add_names,
    add_numbers,
    console,
    naming,
    print_json,
    reading,
    shown,
)
from dsr.errors import ConfigError
from dsr.imagining import differences
from dsr.math3d.transforms import Pose
from dsr.network.keys import BASE
from dsr.vocabulary.sentences import percent
from dsr.vocabulary.what_if import MAX_SECONDS, MAX_WORLDS, TIMEOUT, Answer, Question, Supposed, WhatIf, WorldOutcome

app = typer.Typer()

_MOVED = 0.005  # m, from which it is told that something moves


@app.command("what-if")
def what_if(
    place: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=X,Y,Z",
            help="Put an object there (m, world frame), upright; or ...,YAW (rad); or ...,QX,QY,QZ,QW.",
        ),
    ] = None,
    hold: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Hold an object where it is.")] = None,
    remove: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Take an object away.")] = None,
    seconds: Annotated[float, typer.Option(min=0.0, max=MAX_SECONDS, help="How long to simulate (s).")] = 1.0,
    worlds: Annotated[
        int,
        typer.Option(
            min=1, max=MAX_WORLDS, metavar="N", help="Try it in the N most probable worlds of the belief, with odds."
        ),
    ] = 1,
    timeout: Annotated[float, typer.Option(min=0.1, help="How long to wait for the answer (s).")] = TIMEOUT,
    world: WorldOption = BASE,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Simulate the belief some seconds on, from now, with changes; neither belief nor world is disturbed.

    With --world, the scene of another world is simulated, which nothing is written into either. With --worlds, it is
    told how probable each outcome is: things may be elsewhere than where they are believed to be most.
    """
    changes = [parsed_placing(text) for text in place or ()]
    changes += [Supposed.hold(name) for name in hold or ()]
    changes += [Supposed.remove(name) for name in remove or ()]
    with reading(graph, router, security, world) as memory:
        with naming():
            for change in changes:
                memory.node(change.object)
        if world != BASE:
            changes = [*differences(memory.world(BASE), memory), *changes]
        asker = WhatIf(memory.transport, memory.keys, memory.clock, timeout)
        answer = asker.ask_and_wait(Question(seconds, tuple(changes), worlds=worlds))
    if as_json:
        print_json(msgspec.to_builtins(answer))
    else:
        _show(answer)
        if worlds > 1:
            _show_worlds(answer)


def parsed_placing(text: str) -> Supposed:
    """The change that `NAME=X,Y,Z` asks for, with a yaw or a quaternion if more follows. Raises `ConfigError`."""
    expected = "expected NAME=X,Y,Z in m, and then a yaw (rad) or a quaternion QX,QY,QZ,QW if not upright"
    name, _, pose = text.rpartition("=")
    try:
        numbers = [float(part) for part in pose.split(",")]
    except ValueError:
        raise ConfigError(f"--place {text!r}: {expected}") from None
    try:
        if name and len(numbers) in (3, 4):
            return Supposed.place(name, Pose.from_rotvec(numbers[:3], (0.0, 0.0, *(numbers[3:] or [0.0]))))
        if name and len(numbers) == 7:
            return Supposed.place(name, Pose(numbers[:3], numbers[3:]))
    except ValueError as error:
        raise ConfigError(f"--place {text!r}: {error}") from error
    raise ConfigError(f"--place {text!r}: {expected}")


def _show(answer: Answer) -> None:
    """Tell what becomes of the world that the graph shows."""
    if answer.refused:
        console.print(f"where things are believed to be: {shown(answer.refused)}")
        return
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "object")
    add_numbers(table, "then at (m)", "moved\n(mm)", "turned\n(deg)")
    add_names(table, "rests on")
    for name in sorted(answer.poses):
        position = " ".join(f"{round(number, 4) + 0.0:7.4f}" for number in answer.poses[name][:3])
        supports = list(answer.rests_on[name]) + ["(the floor)"] * (name in answer.on_floor)
        table.add_row(
            shown(name),
            position,
            f"{1e3 * answer.moved[name]:.1f}",
            f"{math.degrees(answer.turned[name]):.1f}",
            shown(", ".join(supports)),
        )
    console.print(table)
    console.print(f"after {answer.seconds:.2f} s, " + ("all at rest" if answer.at_rest else "not yet at rest"))


def _show_worlds(answer: Answer) -> None:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_numbers(table, "probability")
    add_names(table, "elsewhere", "then")
    for outcome in answer.outcomes:
        names = shown(", ".join(outcome.otherwise)) or "[dim]nothing[/]"
        table.add_row(percent(outcome.weight), names, shown(_movements(outcome)))
    console.print(table)


def _movements(outcome: WorldOutcome) -> str:
    """What moves in a world, in words."""
    told = [_movement(outcome, name) for name in sorted(outcome.moved) if outcome.moved[name] > _MOVED]
    return outcome.refused or ", ".join(told) or "all stays"


def _movement(outcome: WorldOutcome, name: str) -> str:
    """How far an object moves in a world, and how much of that it would not without the changes."""
    metres, _ = outcome.effect(name)
    told = f"{name} moves by {1e3 * outcome.moved[name]:.0f} mm"
    if name not in outcome.anyway:
        return told
    return f"{told} anyway" if metres <= _MOVED else f"{told}, {1e3 * metres:.0f} mm from where it moves anyway"
