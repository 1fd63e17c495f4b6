"""The command `dsr record`: records a running system from elsewhere; tells what a recording holds; exports it."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from rich.box import SIMPLE_HEAD
from rich.progress import Progress
from rich.table import Table

from agents.recorder.agent import Recorder
from agents.recorder.config import MB, RecorderConfig
from agents.recorder.contents import RecordingContents, contents_of
from agents.recorder.export import TABLES, Exported, ExportSelection, export_csv
from agents.recorder.reader import FILE_NAME, read_recording
from agents.recorder.selection import PARTS
from agents.replay.source import ReplayedGraph
from agents.segments import segments
from dsr.cli.common import (
    CompanyNotice,
    GraphOption,
    JsonOption,
    RouterOption,
    SecurityOption,
    add_names,
    add_numbers,
    check_company,
    console,
    errors,
    joinable,
    print_json,
    run_folder,
    shown,
)
from dsr.cli.completion import complete_recording
from dsr.config.plugins import EXPORTERS, load
from dsr.config.toml import convert
from dsr.connecting import SECURITY
from dsr.errors import AgentError, ConfigError
from dsr.runtime.agent_process import StopSignal, run_agent
from dsr.runtime.signals import set_on_signals

_NAME = "record"
"""Of the agent; the system may have a recorder already."""

RecordingArgument = Annotated[
    Path, typer.Argument(help="A recording.mcap, or the folder of a run.", autocompletion=complete_recording)
]

app = typer.Typer(name="record", invoke_without_command=True, subcommand_metavar="[info|export ...]")


@app.callback()
def record(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Option(help="Gets recording.mcap, or recording-2.mcap, ...; default: a new one in runs/.")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help=f"Record only this: {', '.join(PARTS)}; or some of it: images/camera_wrist."),
    ] = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="PART", help="Leave this out, likewise. Both may be repeated.")
    ] = None,
    frames_hz: Annotated[float, typer.Option(min=0.0, metavar="HZ", help="Images a second and camera.")] = 2.0,
    still_hz: Annotated[
        float, typer.Option(min=0.0, metavar="HZ", help="The same while nothing moves in the picture.")
    ] = 0.2,
    lossless: Annotated[bool, typer.Option("--lossless", help="Keep every bit of images: thrice as large.")] = False,
    rotate_mb: Annotated[
        float, typer.Option(min=0.0, metavar="MB", help="Begin the next file after so much; 0 for never.")
    ] = 0.0,
    rotate_every: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Begin the next file after so long; 0 for never.")
    ] = 0.0,
    keep_files: Annotated[
        int, typer.Option(min=0, metavar="N", help="Keep so many files: the oldest is removed; 0 for all.")
    ] = 0,
    keep_mb: Annotated[
        float, typer.Option(min=0.0, metavar="MB", help="Keep so much: the oldest files are removed; 0 for all.")
    ] = 0.0,
    seconds: Annotated[
        float | None, typer.Option("--for", min=0.0, metavar="S", help="End after so long; default: with Ctrl-C.")
    ] = None,
    graph: GraphOption = None,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Record the running system until Ctrl-C: all changes of the graph, images, logs, statuses, devices.

    What the graph holds at the beginning is recorded too. Play it back with `dsr replay`. If the system ends, the
    command says so and waits for the next one. The exit code is 1 if messages were lost, as on a full disk.
    `dsr record info` tells what a recording holds, `dsr record export` writes tables.
    With --keep-files or --keep-mb, only files that were recorded so are ever removed.

    Example: dsr record --folder runs/mine --without images --rotate-every 600 --keep-files 24
    """
    if context.invoked_subcommand is not None:
        return
    config: dict[str, Any] = {
        "only": only or [], "without": without or [],
        "frames_hz": frames_hz, "still_hz": still_hz, "lossless": lossless,
        "rotate_mb": rotate_mb, "rotate_period": rotate_every, "keep_files": keep_files, "keep_mb": keep_mb,
    }  # fmt: skip
    convert(config, RecorderConfig, "options")
    name = joinable(graph, router)
    if security is not None:
        os.environ[SECURITY] = str(security.resolve())
    stop = StopSignal()
    timer = threading.Timer(seconds, stop.set) if seconds is not None else None
    recorders: list[Recorder] = []
    with run_folder(folder, _NAME) as place:
        before = set(segments(place, FILE_NAME))
        config["folder"] = str(place)

        def begun(recorder: Recorder) -> None:
            recorders.append(recorder)
            end = "" if timer else "; Ctrl-C ends it"
            console.print(shown(f"recording graph {name} to {place}{end}"), soft_wrap=True)
            if timer:
                timer.start()

        try:
            with set_on_signals(stop):
                kind = _attended(begun, router)
                run_agent(kind, graph=name, name=_NAME, config=config, router=router, seed=0, stop=stop)
        finally:
            if timer:
                timer.cancel()
        for file in segments(place, FILE_NAME):
            if file not in before:
                _report(file)
    if missing := sum(recorder.missing for recorder in recorders):
        raise AgentError(f"{missing} messages were lost: they are not in the recording")


def _attended(begun: Callable[[Recorder], None], router: str | None) -> type[Recorder]:
    """A recorder under the eyes of a person: it refuses a graph that nobody holds, and tells when all others leave."""

    class Attended(Recorder):
        """Tells `begun` when it begins."""

        def setup(self) -> None:
            """Begin, if there is anything to record."""
            check_company(self.memory, router)
            self._company = CompanyNotice(self.memory)
            super().setup()
            begun(self)

        def tick(self, now: float) -> None:
            """Record, and see who is there."""
            super().tick(now)
            self._company.look()

    return Attended


def _report(file: Path) -> None:
    recording = read_recording(file)
    for _ in recording:
        pass
    console.print(shown(f"{file.parent}/{recording.reports[0]}"), soft_wrap=True)


@app.command()
def info(recording: RecordingArgument, as_json: JsonOption = False) -> None:
    """Tell what a recording holds: messages and bytes by channel, how long it is, and whether it was cut.

    MB are those of the file, shared out among the channels about as each would be compressed alone.
    """
    contents = contents_of(recording)
    if as_json:
        print_json(msgspec.to_builtins(contents, enc_hook=str) | {"mb_per_minute": contents.mb_per_minute})
        return
    for report in contents.files:
        console.print(shown(str(report)), soft_wrap=True)
    rate = f"{contents.size / MB:.2f} MB in {contents.seconds:.1f} s, {contents.mb_per_minute:.2f} MB a minute"
    console.print(f"graph {shown(contents.metadata.get('graph', ''))}: {rate}", soft_wrap=True)
    console.print(_table(contents))


def _table(contents: RecordingContents) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    add_names(table, "channel")
    add_numbers(table, "messages", "Hz", "MB", "MB/min", "unpacked")
    for channel in contents.channels:
        rate, growth = "", ""
        if contents.seconds > 0.0:
            rate = f"{channel.messages / contents.seconds:.1f}"
            growth = f"{channel.packed / MB / (contents.seconds / 60.0):.3f}"
        packed, whole = f"{channel.packed / MB:.3f}", f"{channel.bytes / MB:.3f}"
        table.add_row(shown(channel.channel), str(channel.messages), rate, packed, growth, whole)
    return table


@app.command()
def export(
    recording: RecordingArgument,
    csv: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write tables as CSV files to this new folder.")
    ] = None,
    nodes: Annotated[
        list[str] | None,
        typer.Option("--node", "-n", metavar="NAME", help="Only what is about this node, or those like cube_*."),
    ] = None,
    tables: Annotated[
        list[str] | None,
        typer.Option("--table", "-t", metavar="TABLE", help=f"Only this table: {', '.join(it.name for it in TABLES)}."),
    ] = None,
    begin: Annotated[
        float, typer.Option("--from", min=0.0, metavar="S", help="Since the first message; begins with what is known.")
    ] = 0.0,
    until: Annotated[float | None, typer.Option(min=0.0, metavar="S", help="Until then, likewise.")] = None,
    ros2: Annotated[
        Path | None,
        typer.Option(metavar="FILE.mcap", help="Write a bag for rosbag2, RViz, Foxglove; or a folder with metadata."),
    ] = None,
    topics: Annotated[
        list[str] | None,
        typer.Option("--topic", metavar="TOPIC", help="With --ros2: only this topic, or those like '/dsr/*'."),
    ] = None,
    raw_images: Annotated[
        bool, typer.Option("--raw-images", help="With --ros2: colour as plain images, not compressed as recorded.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a recording as tables for spreadsheets and pandas (--csv), or as a bag for tools of ROS 2 (--ros2).

    Tables have a row for each sample, and a header with units (SI). README.txt in
    the folder tells what each table and column is. Tables have no images.

    A bag has frames (/tf, /tf_static), joints, images, camera infos, markers and
    detections of what is believed, diagnostics and events. It needs the extra `ros`.

    Options --node, --table and --topic may be repeated. A truncated recording is
    exported up to the cut. If the export is interrupted, nothing is left behind.

    Example: dsr record export recording.mcap --csv tables --node "cube_*" --table poses --from 10 --until 20

    Example: dsr record export recording.mcap --ros2 run.mcap --topic /tf --topic /tf_static
    """
    target = csv or ros2
    if target is None or (csv is not None and ros2 is not None):
        raise ConfigError("to what? Give either a folder for tables, --csv FOLDER, or a bag: --ros2 FILE.mcap")
    if csv is not None and (topics or raw_images):
        raise ConfigError("--topic and --raw-images go with --ros2")
    if ros2 is not None and tables:
        raise ConfigError("--table goes with --csv; choose topics: --topic")
    wanted = ExportSelection(nodes or (), tables or (), begin, math.inf if until is None else until)
    to_bag = load(EXPORTERS, "ros2") if ros2 is not None else None
    source = ReplayedGraph(recording)
    for problem in source.problems:
        errors.print(f"[yellow]{shown(problem)}; exported until there: {source.duration:.1f} s[/]", soft_wrap=True)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as progress:
        task = progress.add_task("exporting", total=None)

        def advance(time: float, end: float) -> None:
            progress.update(task, completed=time - begin, total=end - begin)

        if to_bag is None:
            exported = export_csv(source, target, wanted, advance)
        else:
            bag = to_bag(source, target, wanted, topics or (), raw_images=raw_images, on_progress=advance)
    if to_bag is None:
        _tell_exported(exported, target, as_json)
    else:
        _tell_bag(bag, target, as_json)


def _tell_exported(exported: Exported, folder: Path, as_json: bool) -> None:
    if as_json:
        print_json(exported._asdict() | {"folder": str(folder)})
        return
    for name, rows in exported.rows.items():
        console.print(shown(f"{folder}/{name}.csv  {rows} rows"), soft_wrap=True)
    if exported.malformed:
        errors.print(f"[yellow]{exported.malformed} messages that make no sense were left out[/]")


def _tell_bag(bag: Any, path: Path, as_json: bool) -> None:
    if as_json:
        print_json(bag._asdict() | {"path": str(path)})
        return
    for topic, count in bag.messages.items():
        console.print(shown(f"{path}  {topic}  {count} messages"), soft_wrap=True)
    if bag.malformed:
        why = f": {bag.told[0]}" if bag.told else ""
        errors.print(f"[yellow]{bag.malformed} messages were left out{shown(why)}[/]", soft_wrap=True)
