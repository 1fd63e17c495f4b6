"""`dsr mission`: give the robot a goal, and see how it gets there."""

from __future__ import annotations

import threading
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dsr.cli.common import (
    AsOption,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    add_names,
    console,
    errors,
    print_json,
    reading,
    shown,
    writing,
)
from dsr.cli.interrupts import INTERRUPTED
from dsr.cli.streams import redraws
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, suggest
from dsr.memory import Memory
from dsr.vocabulary.goals import Goal, parse_goal
from dsr.vocabulary.intentions import DONE, FAILED, FULFILLED, GIVEN_UP, HALTED, RUNNING, add_intention, nobody_pursues
from planner.config import PlannerConfig
from planner.intentions import read_intentions
from planner.waiting import known_names, may_appear, running_agents

_POLL_PERIOD = 0.1  # s between two looks
_ALONE = PlannerConfig().return_within  # s without any other process of the graph until it counts as gone
_TIDY_WITHIN = PlannerConfig().action_limit  # s that the planner may take to bring the arm to rest
_MARKS = {DONE: "[green]✓[/]", RUNNING: "[yellow]▶[/]", FAILED: "[red]✗[/]", HALTED: "[red]■[/]"}

app = typer.Typer(
    name="mission",
    invoke_without_command=True,
    subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)


@app.callback()
def mission(
    goal: Annotated[
        str | None,
        typer.Argument(help='Relations joined by &: "on(cube_3,cube_4) & clear(cube_3)"; with --cancel, an intention.'),
    ] = None,
    maintain: Annotated[bool, typer.Option("--maintain", help="Watch the goal once reached, and restore it.")] = False,
    priority: Annotated[int, typer.Option(help="Greater is more urgent.")] = 0,
    no_wait: Annotated[bool, typer.Option("--no-wait", help="Do not wait for the outcome.")] = False,
    timeout: Annotated[float, typer.Option(min=0.0, help="s to wait for the outcome; 0 is without end.")] = 0.0,
    show_list: Annotated[bool, typer.Option("--list", help="Show what is wanted, and how it goes.")] = False,
    cancel: Annotated[
        bool, typer.Option("--cancel", help="Cancel an intention: the one named, or the only one.")
    ] = False,
    graph: GraphOption = None,
    as_json: JsonOption = False,
    router: RouterOption = None,
    security: SecurityOption = None,
    agent: AsOption = "dsr",
) -> None:
    """Give the robot a goal in the running system, and show its progress until it is reached or given up.

    Relations: on(a,b), ontable(a), clear(a), holding(a), handempty.

    Things that are believed to be nowhere are named, and the arm looks
    for them if it carries a camera. If they are not found within some
    seconds, the goal is given up. Relations that conflict are named.

    The exit code is 0 only if the goal was reached.
    """
    if show_list:
        with reading(graph, router, security) as memory:
            _show_all(memory, as_json)
        return
    if cancel:
        with writing(graph, router, security, agent) as memory:
            _cancel(memory, goal, wait=not no_wait)
        return
    if goal is None:
        raise ConfigError('what is wanted? for example: dsr mission "on(cube_3,cube_4)"; or --list, or --cancel')
    parse_goal(goal)
    with writing(graph, router, security, agent) as memory:
        wanted = parse_goal(goal)
        wanted.check_names(known_names(memory) | _expected(memory, wanted))
        name = add_intention(memory, goal, maintain=maintain, priority=priority)
        if no_wait:
            print_json({"intention": name}) if as_json else console.print(f"{name}: {shown(goal)}", soft_wrap=True)
            return
        outcome = _follow(memory, name, timeout, quiet=as_json)
    if as_json:
        print_json(outcome)
    elif outcome["status"] not in FULFILLED:
        status, why = shown(outcome["status"]), shown(outcome["explanation"])
        errors.print(f"[bold red]{name}: {status}:[/] {why}", soft_wrap=True)
        if outcome["status"] in GIVEN_UP:
            errors.print(f"it stays in the graph until dsr mission --cancel {name}", soft_wrap=True)
    raise typer.Exit(0 if outcome["status"] in FULFILLED else 1)


def _expected(memory: Memory, goal: Goal) -> set[str]:
    """Names in a goal that no node has and that may still get one, for those who see and believe are at work."""
    if not running_agents(memory).issuperset(PlannerConfig().belief_agents):
        return set()
    return {name for name in goal.things if may_appear(memory, name)}


def _follow(memory: Memory, name: str, timeout: float, *, quiet: bool) -> dict[str, Any]:
    """Show how an intention goes until it has an outcome, which is returned."""
    began, state, told = WALL_CLOCK.monotonic(), describe(memory, name), ""
    in_company = began
    with Live(console=console, transient=False, auto_refresh=False) as live:
        try:
            while state["status"] not in (*FULFILLED, *GIVEN_UP):
                if timeout and WALL_CLOCK.monotonic() - began > timeout:
                    hint = f"still {state['status']} after {timeout:g} s; dsr mission --cancel {name} ends it"
                    return state | {"status": "timeout", "explanation": hint}
                WALL_CLOCK.wait(threading.Event(), _POLL_PERIOD)
                in_company = WALL_CLOCK.monotonic() if memory.peers else in_company
                if WALL_CLOCK.monotonic() - in_company > _ALONE:
                    return state | {"status": "lost", "explanation": "the system has ended, or cannot be reached"}
                if name not in memory:
                    return state | {"status": "cancelled", "explanation": "somebody has removed it"}
                state = describe(memory, name)
                told = told if quiet else _show(live, memory, state, told)
        except KeyboardInterrupt:
            live.stop()
            console.print(f"{name} is still wanted; dsr mission --cancel {name} ends it", soft_wrap=True)
            raise typer.Exit(INTERRUPTED) from None
    return state


def _show(live: Live, memory: Memory, state: dict[str, Any], told: str) -> str:
    """Show a state: as a table that changes in a terminal, else as a line whenever it is new.

    Why something was given up is told at the very end, and only there.
    """
    if nobody := nobody_pursues(memory):
        state = state | {"explanation": nobody}
    over = state["status"] in GIVEN_UP
    if redraws(console):
        live.update(_picture(state | {"explanation": ""} if over else state), refresh=True)
    if redraws(console) or over:
        return ""
    line = f"{state['intention']}: {state['status']}{f' ({reason})' if (reason := state['explanation']) else ''}"
    if line != told:
        console.print(shown(line), soft_wrap=True)
    return line


def _picture(state: dict[str, Any]) -> Group:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_header=False)
    add_names(table, "", "", "")
    for action in state["actions"]:
        words = " ".join(word for word in (action["skill"], action["target"], action["destination"]) if word)
        table.add_row(_MARKS.get(action["status"], "[dim]·[/]"), shown(words), shown(action["explanation"]))
    head = f"[bold]{shown(state['intention'])}[/] {shown(state['goal'])}: [bold]{shown(state['status'])}[/]"
    replans = f", {state['replans']} replans" if state["replans"] else ""
    return Group(Text.from_markup(head + replans), Text.from_markup(shown(state["explanation"])), table)


def describe(memory: Memory, name: str) -> dict[str, Any]:
    """An intention and its plan as plain data. Raises `NodeNotFoundError`."""
    node = memory.node(name)
    edges = memory.edges("has", src=name)
    actions = sorted(
        (action for edge in edges if (action := memory.get_node(edge.dst)) is not None and action.type == "action"),
        key=lambda action: (action.get("order", 0), action.name),
    )
    fields = ("skill", "target", "destination", "status", "explanation")
    return {
        "intention": name,
        "goal": node.get("goal", ""),
        "maintain": node.get("maintain", False),
        "priority": node.get("priority", 0),
        "status": node.get("status", ""),
        "explanation": node.get("explanation", ""),
        "replans": node.get("replans", 0),
        "actions": [{"name": action.name} | {key: action.get(key, "") for key in fields} for action in actions],
    }


def _show_all(memory: Memory, as_json: bool) -> None:
    states = [describe(memory, intention.name) for intention in read_intentions(memory)]
    if as_json:
        print_json(states)
    elif not states:
        console.print("nothing is wanted")
    else:
        for state in states:
            console.print(_picture(state))


def _cancel(memory: Memory, name: str | None, *, wait: bool) -> None:
    """Remove an intention, and wait until the planner has brought the arm to rest."""
    names = [intention.name for intention in read_intentions(memory)]
    if name is None and len(names) == 1:
        name = names[0]
    if name is None:
        raise ConfigError(f"which intention? {suggest('', names)}" if names else "nothing is wanted")
    if name not in names:
        raise ConfigError(f"no intention {name!r}; {suggest(name, names)}")
    planned = [action["name"] for action in describe(memory, name)["actions"]]
    memory.remove_node(name)
    began = WALL_CLOCK.monotonic()
    while wait and not nobody_pursues(memory) and WALL_CLOCK.monotonic() - began < _TIDY_WITHIN:
        if not any(action in memory for action in planned):
            break
        WALL_CLOCK.wait(threading.Event(), _POLL_PERIOD)
    console.print(f"{name} is cancelled")
