"""Worlds of a secured graph: what is granted by type holds in each of them, and filters do their work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from agents.filters.by_type import ByType
from dsr import Access, AgentError, Memory, Pose
from dsr.clock import WALL_CLOCK
from dsr.connecting import connect
from dsr.graph.access import EVERYTHING
from dsr.runtime.launcher import Launcher
from dsr.runtime.system import load_system
from dsr.security.authority import SecurityFolder
from dsr.security.gate import Gate
from dsr.security.policy import AccessPolicy, Grant, checked, grant_for, system_grants, write_policy
from dsr.worlds import Filter
from tests.dsr.conftest import Net
from tests.dsr.security.conftest import GRANTS
from tests.dsr.security.test_secured_network import eventually

ALL = (EVERYTHING,)
WORLDS = ("world_record", "world")
SYSTEM = """
graph = "filtered"

[[agent]]
name = "cubes"
class = "agents.filters.by_type:ByType"
config = { reads = ["base"], writes = "cubes", types = ["cube"] }
"""
Join = Callable[..., Memory]


@pytest.fixture
def join(net: Net) -> Join:
    """One more replica: with guard and gate, or a rogue one that writes what it likes."""
    grants = {**GRANTS, "thinker": Grant((*WORLDS, "cube"), ("RT",), ("mass",))}
    policy = checked(grants)

    def start(agent: str, *, rogue: bool = False) -> Memory:
        return net.join(agent, gate=None if rogue else Gate(policy), guard=None if rogue else policy.guards()[agent])

    return start


def made(memory: Memory, kind: str) -> Memory:
    return memory.create_world("w") if kind == "made" else memory.fork("w", follow=kind == "overlay")


@pytest.mark.parametrize("kind", ["made", "fork", "overlay"])
def test_who_may_not_write_a_type_may_not_do_so_in_any_world(net: Net, join: Join, kind: str) -> None:
    thinker, arm, launcher = join("thinker"), join("arm", rogue=True), join("launcher")
    net.pump(2.0)
    thinker.add_node("world", "world")
    thinker.add_node("cube", "cube", mass=1.0)
    net.pump(1.0)
    world = made(thinker, kind)
    net.pump(1.0)
    with pytest.raises(AgentError, match="'table'"):
        world.add_node("table", "table")
    if kind != "made":
        assert world.node("cube")["mass"] == 1.0
    world.add_node("cube", "cube", mass=2.0)
    theirs, kept = arm.world("w"), launcher.world("w")
    net.pump(1.0)
    theirs.add_node("cube", "cube", mass=99.0)
    theirs.add_node("forged", "cube")
    theirs.add_node("gen3", "arm", status="fine")
    theirs.remove_node("cube")
    net.pump(3.0)
    for memory in (world, kept):
        assert memory.node("cube")["mass"] == 2.0 and "forged" not in memory
        assert memory.node("gen3")["status"] == "fine"
    assert world._graph.store.context == kept._graph.store.context


def test_worlds_are_made_and_deleted_by_those_who_may_write_their_list(net: Net, join: Join) -> None:
    thinker, arm, rogue = join("thinker"), join("arm"), join("scene", rogue=True)
    net.pump(2.0)
    thinker.create_world("w")
    net.pump(1.0)
    with pytest.raises(AgentError, match="world_record"):
        arm.create_world("mine")
    with pytest.raises(AgentError, match="world_record"):
        arm.delete_world("w")
    rogue.create_world("forged")
    rogue.delete_world("w")
    net.pump(3.0)
    assert [[info.name for info in memory.worlds()] for memory in (thinker, arm)] == [["base", "w"], ["base", "w"]]


def test_a_fork_is_whole_for_others_only_if_its_maker_is_trusted(net: Net, join: Join) -> None:
    """Anybody else is believed about what it wrote itself; an overlay shows each one's own parent, and needs nobody."""
    thinker, scene = join("thinker"), join("scene")
    net.pump(2.0)
    scene.add_node("table", "table", mass=3.0)
    thinker.add_node("cube", "cube", mass=1.0)
    net.pump(1.0)
    thinker.fork("fork").update_node("cube", mass=2.0)
    thinker.fork("overlay", follow=True).update_node("cube", mass=2.0)
    net.pump(1.0)
    arm = join("arm")
    net.pump(2.0)
    fork, overlay = arm.world("fork"), arm.world("overlay")
    net.pump(3.0)
    assert fork.node("cube")["mass"] == overlay.node("cube")["mass"] == 2.0
    assert "table" not in fork and overlay.node("table")["mass"] == 3.0


def test_a_filter_is_granted_what_its_class_declares() -> None:
    class Narrow(Filter):
        reads = ("base",)
        writes = "cubes"
        contents = Access(("cube",), ("RT",), ("mass",))

    assert grant_for(Narrow) == Grant(("cube", *WORLDS), ("RT",), ("mass",), tuple(Narrow.publishes))
    assert grant_for(ByType).nodes == ()  # of which the configuration says where it writes


def test_a_filter_of_a_secured_system_works(tmp_path: Path) -> None:
    file = tmp_path / "filtered.toml"
    file.write_text(SYSTEM)
    system = load_system(file)
    folder = SecurityFolder(tmp_path / "keys")
    folder.create(WALL_CLOCK.now())
    grants: dict[str, Any] = {**system_grants(system), "scene": Grant(("cube", "table", "world"), ("RT",), ("mass",))}
    for name in grants:
        folder.issue(name, WALL_CLOCK.now())
    write_policy(folder.policy, checked(grants))
    assert AccessPolicy(grants).grant("cubes").nodes == (EVERYTHING, *WORLDS)
    with Launcher(system, tmp_path / "run", security=folder.path) as launcher:
        launcher.wait_ready()
        with connect("filtered", agent="scene", security=folder.path) as scene:
            for name, kind in (("world", "world"), ("cube", "cube"), ("table", "table")):
                scene.add_node(name, kind)
            scene.add_edge("world", "cube", "RT", pose=Pose((1.0, 0, 0)))
            assert eventually(lambda: launcher.poll() or any(i.name == "cubes" for i in scene.worlds()))
            cubes = scene.world("cubes")
            assert eventually(lambda: "cube" in cubes and cubes.get_edge("world", "cube", "RT"))
            scene.remove_node("cube")
            assert eventually(lambda: "cube" not in cubes)
            assert "table" not in cubes
            cubes.add_node("cube_2", "cube", mass=1.0)
            with pytest.raises(AgentError, match="'ball'"):
                cubes.add_node("ball", "ball")
