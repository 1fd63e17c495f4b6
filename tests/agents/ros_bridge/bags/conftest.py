"""A drive as a bag, for tests of what is made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.agents.ros_bridge.bags.made import FORMATS, drive


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return FORMATS["mcap file, zstd"](tmp_path_factory.mktemp("bag"), drive())
