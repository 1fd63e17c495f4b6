"""The state of all worlds in a folder: there again after everything died, and gone once they are deleted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dsr import Memory
from dsr.crdt.delta import Delta
from dsr.persistence.generations import Generations
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


def test_each_folder_is_read_once(net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    memory, keeper = kept(net, tmp_path)
    memory.create_world("w").add_node("ball", "ball")
    memory.fork("view", of="w", follow=True).add_node("ghost", "ball")
    keeper.flush()
    counts: Counter[str] = Counter()
    restored = Generations.restored

    def counted(self: Generations) -> Iterator[Delta]:
        counts[self._folder.parent.name if self._folder != tmp_path else "base"] += 1
        return restored(self)

    monkeypatch.setattr(Generations, "restored", counted)
    again, keeper = kept(after_a_crash(net, keeper), tmp_path)
    assert counts == {"base": 1, "w": 1, "view": 1}
    assert keeper.restored and all(one.restored for one in keeper._keepers.values())
    assert "ball" in again.world("w") and "ghost" in again.world("view")


def test_a_folder_that_cannot_be_read_holds_up_no_other_world(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    for name in ("bad", "good"):
        memory.create_world(name).add_node("ball", "ball")
    net.pump(1.0)
    keeper.flush()
    (journal,) = tmp_path.glob("worlds/bad/*/journal-*")
    journal.unlink()
    journal.mkdir()
    memory, _ = kept(after_a_crash(net, keeper), tmp_path)
    assert "ball" in memory.world("good") and journal.exists()


def test_what_was_kept_joins_a_world_that_is_open_already(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    memory.create_world("w").add_node("ball", "ball")
    keeper.flush()
    listed = memory.snapshot()
    again = after_a_crash(net, keeper).join("keeper")
    again.restore(listed)
    again.create_world("w", exist_ok=True).add_node("cup", "cup")
    WorldKeeper(again, tmp_path, threaded=False)
    assert {"world", "ball", "cup"} <= {node.name for node in again.world("w").nodes()}
