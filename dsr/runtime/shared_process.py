"""A process that runs several agents, each in a thread: `python -m dsr.runtime.shared_process NAME ...`.

A launcher orders on standard input which agents run, and learns from the descriptor REPORTS which have ended. An agent
that fails ends alone; the launcher orders it again. What crashes the process ends them all. The interpreter lets one
thread at a time compute: agents that compute for long, or call libraries that may crash, belong in processes of their
own.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import logging
import os
import sys
import threading
from collections import deque
from pathlib import Path

from dsr.runtime.agent_process import StopSignal, exit_code, run_agent
from dsr.runtime.lifeline import clear_up_after_launcher, follow_launcher
from dsr.runtime.logs import log_to_file, log_to_terminal, said_by
from dsr.runtime.orders import EXIT_FAILED, AgentEnded, Lines, StartAgent, decode_order, encode_line
from dsr.runtime.resources import exit_if_short
from dsr.runtime.signals import set_on_signals
from dsr.runtime.system import load_class
from dsr.threads import acting_for

_log = logging.getLogger("dsr.runtime.shared_process")


class SharedProcess:
    """Runs agents in threads until its `stop` is set.

    Args:
        options: those of the command line.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.stop = StopSignal()
        self._options = options
        self._lines = Lines()
        self._orders: deque[StartAgent] = deque()
        self._agents: dict[str, tuple[threading.Thread, StopSignal]] = {}

    def take(self, written: bytes) -> None:
        """Take in what the launcher has written; in any thread."""
        self._orders.extend(decode_order(line) for line in self._lines.take(written))
        self.stop.bell.set()

    def run(self) -> None:
        """Start agents as they are ordered; when `stop` is set, end them all."""
        while True:
            self.stop.bell.wait()
            self.stop.bell.clear()
            if self.stop.is_set():
                break
            while self._orders:
                self._start(self._orders.popleft())
        for _, stop in self._agents.values():
            stop.set()
        for thread, _ in self._agents.values():
            thread.join()

    def _start(self, order: StartAgent) -> None:
        """Let an agent run in a thread, with a log of its own."""
        handler = log_to_file(order.name, Path(order.log_file))
        stop = StopSignal()

        def live() -> None:
            with acting_for(order.name), contextlib.closing(handler):
                code = self._live(order, stop)
                logging.getLogger().removeHandler(handler)
            self._report(AgentEnded(order.name, code))

        thread = threading.Thread(target=live, name=order.name, daemon=True)
        self._agents[order.name] = (thread, stop)
        thread.start()

    def _live(self, order: StartAgent, stop: StopSignal) -> int:
        """Run an agent to its end; returns what would be its exit code."""
        try:
            return exit_code(lambda: self._run_agent(order, stop))
        except SystemExit as end:
            if end.code is None or isinstance(end.code, int):
                return end.code or 0
            _log.error("%s", end.code)  # as Python does where it ends the process
            return EXIT_FAILED
        except BaseException:  # it would end a process of its own, with this text
            _log.exception("agent %s has ended", order.name)
            return EXIT_FAILED
        finally:
            gc.unfreeze()  # what the agent leaves behind is garbage

    def _run_agent(self, order: StartAgent, stop: StopSignal) -> None:
        options = self._options
        run_agent(
            load_class(order.program, options.beside),
            graph=options.graph,
            name=order.name,
            config=dict(order.config),
            router=options.connect,
            seed=options.seed,
            stop=stop,
            restarts=order.restarts,
            alone=False,
            interest=order.interest,
        )

    def _report(self, report: AgentEnded) -> None:
        with contextlib.suppress(OSError):  # the launcher is gone
            os.write(self._options.reports, encode_line(report))


def main() -> int:
    """Run the process; returns the exit code."""
    exit_if_short()
    options = _parser().parse_args()
    os.set_inheritable(options.reports, False)
    log_to_terminal(options.name, options.log_level).addFilter(said_by(""))
    process = SharedProcess(options)
    launcher_is_gone = follow_launcher(os.environ, process.stop, process.take)
    with set_on_signals(process.stop):
        process.run()
    if launcher_is_gone.is_set():
        clear_up_after_launcher(options.graph)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m dsr.runtime.shared_process", description=__doc__)
    add = parser.add_argument
    add("name", help="of the process, for its log")
    add("--graph", required=True, help="name of the graph that the agents join")
    add("--beside", type=Path, metavar="FOLDER", help="where modules are found beside those that are installed")
    add("--connect", metavar="ENDPOINT", help="also join the Zenoh router at tcp/HOST:7447")
    add("--seed", type=int, default=0, help="seed of all random numbers; default: %(default)s")
    add("--log-level", default="info", choices=["debug", "info", "warning", "error"], help="default: %(default)s")
    add("--reports", type=int, required=True, metavar="DESCRIPTOR", help="to which the ends of agents are written")
    return parser


if __name__ == "__main__":
    sys.exit(main())
