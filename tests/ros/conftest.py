"""What the tests against real ROS share; they are left out where `make test-ros` has not made its environment."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from agents.ros_bridge.link.dds.dds_link import DdsLink
from agents.ros_bridge.link.link import LinkConfig
from tests.ros.real_node import PYTHON, RealNode, a_domain

collect_ignore_glob = [] if PYTHON.exists() else ["test_*.py"]


@pytest.fixture
def domain() -> int:
    return a_domain()


@pytest.fixture
def real_node(domain: int) -> Iterator[Callable[[str], RealNode]]:
    """Starts real nodes in the domain of the test."""
    started: list[RealNode] = []

    def start(name: str) -> RealNode:
        started.append(RealNode(domain, name))
        return started[-1]

    yield start
    for node in started:
        node.close()


@pytest.fixture
def link(domain: int) -> Iterator[DdsLink]:
    """Ours in the same domain."""
    opened = DdsLink(LinkConfig(transport="dds", domain=domain), "/dsr/bridge")
    yield opened
    opened.close()
