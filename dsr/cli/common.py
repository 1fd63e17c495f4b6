"""Shares code between the commands: options, joining the running graph as a reader, output for people and programs."""

from __future__ import annotations

import contextlib
import glob
import math
from collections.abc import Iterable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from dsr.cli.completion import complete_graph, complete_world
from dsr.cli.streams import make_console
from dsr.clock import WALL_CLOCK
from dsr.connecting import SECURITY, asked_for, connect
from dsr.errors import (
    ConfigError,
    NodeNotFoundError,
    PartNotFoundError,
    SchemaError,
    TransportError,
    WorldNotFoundError,
)
from dsr.files.private_files import FOLDER_MODE, write_json
from dsr.graph.access import Access, WriteGuard
from dsr.graph.schema import Schema
from dsr.math3d.transforms import Pose, position_deviation
from dsr.memory import Memory
from dsr.network.keys import BASE, agent_of
from dsr.network.rendezvous import endpoints, graphs, running_graph
from dsr.runtime.logs import printable


def _graph_option(default: str) -> Any:
    help = f"Name of the graph; {default}."
    return typer.Option("--graph", "-g", metavar="NAME", envvar="DSR_GRAPH", help=help, autocompletion=complete_graph)


GraphOption = Annotated[str | None, _graph_option("default: the only one that runs on this machine")]
SystemsGraphOption = Annotated[str | None, _graph_option("default: as the system's file says")]
ReplayGraphOption = Annotated[str, _graph_option("the replay runs as that")]
RouterOption = Annotated[
    str | None, typer.Option("--connect", metavar="ENDPOINT", help="Join the Zenoh router at tcp/HOST:7447 too.")
]
SecurityOption = Annotated[
    Path | None,
    typer.Option("--security", metavar="FOLDER", envvar=SECURITY, help="With its certificates (dsr security init)."),
]
WorldOption = Annotated[
    str,
    typer.Option(
        "--world", "-w", metavar="NAME", help="Which world of the graph (dsr worlds).", autocompletion=complete_world
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON instead of text; of what goes on, an object a line.")
]
JsonFileOption = Annotated[
    Path | None, typer.Option("--json-file", metavar="FILE", help="Also write the JSON to this file.")
]
ZoneOption = Annotated[
    str | None,
    typer.Option(
        "--timezone", metavar="ZONE", help="On whose calendar days are counted: Europe/Madrid, UTC; default: ours."
    ),
]
AsOption = Annotated[str, typer.Option("--as", metavar="AGENT", help="With --security: whose certificate.")]

_DIGITS = 9
"""Digits of a number that are shown, of a vector those of its largest component: what somebody wrote, and no rounding
noise, which is in the 16th."""
_LARGE = 1e6
"""Numbers from here on (stamps in s) are shown to a thousandth."""
_POSE_DECIMALS = 6
"""Of the numbers of a pose: to 1e-6 m, and of its quaternion to 2e-6 rad."""

_MOST_PARTS = 5
"""Names of parts in a hint"""
DELIVERY_PATIENCE = 10.0
"""s that all others get to tell that they have what a command wrote."""

ONLOOKERS = frozenset({"dsr", "record", "view"})
"""Agents of the commands that only look, whom a system does without."""
LEFT = "nobody else is in the graph any more; waiting for somebody, Ctrl-C ends"
_BACK = "somebody is in the graph again"

console = make_console()
errors = make_console(stderr=True)


@contextlib.contextmanager
def naming() -> Iterator[None]:
    """Within it, a name that the system or the schema does not know is wrong input: raises `ConfigError` instead."""
    try:
        yield
    except (NodeNotFoundError, PartNotFoundError, SchemaError, WorldNotFoundError) as error:
        raise ConfigError(str(error)) from error


@contextlib.contextmanager
def reading(
    graph: str | None, router: str | None, security: Path | None, world: str = BASE, *, hints: bool = True
) -> Iterator[Memory]:
    """A replica of a world of the running graph, that writes nothing. Raises `ConfigError` if there is none.

    Of the parts of the graph it holds those that `dsr --interest` names; `hints` tell which ones it does not.
    """
    name = joinable(graph, router)
    guard = WriteGuard("dsr", Access())
    routers = [router] if router else ()
    with connect(
        name, agent="dsr", connect=routers, guard=guard, security=security, must_exist=False, interest=()
    ) as memory:
        check_company(memory, router)
        with naming():
            memory.hold_part(*(asked_for() or ()))
            opened = memory.world(world)
        if hints:
            _tell_parts_beyond(memory)
        yield opened


def _tell_parts_beyond(memory: Memory) -> None:
    """Say on standard error which parts of the graph are not held."""
    beyond = [info.name for info in memory.parts() if info.name not in memory.interest]
    if beyond:
        listed = ", ".join(beyond[:_MOST_PARTS]) + (", ..." if len(beyond) > _MOST_PARTS else "")
        text = f"without {counted(len(beyond), 'part')} of the graph: {listed} (dsr --interest '*', or some of them)"
        errors.print(shown(text), style="dim", soft_wrap=True)


@contextlib.contextmanager
def writing(graph: str | None, router: str | None, security: Path | None, agent: str) -> Iterator[Memory]:
    """A replica of the running graph to write; at the end waits until the others have what was written.

    Raises:
        ConfigError: if no such graph runs.
        TransportError: if somebody did not tell in time that he has it.
    """
    name = joinable(graph, router)
    with connect(name, agent=agent, connect=[router] if router else (), security=security, must_exist=False) as memory:
        check_company(memory, router)
        yield memory
        if not memory.replica.wait_until(lambda: memory.delivered, DELIVERY_PATIENCE):
            raise TransportError(f"not all of {', '.join(memory.peers)} have it after {DELIVERY_PATIENCE:.0f} s")


@contextlib.contextmanager
def opened(memory: Memory, name: str) -> Iterator[Memory]:
    """The world of that name, to write; at the end waits until the others there have what was written.

    Raises:
        ConfigError: if there is none.
        TransportError: if somebody did not tell in time that he has it.
    """
    try:
        world = memory.world(name)
    except WorldNotFoundError as error:
        raise ConfigError(str(error)) from error
    yield world
    if not world.replica.wait_until(lambda: world.delivered, DELIVERY_PATIENCE):
        raise TransportError(f"not all of {', '.join(world.peers)} have it after {DELIVERY_PATIENCE:.0f} s")


def joinable(graph: str | None, router: str | None) -> str:
    """The name of a graph that can be joined. Raises `ConfigError` if there is none."""
    name = running_graph(graph, router)
    if router is None:
        check_runs(name)
    return name


def check_runs(graph: str) -> None:
    """Raise `ConfigError` if no process on this machine takes part in `graph`."""
    if not endpoints(graph):
        raise ConfigError(f"no graph {graph!r} runs on this machine; running: {', '.join(graphs()) or 'none'}")


def check_company(memory: Memory, router: str | None) -> None:
    """Raise `ConfigError` if nobody else holds the graph: what we hold is nothing, and nobody gets what we write."""
    if not memory.peers:
        reason = f", or the router {router} cannot be reached" if router else ""
        raise ConfigError(f"nobody holds graph {memory.graph_name!r}{reason}")


def is_deserted(memory: Memory) -> bool:
    """Whether nobody else is in the graph but for commands that only look, as we do."""
    return all(agent_of(peer) in ONLOOKERS for peer in memory.peers)


class CompanyNotice:
    """Says on standard error when `memory` is deserted, and when somebody is there again; see `is_deserted`."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._alone = False

    def look(self) -> None:
        """Say what has changed since the last call."""
        if self._alone != is_deserted(self._memory):
            self._alone = not self._alone
            errors.print(LEFT if self._alone else _BACK, style="yellow")


def print_json(value: Any) -> None:
    """Print plain data as indented JSON."""
    typer.echo(msgspec.json.format(msgspec.json.encode(value), indent=2).decode())


def put_json(value: Any, *, as_json: bool, file: Path | None) -> None:
    """Print plain data, or write it to a file, as the options of `JsonOption` and `JsonFileOption` ask for."""
    if as_json:
        print_json(value)
    if file is not None:
        write_json(value, file)
        for_people(as_json).print(f"JSON       {shown(str(file))}", soft_wrap=True)


def for_people(as_json: bool) -> Console:
    """The console for what people read on the way: standard error where standard output gets JSON."""
    return errors if as_json else console


def check_writable(file: Path | None, option: str = "--json-file") -> None:
    """Make its folder and open it. Raises `ConfigError` before a run rather than lose its result after it."""
    if file is None:
        return
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.open("a", encoding="utf-8").close()
    except OSError as error:
        raise ConfigError(f"{option} {file}: cannot be written ({error.strerror})") from error


def plain(value: Any) -> Any:
    """An attribute's value as JSON can hold it."""
    if isinstance(value, Pose):
        return {
            "translation": [float(number) for number in value.translation],
            "rotation": [float(number) for number in value.rotation],
            "stamp": value.stamp,
            **({} if value.covariance is None else {"covariance": np.asarray(value.covariance).tolist()}),
        }
    if isinstance(value, bytes):
        return {"bytes": len(value)}
    return list(value) if isinstance(value, tuple) else value


def readable(value: Any) -> str:
    """An attribute's value for people: as it was written, without rounding noise; a pose with its units."""
    if isinstance(value, Pose):
        spread = "" if value.covariance is None else f" ± {position_deviation(value) * 1e3:.1f} mm"
        place, turn = (_together(part, _POSE_DECIMALS) for part in (value.translation, value.rotation))
        return f"{place} m{spread}, {turn} xyzw"
    if isinstance(value, float | np.floating):
        return _shortest(float(value))
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, tuple):
        largest = max(map(abs, value), default=0.0)
        return _together(value, _DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0)
    return str(value)


def _together(numbers: Iterable[float], decimals: int) -> str:
    """Several numbers, all rounded to these decimals."""
    return f"({', '.join(_shortest(round(float(number), decimals)) for number in numbers)})"


def _shortest(number: float) -> str:
    """A number with no more digits than tell it."""
    if abs(number) < _LARGE:
        return f"{number + 0.0:.{_DIGITS}g}"
    return f"{number:.3f}".rstrip("0").rstrip(".")


def with_unit(schema: Schema, name: str, value: Any) -> str:
    """The value of attribute `name` for people in a line, with its unit if it is known and not told with the value."""
    if value == "":
        return '""'
    known = schema.attributes.get(name)
    unit = "" if known is None or isinstance(value, Pose) else known.unit
    return f"{readable(value)} {unit}".rstrip()


def counted(number: int, what: str) -> str:
    """A number of things whose name takes an s: "1 node", "2 nodes"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def shown(text: str) -> str:
    """`text` that comes from the graph or an error, for the console: no control characters, no markup."""
    return escape(printable(text))


def add_names(table: Table, *columns: str) -> None:
    """Add columns of text: where there is no room, a name goes on in the next line, and nothing of it is cut."""
    for column in columns:
        table.add_column(column, overflow="fold")


def add_numbers(table: Table, *columns: str) -> None:
    """Add columns of numbers, right-justified. They keep their width: names beside them give way."""
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)


def new_run_folder(name: str, runs: Path = Path("runs")) -> Path:
    """A new folder `runs/<name>-<date>-<time>`, numbered if there is one. Raises `ConfigError` if it cannot be made."""
    stem = f"{name}-{datetime.fromtimestamp(WALL_CLOCK.now()):%Y%m%d-%H%M%S}"
    folders = [runs / stem, *(runs / f"{stem}-{number}" for number in range(2, 100))]
    for folder in folders:
        try:
            folder.mkdir(mode=FOLDER_MODE, parents=True)
            return folder
        except FileExistsError:
            continue
        except OSError as error:
            said = f"logs and recordings go to {runs}/ where the command runs, and {runs.resolve()} cannot be written"
            raise ConfigError(f"{said}: {error.strerror}; run it in a folder of yours") from error
    raise ConfigError(f"{folders[-1]} and all before it exist already")


def last_run(name: str | None = None, runs: Path = Path("runs")) -> Path | None:
    """The newest folder of `new_run_folder` that has logs, of any run or those called `name`; None if there is none."""
    folders = {log.parent for log in runs.glob(f"{'*' if name is None else glob.escape(name)}-[0-9]*/*.log")}
    return max(folders, key=lambda folder: folder.stat().st_mtime, default=None)


@contextlib.contextmanager
def run_folder(given: Path | None, name: str) -> Iterator[Path]:
    """The folder that was given, or a new one as `new_run_folder` makes it, which goes again if nothing is in it."""
    place = given or new_run_folder(name)
    try:
        yield place
    finally:
        if given is None:
            with contextlib.suppress(OSError):  # something is in it
                place.rmdir()
