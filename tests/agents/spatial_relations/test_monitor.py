"""Spatial relations in a world beside the base."""

from __future__ import annotations

from agents.filters.pass_through import PassThrough
from agents.spatial_relations.monitor import RelationsMonitor
from dsr import Pose
from dsr.runtime.lockstep import Lockstep
from dsr.runtime.system import AgentSpec

WANTED = {"agent": {"relations": ["above"]}}


def run(*specs: AgentSpec) -> Lockstep:
    lockstep = Lockstep(specs, strict=True)
    base = lockstep.memory
    base.add_node("world", "world")
    for name, z in (("low", 0.02), ("high", 0.06)):
        base.add_node(name, "cube", size=(0.04, 0.04, 0.04))
        base.add_edge("world", name, "RT", pose=Pose((0.4, 0.0, z)))
    return lockstep


def test_relations_are_added_to_the_world_that_is_read() -> None:
    copy = AgentSpec("copy", PassThrough, {"reads": ["base"], "writes": "stable"})
    with run(copy, AgentSpec("relations", RelationsMonitor, WANTED)) as lockstep:
        lockstep.run_for(1.0)
        stable = lockstep.memory.world("stable")
        assert [edge.key for edge in stable.edges("above")] == [("high", "low", "above")]
        assert not lockstep.memory.edges("above")
        lockstep.memory.update_edge("world", "high", "RT", pose=Pose((0.6, 0.0, 0.06)))
        lockstep.run_for(1.0)
        assert not stable.edges("above")


def test_or_to_an_overlay_of_it() -> None:
    config = {"reads": ["base"], "writes": "related", **WANTED}
    with run(AgentSpec("relations", RelationsMonitor, config)) as lockstep:
        lockstep.run_for(1.0)
        assert [edge.key for edge in lockstep.memory.world("related").edges("above")] == [("high", "low", "above")]
        assert not lockstep.memory.edges("above")
