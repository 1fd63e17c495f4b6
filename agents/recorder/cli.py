"""The command `dsr record`: a recorder that joins the running system from another terminal."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Annotated, Any

import typer

from agents.recorder.agent import Recorder
from agents.recorder.reader import FILE_NAME, read_recording
from agents.segments import segments
from dsr.cli.common import GraphOption, RouterOption, console, new_run_folder, shown
from dsr.errors import ConfigError
from dsr.network.rendezvous import endpoints, graphs, running_graph
from dsr.runtime.agent_process import StopSignal, run_agent
from dsr.runtime.signals import set_on_signals

_NAME = "record"
"""Of the agent; the system may have a recorder already."""

app = typer.Typer(
    name="record", invoke_without_command=True, subcommand_metavar="",
    context_settings={"allow_interspersed_args": True},
)  # fmt: skip


@app.callback()
def record(
    folder: Annotated[
        Path | None, typer.Option(help="Gets recording.mcap, or recording-2.mcap, ...; default: a new one in runs/.")
    ] = None,
    frames_hz: Annotated[float, typer.Option(min=0.0, metavar="HZ", help="Images a second and camera.")] = 2.0,
    seconds: Annotated[
        float | None, typer.Option("--for", min=0.0, metavar="S", help="End after so long; default: with Ctrl-C.")
    ] = None,
    graph: GraphOption = None,
    router: RouterOption = None,
) -> None:
    """Record the running system until Ctrl-C: all changes of the graph, images, logs, statuses, devices.

    What the graph holds at the beginning is recorded too. Play it back with `dsr replay`.
    """
    name = running_graph(graph) if router is None or graph is None else graph
    if router is None and not endpoints(name):
        raise ConfigError(f"no graph {name!r} runs on this machine; running: {', '.join(graphs()) or 'none'}")
    folder = folder or new_run_folder(_NAME)
    before = set(segments(folder, FILE_NAME))
    stop = StopSignal()
    timer = threading.Timer(seconds, stop.set) if seconds is not None else None
    config: dict[str, Any] = {"folder": str(folder), "frames_hz": frames_hz}
    console.print(f"recording graph {name} to {folder}" + ("" if timer else "; Ctrl-C ends it"), soft_wrap=True)
    try:
        if timer:
            timer.start()
        with set_on_signals(stop):
            run_agent(Recorder, graph=name, name=_NAME, config=config, router=router, seed=0, stop=stop)
    finally:
        if timer:
            timer.cancel()
    for file in segments(folder, FILE_NAME):
        if file not in before:
            _report(file)


def _report(file: Path) -> None:
    recording = read_recording(file)
    for _ in recording:
        pass
    console.print(shown(f"{file.parent}/{recording.reports[0]}"), soft_wrap=True)
