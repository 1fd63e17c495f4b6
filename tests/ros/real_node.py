"""Starts nodes of real rclpy as processes."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from tests.agents.ros_bridge.told import Told

ROOT = Path(__file__).parents[2]
PYTHON = ROOT / ".venv-ros" / "bin" / "python"


class RealNode(Told):
    """A node of rclpy; each method name of `tests.ros.node.Commands` is a method here too."""

    def __init__(self, domain: int, name: str) -> None:
        environment = {
            **{key: value for key, value in os.environ.items() if not key.startswith(("PYTHON", "ROS_", "RMW_"))},
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        }
        super().__init__([str(PYTHON), str(ROOT / "tests" / "ros" / "node.py"), name], environment)


def a_domain() -> int:
    """A domain that most likely nobody else is in now."""
    return 20 + secrets.randbelow(200)
