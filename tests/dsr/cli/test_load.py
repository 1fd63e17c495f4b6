"""`dsr load` of meshes into a running graph."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dsr import ConfigError, Memory, MeshNotFoundError
from dsr.geometry import bounding_box, mesh_hashes

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "flag.obj"
    file.write_text(TRIANGLE, encoding="utf-8")
    return file


def test_a_mesh_is_there_when_the_command_ends(memory: Memory, cli: Callable[..., str], file: Path) -> None:
    said = cli("load", "base", str(file), "--under", "table", "--at", "0.1,0,0", "--scale", "0.001", "--prefix", "my_")
    assert "loaded 1 nodes, 1 meshes into graph scene: my_flag" in said
    node = memory.node("my_flag")
    assert node.type == "object" and memory.transform("table", "my_flag").t == (0.1, 0.0, 0.0)
    assert memory.mesh(*mesh_hashes(node)).bounds.high == pytest.approx((0.001, 0.001, 0.0))
    assert bounding_box(memory, "table") is not None


def test_the_world_may_be_left_out(memory: Memory, cli: Callable[..., str], file: Path) -> None:
    cli("load", str(file), "--type", "cup", "--up", "y")
    assert memory.node("flag")["size"] == pytest.approx((1.0, 0.0, 1.0))


def test_another_world_gets_it_and_the_base_does_not(memory: Memory, cli: Callable[..., str], file: Path) -> None:
    hypothesis = memory.create_world("hypothesis")
    assert "into world hypothesis of scene: flag" in cli("load", "hypothesis", str(file))
    assert hypothesis.node("flag").type == "object" and "flag" not in memory
    cli("load", "hypothesis", str(file.with_suffix(".obj")), "--prefix", "second_")
    assert "second_flag" in hypothesis


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--under", "roof"], "roof"),
        (["--type", "flags"], "unknown node type"),
        (["--at", "1,2"], "three numbers"),
        (["--up", "w"], "expected x, y or z"),
        (["--scale", "-1"], "scale"),
        (["--prefix", "a b"], "name"),
    ],
)
def test_wrong_arguments_change_nothing(
    memory: Memory, cli: Callable[..., str], file: Path, arguments: list[str], message: str
) -> None:
    before = len(memory.nodes())
    with pytest.raises(ConfigError, match=message):
        cli("load", "base", str(file), *arguments)
    assert len(memory.nodes()) == before


def test_wrong_files_and_worlds_are_told(memory: Memory, cli: Callable[..., str], file: Path, tmp_path: Path) -> None:
    for world, path, message in (("base", tmp_path / "none.stl", "cannot be read"), ("nowhere", file, "nowhere")):
        with pytest.raises(ConfigError, match=message):
            cli("load", world, str(path))


def test_a_mesh_that_nobody_can_take_is_told(
    memory: Memory, cli: Callable[..., str], file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dsr.cli.load._PATIENCE", 0.5)
    monkeypatch.setattr("dsr.geometry.cache.DiskCache.read", lambda *_: None)
    memory.meshes.close()
    with pytest.raises(MeshNotFoundError, match="nobody else took"):
        cli("load", "base", str(file))
