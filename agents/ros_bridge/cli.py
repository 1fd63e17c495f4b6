"""The command `dsr ros`: robots that speak ROS 2."""

from __future__ import annotations

import typer

from agents.ros_bridge.looking_cli import check, list_topics
from agents.ros_bridge.run_cli import run

app = typer.Typer(name="ros", no_args_is_help=True, help="Connect the memory with robots that speak ROS 2.")
app.command("list")(list_topics)
app.command("check")(check)
app.command("run")(run)


@app.callback()
def ros() -> None:
    """Connect the memory with robots that speak ROS 2."""
