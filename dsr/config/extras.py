"""Tells which extra of the distribution brings a library that is not installed."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable

from dsr.errors import ConfigError

DISTRIBUTION = "dsr-memory"
"""Name on the package index."""
EXTRAS = {
    "cryptography": "cli", "lark": "cli", "lz4": "cli", "mcap": "cli", "rich": "cli", "typer": "cli",
    "zstandard": "cli",
    "collada": "sim", "cv2": "sim", "psutil": "sim", "pybullet": "sim", "pybullet_data": "sim", "scipy": "sim",
    "ruckig": "sim", "trimesh": "sim",
    "mcp": "assist", "anyio": "assist", "uvicorn": "assist",
    "dynamixel_sdk": "dynamixel",
    "rerun": "view",
    "up_fast_downward": "planning",
    "ai_edge_litert": "hands",
    "mediapipe": "mediapipe",
    "pyrealsense2": "realsense",
    "rosbags": "ros", "xxhash": "ros",
    "cyclonedds": "ros-dds",
    "xacrodoc": "xacro",
}  # fmt: skip
"""The extra that brings each optional module."""


class MissingExtraError(ConfigError):
    """Something needs a library of an extra that is not installed."""


def missing_extra(error: BaseException) -> str | None:
    """How to install the module whose absence is this `error`; None if the error is of another kind."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return None
    module = error.name.partition(".")[0]
    if module not in EXTRAS:
        return None
    return f"the library {module!r} is not installed; run: pip install '{DISTRIBUTION}[{EXTRAS[module]}]'"


def check_installed(libraries: Iterable[str], who: str) -> None:
    """Raise `MissingExtraError`, which begins with `who` needs them, if one of these modules is not installed."""
    for library in libraries:
        try:
            found = importlib.util.find_spec(library) is not None
        except ValueError:  # it was put out of reach
            found = False
        if not found:
            absent = missing_extra(ModuleNotFoundError(name=library)) or f"the library {library!r} is not installed"
            raise MissingExtraError(f"{who}: {absent}")
