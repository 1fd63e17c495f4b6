"""The command `dsr view`: shows a running system in a window, or serves the view to browsers elsewhere."""

from __future__ import annotations

import ipaddress
import os
import socket
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer

from agents.viewer.agent import Viewer
from agents.viewer.config import ViewerConfig
from agents.viewer.window import LOOPBACK, WindowError, check_free, page_url, viewer_url
from dsr.cli.common import (
    CompanyNotice,
    GraphOption,
    RouterOption,
    SecurityOption,
    console,
    errors,
    joinable,
    shown,
)
from dsr.connecting import SECURITY
from dsr.errors import ConfigError
from dsr.runtime.agent_process import StopSignal, run_agent
from dsr.runtime.display import has_display
from dsr.runtime.signals import set_on_signals

_NAME = "view"
"""Of the agent; the system may have a viewer already."""
_LISTENS = 1.5  # s: a scenario tells its start once a second, and a replay its time more often
_DEFAULTS = ViewerConfig()

app = typer.Typer(name="view", invoke_without_command=True, subcommand_metavar="")
Bind = Annotated[str, typer.Option(metavar="ADDRESS", help="Where to serve; 0.0.0.0 for all who reach us.")]
Port = Annotated[int, typer.Option(min=1, max=65_535, metavar="PORT", help="TCP port of the data.")]
WebPort = Annotated[int, typer.Option(min=1, max=65_535, metavar="PORT", help="TCP port of the page.")]


@app.callback()
def view(
    serve: Annotated[bool, typer.Option("--serve", help="Open no window: serve the view to browsers.")] = False,
    bind: Bind = LOOPBACK,
    port: Port = _DEFAULTS.port,
    web_port: WebPort = _DEFAULTS.web_port,
    graph: GraphOption = None,
    router: RouterOption = None,
    security: SecurityOption = None,
) -> None:
    """Watch a running system live, until Ctrl-C or until the window is closed.

    Without a display, as on a robot, use --serve: then open the page that is told in a browser on another machine.
    The view shows what happens from now on, with what the graph holds at the beginning. Nothing is recorded.
    A recording is shown by `dsr replay RECORDING --view`.

    Example: dsr view --serve, and on your desk: ssh -L 9090:127.0.0.1:9090 -L 9876:127.0.0.1:9876 ROBOT
    """
    name = joinable(graph, router)
    if not serve and not has_display(os.environ, sys.platform):
        raise ConfigError("there is no display; serve the view to a browser elsewhere: dsr view --serve")
    if serve and port == web_port:
        raise ConfigError(f"--port and --web-port are both {port}: they must differ")
    if serve:
        check_free(bind, port, "--port")
        check_free(bind, web_port, "--web-port")
    if security is not None:
        os.environ[SECURITY] = str(security.resolve())
    stop = StopSignal()
    said: list[str] = []  # by a window or a server that ended

    class _View(Viewer):
        """The viewer of this command, which ends with its window."""

        name = _NAME

        def setup(self) -> None:
            super().setup()
            console.print(f"showing graph {shown(self.keys.graph)}; Ctrl-C ends it", soft_wrap=True)
            if serve:
                _tell_addresses(bind, port, web_port)
            self._company = CompanyNotice(self.memory)

        def tick(self, now: float) -> None:
            super().tick(now)
            self._company.look()

        def window_closed(self, log_file: Path) -> None:
            said.append(log_file.read_text(errors="replace").strip())
            stop.set()

    with tempfile.TemporaryDirectory(prefix="dsr-view-") as folder:
        config: dict[str, Any] = {"folder": folder, "record": False, "spawn": not serve, "serve": serve}
        config |= {"bind": bind, "port": port, "web_port": web_port, "listens": _LISTENS}
        with set_on_signals(stop):
            run_agent(_View, graph=name, name=_NAME, config=config, router=router, seed=0, stop=stop)
    if serve and said:
        raise WindowError(f"the server ended: {said[0].splitlines()[-1] if said[0] else 'it said nothing'}")


def _tell_addresses(bind: str, port: int, web_port: int) -> None:
    """Say how to see the view from here and from elsewhere."""
    host = socket.gethostname() if _is_any(bind) else bind
    console.print(f"browser        {page_url(port, web_port, host)}", soft_wrap=True)
    console.print(f"rerun viewer   rerun {viewer_url(port, host)}", soft_wrap=True)
    if _is_loopback(bind):
        tunnel = f"ssh -N -L {web_port}:{bind}:{web_port} -L {port}:{bind}:{port} {socket.gethostname()}"
        console.print(f"from elsewhere {tunnel}, then the same addresses there", soft_wrap=True)
    else:
        errors.print(f"everybody who can reach {shown(host)} can watch: no password is asked for", style="yellow")


def _is_any(bind: str) -> bool:
    try:
        return ipaddress.ip_address(bind).is_unspecified
    except ValueError:
        return False


def _is_loopback(bind: str) -> bool:
    try:
        return ipaddress.ip_address(bind).is_loopback
    except ValueError:
        return bind == "localhost"
