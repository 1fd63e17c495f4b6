"""What the programs of the documents do, beyond running (test_pages_run.py)."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import dsr
from dsr import Memory, Pose
from dsr.runtime.launcher import Launcher
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec, load_system

ROOT = Path(__file__).parents[1]
NAMED_BLOCK = re.compile(r"^`([\w.]+)`:\n```\w+\n(.*?)^```$", re.DOTALL | re.MULTILINE)


@pytest.fixture
def agents_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The files that docs/how-to/agents.md shows, importable during the test."""
    for name, code in NAMED_BLOCK.findall((ROOT / "docs/how-to/agents.md").read_text(encoding="utf-8")):
        (tmp_path / name).write_text(code, encoding="utf-8")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    (tmp_path / "runtime").mkdir()
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    for file in tmp_path.glob("*.py"):
        sys.modules.pop(file.stem, None)


def set_scene(memory: Memory) -> None:
    memory.add_node("table", "table")
    memory.add_node("cube_3", "cube", perceived=True, size=(0.04, 0.04, 0.04))
    memory.add_node("cube_4", "cube", perceived=True, size=(0.02, 0.02, 0.02))


def test_the_agent_has_twenty_lines(agents_folder: Path) -> None:
    lines = (agents_folder / "counter.py").read_text().splitlines()
    assert len([line for line in lines if line.strip() and not line.startswith('"""')]) <= 20


def test_the_test_of_the_agent_passes(agents_folder: Path) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "test_counter.py"]
    result = subprocess.run(command, cwd=agents_folder, env=environment(), capture_output=True, text=True, check=False)
    assert result.returncode == 0 and "1 passed" in result.stdout, result.stdout


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def test_the_agent_works_as_a_process_that_finds_the_graph(agents_folder: Path) -> None:
    with dsr.connect("tabletop", agent="scene") as memory:
        set_scene(memory)
        memory.add_node("world", "world")
        for cube in ("cube_3", "cube_4"):
            memory.add_edge("world", cube, "RT", pose=Pose())
        with subprocess.Popen([sys.executable, "counter.py"], cwd=agents_folder, env=environment()) as process:
            changes = memory.watch(node_type="table", attribute="seen")
            change = changes.next(timeout=30)
            assert change is not None and memory.node("table")["seen"] == 2
            process.terminate()
            assert process.wait(20) == 0


def test_the_system_runs(agents_folder: Path) -> None:
    with Launcher(load_system(agents_folder / "counting.toml"), agents_folder / "run") as launcher:
        set_scene(launcher.memory)
        launcher.wait_ready()
        changes = launcher.memory.watch(node_type="table", attribute="seen")
        while launcher.memory.node("table").get("seen") != 1:
            assert changes.next(timeout=30) is not None


def test_the_filter_has_ten_lines_and_leaves_out_what_is_small(
    agents_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = (ROOT / "docs/how-to/filters.md").read_text(encoding="utf-8")
    blocks = dict(NAMED_BLOCK.findall(document))
    lines = [line for line in blocks["small_objects.py"].splitlines() if line.strip() and not line.startswith('"""')]
    assert len(lines) <= 10
    for name, code in blocks.items():
        (agents_folder / name).write_text(code, encoding="utf-8")
    assert [spec.kind.__name__ for spec in load_system(agents_folder / "cascade.toml").agents] == [
        "PassThrough", "ByType", "RelationsMonitor",
    ]  # fmt: skip
    with dsr.connect("filtering", agent="scene") as memory:
        world = memory.create_world("world1")
        command = [sys.executable, "small_objects.py", "--graph", "filtering"]
        with subprocess.Popen(command, cwd=agents_folder, env=environment()) as process:
            for name, edge in (("small", 0.04), ("large", 0.06)):
                world.add_node(name, "cube", size=(edge, edge, edge))
            with memory.watch(node_type="world_record") as records:
                while "world2" not in [info.name for info in memory.worlds()]:
                    assert records.next(timeout=30) is not None
            filtered = memory.world("world2")
            changes = filtered.watch(node_type="cube")
            while "large" not in filtered:
                assert changes.next(timeout=30) is not None
            assert "small" not in filtered
            process.terminate()
            assert process.wait(20) == 0


def test_names_of_ones_own_can_be_registered(agents_folder: Path) -> None:
    thermometer = importlib.import_module("own_names").Thermometer
    with Lockstep([AgentSpec("thermometer", thermometer)], strict=True) as lockstep:
        lockstep.run_for(0.2)
        assert lockstep.memory.node("heater_1")["temperature"] == 293.15
