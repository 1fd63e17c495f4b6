"""Lists of worlds and parts that somebody made long, or wrong: who opens, keeps or holds all of them goes on."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from dsr import DsrError, Memory, WorldError, WorldInfo
from dsr.crdt.delta import Add, Delta, Write
from dsr.parts import held
from dsr.parts.registry import node_name as part_node
from dsr.persistence import world_keeper
from dsr.persistence.world_keeper import WorldKeeper
from dsr.replication.wire import encode_delta
from dsr.worlds.presence import MOST_FOLLOWED, WorldPresence
from dsr.worlds.registry import MOST_OVERLAYS, node_name, to_attribute
from tests.dsr.conftest import Net

LIAR = "liar-1"
KEPT = logging.getLogger("dsr.persistence")


def listed(memory: Memory, type: str, records: dict[str, str]) -> None:
    """One message with entries by the names of their nodes."""
    adds = [Add((LIAR, number + 1), name, type) for number, name in enumerate(records)]
    first = len(adds)
    writes = [
        Write(add.dot, "record", 1, LIAR, (LIAR, first + number + 1), record)
        for number, (add, record) in enumerate(zip(adds, records.values(), strict=True))
    ]
    delta = Delta(adds=adds, writes=writes, context=[(LIAR, 1, 2 * first)])
    memory.replica.synchroniser.receive_delta(LIAR, encode_delta(delta), 0.0)
    assert not memory.dropped


def worlds(memory: Memory, parents: dict[str, str | None]) -> None:
    """Worlds in the list, by the names of those that they show."""
    records = {
        node_name(name): to_attribute(WorldInfo(name, parent, parent is not None), f"{name}-1")
        for name, parent in parents.items()
    }
    listed(memory, "world_record", records)


def test_overlays_in_a_row_are_few(net: Net) -> None:
    memory = net.join("me")
    world = memory
    for number in range(MOST_OVERLAYS):
        world = world.fork(f"w{number}", follow=True)
    with pytest.raises(WorldError, match="more than 32"):
        world.fork("one_more", follow=True)
    memory.add_node("thing", "cube")
    assert "thing" in world and "thing" in world.fork("copy")
    net.pump(0.5)
    assert not world.closed


def test_a_row_of_overlays_without_end_is_not_opened(net: Net, tmp_path: Path) -> None:
    memory = net.join("keeper")
    worlds(memory, {f"w{number}": f"w{number - 1}" if number else "base" for number in range(3000)})
    for name in ("w40", "w2999"):
        with pytest.raises(WorldError, match="more than 32"):
            memory.world(name)
    keeper = WorldKeeper(memory, tmp_path, threaded=False)
    assert {world.world_name for world in memory.opened_worlds()[1:]} == {f"w{n}" for n in range(MOST_OVERLAYS)}
    memory.add_node("thing", "cube")
    net.pump(0.5)
    keeper.flush()
    assert not memory.world("w31").closed and "thing" in memory.world("w31")


def test_who_follows_all_worlds_follows_so_many_and_those_of_others(net: Net) -> None:
    """Each takes a subscription: 8000 were declared to all peers."""
    memory, other = net.join("me"), net.join("other")
    memory.create_world("zebra")
    net.pump(1.0)
    worlds(other, {f"w{number}": None for number in range(2 * MOST_FOLLOWED)})
    presence = WorldPresence(other)
    assert len(presence._watches) == MOST_FOLLOWED + 1
    net.pump(0.2)
    there = presence.agents()
    assert there["base"] == there["zebra"] == ["me"] and len(there) == 2 * MOST_FOLLOWED + 2


def test_of_worlds_that_are_gone_nothing_is_kept_by_who_follows_all(net: Net) -> None:
    memory = net.join("me")
    memory.create_world("zebra")
    net.pump(0.2)
    presence = WorldPresence(memory)
    assert set(presence._tokens) == {"base", "zebra"}
    memory.delete_world("zebra")
    net.pump(0.2)
    presence.follow()
    assert set(presence._tokens) == {"base"} and list(presence._watches) == [""]


def test_a_record_with_a_name_that_nothing_has_lists_no_world(net: Net, caplog: pytest.LogCaptureFixture) -> None:
    """An error quotes what a world shows: with a record of a megabyte, it was as long."""
    memory = net.join("me")
    worlds(memory, {"orphan": "nothing" * 100, "long": "p" * 10**6})
    assert [info.name for info in memory.worlds()] == ["base", "orphan"]
    for name in ("orphan", "long"):
        with pytest.raises(DsrError) as raised:
            memory.world(name)
        assert len(str(raised.value)) < 1000


def test_a_keeper_tells_once_what_it_cannot_keep(
    net: Net, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    memory = net.join("keeper")
    worlds(memory, {"orphan": "nothing" * 100})
    keeper = WorldKeeper(memory, tmp_path, threaded=False)
    for _ in range(5):
        keeper.flush()
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


def test_a_keeper_looks_through_a_long_list_only_when_it_has_changed(
    net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 8000 worlds each look took 0.13 s, four times a second."""
    memory, looks = net.join("keeper"), list[float]()
    worlds(memory, {f"w{number}": "nothing" for number in range(100)})
    keeper, channels = WorldKeeper(memory, tmp_path, threaded=False), memory.world_channels

    def counted() -> dict[str, str]:
        looks.append(net.clock.now())
        return channels()

    monkeypatch.setattr(memory, "world_channels", counted)
    for _ in range(20):
        net.pump(0.05)
        keeper.flush()
    assert len(looks) == 0
    memory.create_world("late").add_node("thing", "cube")
    keeper.flush()
    assert len(looks) == 1 and [folder.parent.name for folder in keeper._keepers] == ["late"]
    memory.delete_world("late")
    keeper.flush()
    assert len(looks) == 2 and not keeper._keepers
    net.pump(6.0)
    keeper.flush()
    assert len(looks) == 3, "what could not be kept is tried again"


def test_a_keeper_keeps_so_many_worlds_first_those_that_it_has(
    net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(world_keeper, "MOST_WORLDS", 3)
    memory = net.join("keeper")
    memory.create_world("zebra").add_node("thing", "cube")
    net.pump(0.5)
    keeper = WorldKeeper(memory, tmp_path, threaded=False)
    worlds(memory, {f"w{number}": None for number in range(10)})
    net.pump(0.5)
    for _ in range(3):
        keeper.flush()
    assert len(keeper._keepers) == 3 and len(caplog.records) == 8
    for one in [keeper.base, *keeper._keepers.values()]:
        one.abandon()
    after = Net()
    again = after.join("keeper")
    after.pump(0.2)
    WorldKeeper(again, tmp_path, threaded=False)
    assert "thing" in again.world("zebra")
    assert len(list((tmp_path / "worlds").iterdir())) == 3, "files of what is listed are gone"


def test_who_asks_for_all_parts_holds_so_many(
    net: Net, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(held, "MOST_PARTS", 5)
    memory = net.join("me", interest=("*",))
    memory.create_part("kitchen")
    listed(memory, "part_record", {part_node(f"p{number}"): "{}" for number in range(100)})
    net.pump(1.0)
    assert len(memory.parts()) == 101 and len(memory.interest) == 5 and "kitchen" in memory.interest
    assert len(caplog.records) == 1
    memory.hold_part("p99")
    assert len(memory.interest) == 6, "one that is named is held all the same"
    other = net.join("other", interest=())
    net.pump(1.0)
    other.hold_part("*", "p77")
    assert len(other.interest) == 6 and "p77" in other.interest
