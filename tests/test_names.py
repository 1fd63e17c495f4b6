"""One name, one class: no two public classes of the packages share a name."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("dsr", "agents", "simulation_handler", "surprise", "planner")
SHARED: dict[str, str] = {
    "Qos": "ROS 2 calls its quality of service so too; another one than that of our network",
    "Topic": "of ROS 2; and what a story tells of",
}
"""Names that two classes share, with the reason."""


def test_no_two_public_classes_share_a_name() -> None:
    places = defaultdict(list)
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.parse(file.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    places[node.name].append(file.relative_to(ROOT).as_posix())
    several = {name: files for name, files in places.items() if len(files) > 1}
    assert {name: files for name, files in several.items() if name not in SHARED} == {}
    assert SHARED.keys() <= several.keys(), "no longer shared"
