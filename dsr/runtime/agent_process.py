"""An agent on the wall clock: connection, tick loop, exit code; and as a process with command line and signals."""

from __future__ import annotations

import argparse
import contextlib
import gc
import inspect
import logging
import os
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from dsr.agent import Agent, make_agent
from dsr.clock import WALL_CLOCK
from dsr.config.toml import TomlFile
from dsr.connecting import asked_for, connect, identity_of, interest_of, open_transport
from dsr.declared import configured_class
from dsr.errors import ConfigError, DsrError
from dsr.files.data_files import read_text
from dsr.graph.access import WriteGuard
from dsr.memory import Memory, new_rid
from dsr.network.keys import Keys
from dsr.network.rendezvous import running_graph
from dsr.network.transport import Transport
from dsr.runtime.lifeline import LAUNCHED, clear_up_after_launcher, follow_launcher
from dsr.runtime.logs import BusLogHandler, log_to_terminal, said_by
from dsr.runtime.orders import EXIT_FAILED, EXIT_USAGE
from dsr.runtime.resources import keep_freed_memory, shortage
from dsr.runtime.runner import Runner, Schedule
from dsr.runtime.signals import set_on_signals
from dsr.threads import acting_for

_log = logging.getLogger("dsr.agent")


class StopSignal(threading.Event):
    """Set when an agent's process is to end; `bell` is set with it, and whenever the agent asks to be woken."""

    def __init__(self) -> None:
        super().__init__()
        self.bell = threading.Event()

    def set(self) -> None:
        """End the process."""
        super().set()
        self.bell.set()


def main(kind: type[Agent]) -> None:
    """Run an agent of class `kind` as this process, with the command line's arguments; does not return."""
    raise SystemExit(run_command_line(kind))


def run_command_line(kind: type[Agent], arguments: Sequence[str] | None = None) -> int:
    """Run an agent with command line `arguments` until a signal; returns the exit code."""
    options = _parser(kind).parse_args(arguments)
    log_to_terminal(options.name, options.log_level)
    stop = StopSignal()
    launcher_is_gone = follow_launcher(os.environ, stop)

    def run() -> None:
        graph = running_graph(options.graph, options.connect, may_begin=True)
        with set_on_signals(stop):
            run_agent(
                kind,
                graph=graph,
                name=options.name,
                config=read_config(options.config),
                router=options.connect,
                seed=options.seed,
                stop=stop,
                restarts=int(os.environ.get(LAUNCHED, "0")),
                interest=interest_of(options.interest),
            )
        if launcher_is_gone.is_set():
            clear_up_after_launcher(graph)

    return exit_code(run)


def exit_code(run: Callable[[], None]) -> int:
    """Let an agent run; returns the exit code that tells how it ended, and logs why unless it ended well.

    Raises what it has not been prepared for.
    """
    try:
        run()
    except ConfigError as error:
        _log.error("%s", error)
        return EXIT_USAGE
    except DsrError as error:
        _log.error("%s", error)
        return EXIT_FAILED
    except (OSError, MemoryError, RuntimeError, ImportError) as error:
        said = shortage(error)
        if said is None:
            raise
        _log.error("%s", said)
        return EXIT_FAILED
    return 0


def run_agent(
    kind: type[Agent],
    *,
    graph: str,
    name: str,
    config: dict[str, Any],
    router: str | None,
    seed: int,
    stop: StopSignal,
    restarts: int = 0,
    alone: bool = True,
    interest: tuple[str, ...] | None = None,
) -> None:
    """Join `graph` as agent `name` and tick until `stop` is set; raises what ends the agent otherwise.

    Its `interest` is that of the system file; if None, that of the environment or of the class.

    Agents may run in threads of one process: each has a connection, a memory and a log of its own. Only of one that is
    `alone` the log also tells what threads say which work for nobody in particular.
    """
    keep_freed_memory()
    kind = configured_class(kind, config)
    with contextlib.ExitStack() as resources:
        resources.enter_context(acting_for(name))
        wanted = asked_for(kind.interest) if interest is None else interest
        memory, bus, rid = _join(kind, graph, name, [router] if router else [], wanted, resources)
        handler = BusLogHandler(bus, Keys(graph), name, WALL_CLOCK)
        handler.addFilter(said_by(name, *([""] if alone else [])))
        logging.getLogger().addHandler(handler)
        resources.callback(logging.getLogger().removeHandler, handler)
        agent = make_agent(
            kind, name=name, config=config, bus=bus, keys=Keys(graph), clock=WALL_CLOCK, memory=memory, seed=seed
        )
        agent.wake = stop.bell.set
        runner = Runner(agent, rid=rid, pid=os.getpid(), restarts=restarts)
        resources.callback(runner.teardown)
        runner.setup()
        gc.freeze()  # what was imported and set up stays: looking through it for garbage takes as long as a tick
        _run_ticks(runner, stop)


def _join(
    kind: type[Agent],
    graph: str,
    name: str,
    routers: list[str],
    interest: tuple[str, ...] | None,
    resources: contextlib.ExitStack,
) -> tuple[Memory | None, Transport, str]:
    """The memory if the agent uses it, its bus and the replica id; given back when `resources` are closed."""
    if kind.uses_memory:
        memory = connect(
            graph, agent=name, connect=routers, guard=WriteGuard(name, kind.writes), must_exist=False,
            interest=None if interest is None else (),
        )  # fmt: skip
        resources.callback(memory.close)
        if interest:
            memory.hold_part(*interest, unlisted=True)
        return memory, memory.transport, memory.rid
    rid = new_rid(name)
    bus, registration = open_transport(graph, rid, routers, identity=identity_of(name))
    resources.callback(registration.close)
    resources.callback(bus.close)
    return None, bus, rid


def _run_ticks(runner: Runner, stop: StopSignal) -> None:
    """Tick on schedule and when woken, and tell the status in between if the ticks are far apart."""
    clock = runner.agent.clock
    schedule = Schedule(clock.monotonic(), runner.agent.rate_hz)
    while True:
        woken = clock.wait(stop.bell, min(schedule.due, runner.status_due) - clock.monotonic())
        stop.bell.clear()
        if stop.is_set():
            return
        now = clock.monotonic()
        due = now >= schedule.due
        if due:
            runner.missed += schedule.take(now)
        if due or woken:
            runner.tick(clock.now())
        elif now >= runner.status_due:
            runner.tell()


def _parser(kind: type[Agent]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=None if kind.__module__ == "__main__" else f"python -m {kind.__module__.removesuffix('.agent')}",
        description=inspect.cleandoc(kind.__doc__ or kind.__name__),
        epilog=_explain(kind),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--graph", help="name of the graph to join; default: the only one that runs on this machine")
    add("--name", default=kind.name or kind.__name__.lower(), help="the agent's name; default: %(default)s")
    add("--config", default="{}", metavar="JSON", help="a JSON object, or @FILE of a JSON or TOML file")
    add("--connect", metavar="ENDPOINT", help="also join the Zenoh router at tcp/HOST:7447")
    add("--interest", metavar="PARTS", help="parts of the graph to hold, with commas between; '*' for all")
    add("--seed", type=int, default=0, help="seed of all its random numbers; default: %(default)s")
    add("--log-level", default="info", choices=["debug", "info", "warning", "error"], help="default: %(default)s")
    return parser


def _explain(kind: type[Agent]) -> str:
    """The end of the help: what the agent reads, writes and can be configured with."""
    lines = [f"Runs {kind.rate_hz:g} times a second until it gets SIGINT or SIGTERM."]
    for verb, access in (("reads", kind.reads), ("writes", kind.writes)):
        for what in ("nodes", "edges", "attributes"):
            if names := getattr(access, what):
                lines.append(f"  {verb} {what}: {', '.join(names)}")
    defaults = msgspec.to_builtins(kind.Config())
    lines += ["", "Configuration (--config) and its defaults:" if defaults else "It has no configuration."]
    lines += [f"  {name} = {value!r}" for name, value in defaults.items()]
    if defaults:
        name, value = next(iter(defaults.items()))
        lines += ["", f"Example: --config '{msgspec.json.encode({name: value}).decode()}'"]
    return "\n".join(lines)


def read_config(text: str) -> dict[str, Any]:
    """The configuration in `text`: a JSON object, or @ and the name of a JSON or TOML file. Raises `ConfigError`."""
    if not text.startswith("@"):
        return _json(text, "--config")
    file = Path(text[1:])
    if file.suffix == ".toml":
        return TomlFile(file).data
    return _json(read_text(file), str(file))


def _json(text: str, source: str) -> dict[str, Any]:
    try:
        return msgspec.json.decode(text, type=dict[str, Any])
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ConfigError(f"{source}: expected a JSON object such as '{{\"rate\": 5}}' ({error})") from error
