"""The standard filters, in lockstep."""

from __future__ import annotations

from typing import Any

import pytest

from agents.filters.by_name import ByName
from agents.filters.by_type import ByType
from agents.filters.by_volume import ByVolume
from agents.filters.pass_through import PassThrough
from dsr import Agent, ConfigError, Memory, Mesh, Pose, SchemaError
from dsr.config.toml import convert
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

WORLDS = {"reads": ["base"], "writes": "out"}


def scene(memory: Memory) -> None:
    memory.add_node("world", "world")
    for name, kind, edge in (("table", "table", 1.0), ("cube_1", "cube", 0.04), ("cube_2", "cube", 0.02)):
        memory.add_node(name, kind, size=(edge, edge, edge))
        memory.add_edge("world", name, "RT", pose=Pose())
    memory.add_node("camera", "camera")


@pytest.mark.parametrize(
    ("kind", "config", "expected"),
    [
        (PassThrough, {}, {"table", "cube_1", "cube_2", "camera"}),
        (ByType, {"types": ["cube", "table"]}, {"table", "cube_1", "cube_2"}),
        (ByType, {"leave_out": ["camera"]}, {"table", "cube_1", "cube_2"}),
        (ByName, {"names": ["cube_*"]}, {"cube_1", "cube_2"}),
        (ByName, {"names": ["cube_?", "camera"], "leave_out": ["*_2"]}, {"cube_1", "camera"}),
        (ByVolume, {"least": 1e-5}, {"table", "cube_1", "camera"}),
        (ByVolume, {"most": 1e-5}, {"cube_2", "camera"}),
    ],
)
def test_what_they_pass_on(kind: type[Agent], config: dict[str, Any], expected: set[str]) -> None:
    with Lockstep([AgentSpec("filter", kind, {**WORLDS, **config})], strict=True) as lockstep:
        scene(lockstep.memory)
        lockstep.run_for(1.0)
        out = lockstep.memory.world("out")
        assert {node.name for node in out.nodes()} == {"world", *expected}
        assert {edge.dst for edge in out.edges("RT")} == expected - {"camera"}


def test_a_thing_that_grows_is_passed_on_then() -> None:
    with Lockstep([AgentSpec("filter", ByVolume, {**WORLDS, "least": 1e-5})], strict=True) as lockstep:
        scene(lockstep.memory)
        lockstep.run_for(1.0)
        out = lockstep.memory.world("out")
        lockstep.memory.update_node("cube_2", size=(0.1, 0.1, 0.1))
        lockstep.run_for(1.0)
        assert out.get_edge("world", "cube_2", "RT") is not None


def test_a_thing_whose_mesh_comes_later_is_looked_at_again() -> None:
    with Lockstep([AgentSpec("filter", ByVolume, {**WORLDS, "most": 1e-5})], strict=True) as lockstep:
        scene(lockstep.memory)
        corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        mesh = Mesh(corners, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)])
        lockstep.memory.add_node("chair", "object", mesh=mesh.hash)
        lockstep.run_for(1.0)
        out = lockstep.memory.world("out")
        assert "chair" in out
        lockstep.memory.put_mesh(mesh)
        lockstep.run_for(10.0)
        assert "chair" not in out


def test_wrong_configurations_are_refused() -> None:
    for kind, config in ((ByVolume, {"least": 2.0, "most": 1.0}), (ByType, {"tipes": ["cube"]})):
        with pytest.raises(ConfigError):
            convert({**WORLDS, **config}, kind.Config, "configuration")
    with pytest.raises(SchemaError, match="cube"):
        Lockstep([AgentSpec("filter", ByType, {**WORLDS, "types": ["cub"]})], strict=True)
    with pytest.raises(ConfigError, match="names no world"):
        Lockstep([AgentSpec("filter", PassThrough)], strict=True)
    with pytest.raises(ConfigError, match="reads and writes world 'out'"):
        AgentSpec("filter", PassThrough, {"reads": ["out"], "writes": "out"})


def test_by_volume_goes_by_a_things_own_box_however_it_is_turned() -> None:
    with Lockstep([AgentSpec("filter", ByVolume, {**WORLDS, "least": 1e-3})], strict=True) as lockstep:
        base = lockstep.memory
        base.add_node("world", "world")
        for name, kind in (("frame", "group"), ("stick", "object"), ("small", "cube"), ("large", "box")):
            base.add_node(name, kind)
        base.update_node("stick", bounds=(0.0, 0.0, 0.0, 1.0, 0.01, 0.01))  # a box around it as it stands has 0.1 m^3
        base.update_node("small", size=(0.01, 0.01, 0.01))
        base.update_node("large", size=(0.2, 0.2, 0.2))
        askew = Pose.from_rotvec((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
        for parent, child in (("world", "frame"), ("frame", "stick"), ("frame", "small"), ("small", "large")):
            base.add_edge(parent, child, "RT", pose=askew)
        lockstep.run_for(1.0)
        large = base.world("out")
        assert {node.name for node in large.nodes()} >= {"world", "frame", "large"}
        assert "stick" not in large and "small" not in large
        assert max(large.transform("world", "large").distance(base.transform("world", "large"))) < 1e-9
