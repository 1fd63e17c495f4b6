"""A Zenoh router for the tests, links to it, and processes of the SDK."""

from __future__ import annotations

import json
import secrets
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from agents.ros_bridge.link.link import LinkConfig
from agents.ros_bridge.link.zenoh.zenoh_link import ZenohLink
from tests.agents.ros_bridge.told import Told


class Router:
    """What `rmw_zenohd` is: a router on a port of the loopback interface, which can go and come back."""

    def __init__(self) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port: int = probe.getsockname()[1]
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self._session: Any = None
        self.start()

    def start(self) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self._session = zenoh.open(config)

    def stop(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None


@pytest.fixture
def router() -> Iterator[Router]:
    started = Router()
    yield started
    started.stop()


@pytest.fixture
def connect(router: Router) -> Iterator[Callable[..., ZenohLink]]:
    """Opens links to the router."""
    opened: list[ZenohLink] = []

    def open_link(node: str = "/dsr/bridge", **options: Any) -> ZenohLink:
        config = LinkConfig(**{"router": router.endpoint, **options})
        opened.append(ZenohLink(config, node))
        return opened[-1]

    yield open_link
    for link in opened:
        link.close()


@pytest.fixture
def sdk(router: Router) -> Iterator[Told]:
    """A process of the SDK at the router."""
    process = Told([sys.executable, str(Path(__file__).with_name("sdk_node.py")), str(router.port)])
    yield process
    process.close()


@pytest.fixture
def topic() -> str:
    """A name that no other test has."""
    return f"/test_{secrets.token_hex(4)}"
