"""Bytes and hashes of real ROS: those that the tests without it compare with, and those of every type that it has."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from agents.ros_bridge.messages.types import types_of
from tests.agents.ros_bridge.samples import plain, samples
from tests.ros.interfaces import write_package
from tests.ros.real_node import PYTHON, RealNode

TYPES = types_of("jazzy")
GOLDEN = Path(__file__).parents[1] / "agents" / "ros_bridge" / "golden.json"
"""What real ROS says of `samples`; to write it anew after a change there: `DSR_WRITE_GOLDEN=1 make test-ros`"""
SHARE = PYTHON.parents[1] / "share"
GENERATED = ("vision_msgs", "apriltag_msgs", "control_msgs", "tf2_msgs", "example_interfaces")
FEWEST = 180
"""Types that both have"""


def hashes_below(folder: Path) -> dict[str, str]:
    """By type, as the real generators wrote them into files beside the definitions."""
    found = {}
    for file in folder.rglob("*.json"):
        for entry in json.loads(file.read_text()).get("type_hashes", []):
            found[entry["type_name"]] = entry["hash_string"]
    return found


def test_real_ros_reads_what_we_write_and_writes_what_we_read(real_node: Callable[[str], RealNode]) -> None:
    node, messages = real_node("encoder"), samples()
    real = {name: node.encode(type=name, cdr=TYPES.encode(name, one).hex()) for name, one in messages.items()}
    if os.environ.get("DSR_WRITE_GOLDEN"):
        hashes = {name: hash for name, hash in sorted(hashes_below(SHARE).items()) if name in TYPES}
        GOLDEN.write_text(json.dumps({"hashes": hashes, "bytes": real}, indent=0) + "\n")
    for name, message in messages.items():
        assert plain(TYPES.decode(name, bytes.fromhex(real[name]))) == plain(message), name


def test_each_type_that_both_have_has_the_same_hash() -> None:
    real = hashes_below(SHARE)
    both = [name for name in real if name in TYPES]
    assert len(both) > FEWEST
    assert {name: TYPES.hash(name) for name in both} == {name: real[name] for name in both}


def test_the_golden_hashes_are_those_of_real_ros() -> None:
    real = hashes_below(SHARE)
    golden = json.loads(GOLDEN.read_text())["hashes"]
    assert golden == {name: real[name] for name in golden}


@pytest.mark.parametrize("package", GENERATED)
def test_the_real_generator_gives_our_definitions_the_same_hashes(package: str, tmp_path: Path) -> None:
    """Also of services and actions, of packages that are not to be had built."""
    place = write_package(package, tmp_path)
    command = [str(PYTHON), str(Path(__file__).with_name("hash_interfaces.py")), package, str(place), str(SHARE)]
    subprocess.run(command, check=True)
    real = {
        name: hash for name, hash in hashes_below(place).items() if name.startswith(f"{package}/") and name in TYPES
    }
    assert real
    assert {name: TYPES.hash(name) for name in real} == real
