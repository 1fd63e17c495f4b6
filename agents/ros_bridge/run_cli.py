"""The command `dsr ros run`: a bridge from another terminal, without a system file."""

from __future__ import annotations

import threading
from typing import Annotated, Any

import msgspec
import typer

from agents.ros_bridge.agent import RosBridge
from agents.ros_bridge.bridge.topics import receive
from agents.ros_bridge.link.link import LinkConfig, RosLink
from agents.ros_bridge.options import (
    ROUTER,
    BeyondOption,
    DistroOption,
    DomainOption,
    RosRouterOption,
    TransportName,
    TransportOption,
)
from dsr.cli.common import GraphOption, console
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError, suggest
from dsr.network.rendezvous import graphs
from dsr.runtime.agent_process import StopSignal, run_agent
from dsr.runtime.signals import set_on_signals

_GRAPH = "ros"
"""Name of the graph that begins if none runs."""
_APPEARS_WITHIN = 5.0
"""s for the publisher of a topic to be found: discovery takes less than a second, a node that starts a few"""
_LOOK = 0.1
"""s between two looks"""


def run(
    topics: Annotated[
        list[str] | None, typer.Option("--topics", metavar="TOPIC,...", help="Received topics; default: tf and joints.")
    ] = None,
    transport: TransportOption = TransportName.zenoh,
    domain: DomainOption = 0,
    distro: DistroOption = "jazzy",
    ros_router: RosRouterOption = ROUTER,
    beyond_loopback: BeyondOption = False,
    world_frame: Annotated[
        str, typer.Option(metavar="FRAME", help="Frame of ROS that is the memory's world: map, odom, ...")
    ] = "world",
    use_sim_time: Annotated[bool, typer.Option("--use-sim-time", help="Follow /clock of a simulation in ROS.")] = False,
    seconds: Annotated[
        float | None, typer.Option("--for", min=0.0, metavar="S", help="End after so long; default: with Ctrl-C.")
    ] = None,
    graph: GraphOption = None,
) -> None:
    """Bridge a robot that speaks ROS 2 and the running graph, or a new one, until Ctrl-C.

    Frames and joints come in, or the topics that are named. Beliefs,
    frames, joints, images, diagnostics and events go out, and
    questions are answered as services below /dsr.
    """
    running = graphs()
    name = graph or (running[0] if len(running) == 1 else _GRAPH)
    link = {
        "transport": transport.value, "domain": domain, "distro": distro, "router": ros_router,
        "beyond_loopback": beyond_loopback,
    }  # fmt: skip
    config: dict[str, Any] = {
        "link": link, "world_frame": world_frame, "clock": "follow" if use_sim_time else "auto",
    }  # fmt: skip
    wanted = [topic for given in topics or () for topic in given.split(",") if topic]
    if wanted:
        config["receive"] = receive(_types(link, wanted))
    stop = StopSignal()
    timer = threading.Timer(seconds, stop.set) if seconds is not None else None
    console.print(
        f"bridging ROS (domain {domain}, {transport.value}) and graph {name}" + ("" if timer else "; Ctrl-C ends it"),
        soft_wrap=True,
    )
    try:
        if timer:
            timer.start()
        with set_on_signals(stop):
            run_agent(RosBridge, graph=name, name=RosBridge.name, config=config, router=None, seed=0, stop=stop)
    finally:
        if timer:
            timer.cancel()


def _types(link: dict[str, Any], topics: list[str]) -> dict[str, str]:
    """The types of topics, as those who publish them say. Raises `ConfigError` for a topic that nobody publishes."""
    try:
        config = msgspec.convert(link, LinkConfig)
    except msgspec.ValidationError as error:
        raise ConfigError(f"connection to ROS: {error}") from error
    connection = RosBridge.connect(config, "/dsr_look")
    try:
        return find_types(connection, topics, _APPEARS_WITHIN)
    finally:
        connection.close()


def find_types(link: RosLink, topics: list[str], timeout: float) -> dict[str, str]:
    """Wait until all these topics have publishers; gives their types.

    Raises:
        ConfigError: if after `timeout` s somebody does not publish one of them.
    """
    deadline = WALL_CLOCK.monotonic() + timeout
    while True:
        seen = {end.topic.name: end.topic.type for end in link.endpoints() if end.kind == "publisher" and not end.mine}
        missing = [topic for topic in topics if topic not in seen]
        if not missing:
            return {topic: seen[topic] for topic in topics}
        if WALL_CLOCK.monotonic() > deadline:
            problems = "".join(f"; {problem}" for problem in link.problems())
            raise ConfigError(f"nobody publishes {missing[0]}; {suggest(missing[0], seen)}{problems}")
        WALL_CLOCK.wait(threading.Event(), _LOOK)
