"""The state of all worlds in a folder: there again after everything died, and gone once they are deleted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dsr import Memory
from dsr.persistence.world_keeper import WorldKeeper
from tests.dsr.conftest import Net, tabletop


def kept(net: Net, folder: Path) -> tuple[Memory, WorldKeeper]:
    memory = net.join("keeper")
    net.pump(0.2)
    return memory, WorldKeeper(memory, folder, threaded=False)


def after_a_crash(net: Net, keeper: WorldKeeper) -> Net:
    for one in [keeper.base, *keeper._keepers.values()]:
        one.abandon()
    after = Net()
    after.clock.advance_to(net.clock.now() + 60.0)
    return after


def test_worlds_forks_and_overlays_are_there_again(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    tabletop(memory)
    net.pump(1.0)
    other = net.join("other")
    net.pump(0.5)
    other.create_world("made").add_node("ball", "ball", mass=1.0)
    other.fork("idea").update_node("cube_3", mass=2.0)
    view = other.fork("view", follow=True)
    view.update_node("cube_3", mass=3.0)
    view.remove_node("table")
    view.add_node("ghost", "ball")
    net.pump(1.5)
    keeper.flush()
    net.pump(0.5)
    other.world("made").update_node("ball", mass=4.0)
    net.pump(0.5)
    keeper.flush()
    memory, _ = kept(after_a_crash(net, keeper), tmp_path)
    assert [info.name for info in memory.worlds()] == ["base", "idea", "made", "view"]
    assert memory.world("made").node("ball")["mass"] == 4.0
    assert memory.world("idea").node("cube_3")["mass"] == 2.0 and "table" in memory.world("idea")
    again = memory.world("view")
    assert again.node("cube_3")["mass"] == 3.0 and "table" not in again and "ghost" in again and "table" in memory


def test_a_deleted_world_leaves_no_files_and_does_not_come_back(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    memory.create_world("w").add_node("old", "ball")
    keeper.flush()
    assert list((tmp_path / "worlds" / "w").iterdir())
    memory.delete_world("w")
    keeper.flush()
    assert not list((tmp_path / "worlds").iterdir())
    memory.create_world("w")
    keeper.flush()
    again, _ = kept(after_a_crash(net, keeper), tmp_path)
    assert "old" not in again.world("w") and "world" in again.world("w")


def test_nobody_sees_a_world_before_it_is_restored(net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory, keeper = kept(net, tmp_path)
    tabletop(memory)
    plan = memory.fork("plan")
    plan.fork("above", follow=True).add_node("ghost", "ball")
    plan.add_node("cup", "cube")
    net.pump(1.0)
    keeper.flush()
    seen: dict[str, set[str]] = {}
    hold = Memory.hold_world

    def looked_at(self: Memory, name: str, **options: Any) -> Memory:
        held = hold(self, name, **options)
        seen[name] = {node.name for node in held.nodes()}
        return held

    monkeypatch.setattr(Memory, "hold_world", looked_at)
    kept(after_a_crash(net, keeper), tmp_path)
    assert seen["plan"] == {"world", "table", "cube_3", "cup"}
    assert seen["above"] == {*seen["plan"], "ghost"}
