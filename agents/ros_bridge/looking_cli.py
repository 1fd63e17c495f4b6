"""`dsr ros list` and `dsr ros check`: what a robot says, and why nothing arrives."""

from __future__ import annotations

from contextlib import closing
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.table import Table

from agents.ros_bridge.link.link import LinkConfig
from agents.ros_bridge.link.opening import open_link
from agents.ros_bridge.messages.types import types_of
from agents.ros_bridge.options import (
    ROUTER,
    BeyondOption,
    DistroOption,
    DomainOption,
    InstalledOption,
    RosRouterOption,
    TransportName,
    TransportOption,
)
from agents.ros_bridge.watching import TopicSeen, look
from agents.ros_bridge.watching import check as find_problems
from dsr.cli.common import JsonOption, console, print_json, shown

_NODE = "/dsr/looking"


def list_topics(
    transport: TransportOption = TransportName.zenoh,
    domain: DomainOption = 0,
    distro: DistroOption = "jazzy",
    ros_router: RosRouterOption = ROUTER,
    beyond_loopback: BeyondOption = False,
    seconds: Annotated[float, typer.Option("--for", min=0.0, metavar="S", help="Listen so long; 0: no rates.")] = 2.0,
    as_json: JsonOption = False,
) -> None:
    """List the topics and services of a robot: types, rates, and the nodes that publish and subscribe."""
    config = LinkConfig(transport.value, domain, distro, ros_router, beyond_loopback)
    with closing(open_link(config, _NODE)) as link:
        found = look(link, types_of(distro), seconds)
        problems = [] if found else link.problems()
    if as_json:
        print_json(found)
    elif found:
        console.print(_table(found))
    else:
        console.print("no topics are visible", soft_wrap=True)
    for problem in problems:
        console.print(f"[yellow]![/] {shown(problem)}", soft_wrap=True)


def check(
    topics: Annotated[
        list[str] | None, typer.Argument(metavar="[TOPIC]...", help="Such as /tf: listen to these.")
    ] = None,
    transport: TransportOption = TransportName.zenoh,
    domain: DomainOption = 0,
    distro: DistroOption = "jazzy",
    ros_router: RosRouterOption = ROUTER,
    beyond_loopback: BeyondOption = False,
    installed_ros: InstalledOption = "",
    seconds: Annotated[float, typer.Option("--for", min=0.1, metavar="S", help="Listen so long.")] = 2.0,
    as_json: JsonOption = False,
) -> None:
    """Tell why nothing arrives: versions, router, domain, types, QoS. The exit code is 1 if there is a reason."""
    config = LinkConfig(transport.value, domain, distro, ros_router, beyond_loopback, installed_ros)
    with closing(open_link(config, _NODE)) as link:
        found = find_problems(link, config, types_of(distro), topics or [], seconds)
    if as_json:
        print_json(found)
    else:
        versions = ", ".join(f"{package} {text}" for package, text in found.versions.items())
        console.print(f"versions  {versions}\nreached   {shown(found.reached)}", soft_wrap=True)
        console.print(f"nodes     {shown(', '.join(found.nodes)) or 'none'}", soft_wrap=True)
        for warning in [*found.unauthenticated, *found.lost]:
            console.print(f"[yellow]![/] {shown(warning)}", soft_wrap=True)
        for problem in found.problems:
            console.print(f"[red]✗[/] {shown(problem)}", soft_wrap=True)
        if not found.problems:
            console.print("[green]✓[/] nothing stands in the way")
    raise typer.Exit(1 if found.problems else 0)


def _table(found: list[TopicSeen]) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("topic and type", "from", "to"):
        table.add_column(heading, overflow="fold")
    table.add_column("/s", justify="right", no_wrap=True)
    table.add_column("MB/s", justify="right", no_wrap=True)
    for one in found:
        name = f"{shown(one.name)} [dim](service)[/]" if one.service else shown(one.name)
        hz = "" if one.hz is None else f"{one.hz:.1f}"
        amount = "" if one.bytes_per_s is None else f"{one.bytes_per_s / 1e6:.2f}"
        lines = [name, *(f"[dim]{shown(type)}[/]" for type in one.types)]
        if one.note:
            lines.append(f"[yellow]{shown(one.note)}[/]")
        table.add_row("\n".join(lines), _who(one.publishers), _who(one.subscribers), hz, amount)
    return table


def _who(nodes: list[str]) -> str:
    return "\n".join(shown(node) for node in dict.fromkeys(nodes))
