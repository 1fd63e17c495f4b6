"""Options that the commands of `dsr ros` have in common: how the robot is reached."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from agents.ros_bridge.link.link import LinkConfig

ROUTER = LinkConfig().router


class TransportName(StrEnum):
    """How ROS 2 is reached."""

    zenoh = "zenoh"
    dds = "dds"


TransportOption = Annotated[
    TransportName, typer.Option(help="zenoh for nodes under rmw_zenoh_cpp, dds for those under any DDS.")
]
DomainOption = Annotated[
    int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, max=232, metavar="N", help="ROS_DOMAIN_ID of the robot.")
]
DistroOption = Annotated[
    str, typer.Option(envvar="ROS_DISTRO", metavar="NAME", help="Release of ROS 2: humble, jazzy, kilted, ...")
]
RosRouterOption = Annotated[str, typer.Option("--ros-router", metavar="ENDPOINT", help="Zenoh router of the robot.")]
InstalledOption = Annotated[
    str, typer.Option("--installed-ros", metavar="FILE", help="With dds: setup.bash of the ROS that asks actions.")
]
BeyondOption = Annotated[
    bool, typer.Option("--beyond-loopback", help="Reach other machines. What comes from ROS is not authenticated.")
]
