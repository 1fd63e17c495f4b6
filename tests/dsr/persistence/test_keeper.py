"""The state of a memory in a folder: restored whole, however it was left; a disk that refuses harms nobody."""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dsr import ConfigError, Memory, Pose, StateKeeper
from dsr.crdt.delta import Add, Delta, Write
from dsr.crdt.store import Store
from dsr.persistence import keeper as keeper_module
from dsr.persistence.content import GraphContent
from dsr.persistence.pending import PendingWrites
from dsr.persistence.records import HEADER
from tests.dsr.conftest import Net


def kept(net: Net, folder: Path, agent: str = "keeper") -> tuple[Memory, StateKeeper]:
    """A new replica and the keeper of its state, both without threads."""
    memory = net.join(agent)
    return memory, StateKeeper(memory, folder, threaded=False)


def crash(net: Net, *keepers: StateKeeper) -> Net:
    """All replicas are gone and nobody wrote anything any more; a new network at the same time."""
    for keeper in keepers:
        keeper.abandon()
    after = Net()
    after.clock.advance_to(net.clock.now() + 60.0)
    return after


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "lock")


def state(memory: Memory) -> tuple[Any, Any]:
    content = GraphContent.of(memory)
    return content.nodes, content.edges


def fill(memory: Memory) -> None:
    memory.add_node("world", "world")
    memory.add_node("cube_1", "cube", mass=0.1, note="first")
    memory.add_node("cube_2", "cube", size=(0.1, 0.2, 0.3))
    memory.add_edge("world", "cube_1", "RT", pose=Pose((1.0, 2.0, 3.0), stamp=5.0))
    memory.add_edge("cube_2", "cube_1", "on", source="test")


def test_what_was_flushed_is_there_after_a_crash(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    assert not keeper.restored
    keeper.abandon()
    memory, keeper = kept(Net(), tmp_path)
    assert not keeper.restored  # nobody ever wrote
    fill(memory)
    memory.remove_attribute("cube_1", "note")
    memory.remove_node("cube_2")
    keeper.flush()
    again, second = kept(crash(net, keeper), tmp_path)
    assert second.restored and state(again) == state(memory)
    assert "cube_2" not in again and "note" not in again.node("cube_1")


def test_what_was_not_flushed_is_not(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    memory.add_node("world", "world")
    keeper.flush()
    memory.add_node("cube_1", "cube")
    again, _ = kept(crash(net, keeper), tmp_path)
    assert [node.name for node in again.nodes()] == ["world"]


def test_a_write_that_waited_for_its_node_during_the_snapshot_is_kept(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    graph = memory.replica.graph
    late, early = ("other-1", 1), Write(("other-1", 1), "mass", 1024, "other-1", ("other-1", 2), 0.5)
    graph.join(Delta(writes=[early], context=[("other-1", 2, 2)]), net.clock.now())
    keeper.snapshot()
    graph.join(Delta(adds=[Add(late, "cube_1", "cube")], context=[("other-1", 1, 1)]), net.clock.now())
    keeper.flush()
    again, _ = kept(crash(net, keeper), tmp_path)
    assert again.node("cube_1")["mass"] == memory.node("cube_1")["mass"] == 0.5
    assert again.replica.graph.store.context == graph.store.context


def test_a_write_to_what_an_answer_tells_to_be_gone_waits_no_more_after_a_crash(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    graph = memory.replica.graph
    early = Write(("other-1", 1), "mass", 1024, "other-1", ("other-1", 2), 0.5)
    graph.join(Delta(writes=[early], context=[("other-1", 2, 2)]), net.clock.now())
    keeper.snapshot()
    graph.join(Delta(context=[("other-1", 1, 1)], live=frozenset(), examined=[("other-1", 1, 1)]), net.clock.now())
    keeper.flush()
    again, _ = kept(crash(net, keeper), tmp_path)
    assert again.replica.graph.store.context == graph.store.context and not again.replica.graph.store.waiting_writes()


def test_changes_of_others_are_kept_streams_and_repairs_included(net: Net, tmp_path: Path) -> None:
    early = net.join("early")
    fill(early)
    net.pump(0.1)
    memory, keeper = kept(net, tmp_path)
    net.pump(2.0)
    other = net.join("other")
    net.pump(2.0)
    other.update_edge("world", "cube_1", "RT", pose=Pose((9.0, 0.0, 0.0), stamp=6.0))  # a sample without a dot
    other.flush()
    net.network.deliver()
    memory.poll()
    keeper.flush()
    after = crash(net, keeper)
    again, _ = kept(after, tmp_path)
    assert state(again) == state(memory)
    assert again.edge("world", "cube_1", "RT").pose.t == (9.0, 0.0, 0.0)
    newcomer = after.join("newcomer")
    after.pump(6.0)
    assert state(newcomer) == state(memory)


def test_writes_of_a_restored_replica_win(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    keeper.flush()
    again, second = kept(crash(net, keeper), tmp_path)
    again.update_node("cube_1", mass=0.7)
    again.remove_node("cube_2")
    again.add_node("cube_2", "ball")
    second.flush()
    third, _ = kept(crash(net, second), tmp_path)
    assert third.node("cube_1")["mass"] == 0.7 and third.node("cube_2").type == "ball"
    assert third.edges("on") == []


def test_restoring_while_others_live_brings_nothing_back_that_they_deleted(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    survivor = net.join("survivor")
    fill(memory)
    net.pump(2.0)
    keeper.flush()
    keeper.abandon()
    memory.close()
    net.memories.remove(memory)
    survivor.remove_node("cube_2")
    survivor.update_node("cube_1", mass=0.9)
    survivor.add_node("ball_1", "ball")
    net.pump(2.0)
    again = net.join("keeper")
    net.pump(2.0)
    StateKeeper(again, tmp_path, threaded=False)
    net.pump(3.0)
    assert state(again) == state(survivor)
    assert "cube_2" not in again and again.node("cube_1")["mass"] == 0.9 and "ball_1" in again


def test_a_survivor_learns_what_only_the_folder_knows(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    memory.add_node("ball_1", "ball")
    memory.remove_node("ball_1")
    keeper.flush()
    after = crash(net, keeper)
    survivor = after.join("survivor")
    after.pump(1.0)
    again = after.join("keeper")
    after.pump(1.0)
    StateKeeper(again, tmp_path, threaded=False)
    after.pump(3.0)
    assert state(survivor) == state(memory)


def test_closing_leaves_one_snapshot_and_frees_the_folder(net: Net, tmp_path: Path) -> None:
    memory, _ = kept(net, tmp_path)
    fill(memory)
    memory.close()
    assert not (tmp_path / "lock").exists()
    assert files(tmp_path) == ["journal-000001", "journal-000002", "snapshot-000001", "snapshot-000002"]
    assert (tmp_path / "journal-000002").stat().st_size <= len(HEADER)
    again, keeper = kept(net, tmp_path)
    assert keeper.restored and state(again) == state(memory)


def test_nothing_is_written_when_nothing_changes(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    keeper.flush()
    before = [(path, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(tmp_path.iterdir())]
    for _ in range(5):
        keeper.flush()
    assert [(path, path.stat().st_mtime_ns, path.stat().st_size) for path in sorted(tmp_path.iterdir())] == before


def test_the_journal_is_compacted_when_it_outgrows_the_snapshot(
    net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper_module, "LEAST_JOURNAL", 20_000)
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    for number in range(3000):
        memory.update_node("cube_1", mass=float(number))
        if number % 10 == 0:
            keeper.flush()
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 60_000
    assert len(files(tmp_path)) == 4
    keeper.flush()
    again, _ = kept(crash(net, keeper), tmp_path)
    assert state(again) == state(memory)


def test_only_the_winning_write_of_a_moment_is_written(net: Net, tmp_path: Path) -> None:
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    keeper.flush()
    journal = tmp_path / "journal-000001"
    before = journal.stat().st_size
    for number in range(1000):
        memory.update_node("cube_1", mass=float(number))
    keeper.flush()
    assert journal.stat().st_size - before < 200


@pytest.fixture(scope="module")
def journal(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, list[tuple[int, Any]]]]:
    """A folder, and the state at each length of its journal at which a flush ended."""
    folder = tmp_path_factory.mktemp("state")
    net = Net()
    memory, keeper = kept(net, folder)
    steps: list[tuple[int, Any]] = [(0, state(memory))]
    for number in range(6):
        memory.add_node(f"cube_{number}", "cube", mass=0.5)
        memory.update_node("cube_0", mass=float(number))
        if number > 2:
            memory.remove_node(f"cube_{number - 2}")
        keeper.flush()
        steps.append(((folder / "journal-000001").stat().st_size, state(memory)))
    keeper.abandon()
    yield folder, steps


def test_a_journal_torn_at_any_byte_gives_the_state_of_the_last_whole_flush(
    journal: tuple[Path, list[tuple[int, Any]]],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "fsync", lambda descriptor: None)  # it takes most of the time
    folder, steps = journal
    data = (folder / "journal-000001").read_bytes()
    for length in range(len(data) + 1):
        shutil.copytree(folder, tmp_path / "torn")
        (tmp_path / "torn" / "journal-000001").write_bytes(data[:length])
        caplog.clear()
        memory, keeper = kept(Net(), tmp_path / "torn")
        reached = max((size, index) for index, (size, _) in enumerate(steps) if size <= length)
        assert state(memory) == steps[reached[1]][1]
        whole = length <= len(HEADER) or length in dict(steps)
        assert ("are damaged, as a crash leaves it" in caplog.text) == (not whole)
        keeper.abandon()
        shutil.rmtree(tmp_path / "torn")


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_damaged_snapshot_falls_back_to_the_one_before_and_loses_nothing(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    net = Net()
    memory, keeper = kept(net, folder)
    fill(memory)
    memory.remove_node("cube_2")
    memory.close()
    memory, keeper = kept(Net(), folder)
    memory.add_node("ball_1", "ball")
    keeper.flush()
    keeper.abandon()
    newest = folder / files(folder)[-1]
    content = bytearray(newest.read_bytes())
    position = data.draw(st.integers(0, len(content) - 1))
    content[position] ^= data.draw(st.integers(1, 255))
    newest.write_bytes(content if data.draw(st.booleans()) else content[:position])
    again, second = kept(Net(), folder)
    assert state(again) == state(memory)
    second.abandon()


def test_a_damaged_snapshot_is_told(net: Net, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    memory, _ = kept(net, tmp_path)
    fill(memory)
    memory.close()
    (tmp_path / "snapshot-000002").write_bytes(b"garbage")
    kept(net, tmp_path, "again")
    assert (
        "snapshot-000002 is damaged (it is no state file of this version): restoring from the one before" in caplog.text
    )


def test_a_folder_in_which_no_snapshot_can_be_read_is_refused_and_left_alone(net: Net, tmp_path: Path) -> None:
    memory, _ = kept(net, tmp_path)
    fill(memory)
    memory.close()
    for file in tmp_path.glob("snapshot-*"):
        file.write_bytes(b"garbage")
    before = files(tmp_path)
    with pytest.raises(ConfigError, match=r"no snapshot in .* can be read; move the folder away"):
        kept(net, tmp_path, "again")
    assert files(tmp_path) == before and not (tmp_path / "lock").exists()


def test_two_keepers_do_not_share_a_folder(net: Net, tmp_path: Path) -> None:
    first, _ = kept(net, tmp_path)
    with pytest.raises(ConfigError, match="is in use by another process"):
        kept(net, tmp_path, "second")
    first.close()
    kept(net, tmp_path, "third")


def test_a_folder_that_cannot_be_used_is_told(net: Net, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"state folder .*file/state cannot be used: Not a directory"):
        kept(net, tmp_path / "file" / "state")


def test_a_disk_that_is_full_at_the_start_is_told(net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with full_disk(monkeypatch), pytest.raises(ConfigError, match="cannot be used: No space left on device"):
        kept(net, tmp_path)
    assert not (tmp_path / "lock").exists()
    assert not kept(net, tmp_path, "later")[1].restored


@contextlib.contextmanager
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing reaches the disk."""

    def refuse(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", refuse)
        yield


def test_a_disk_that_is_full_for_a_while_is_told_once_and_nothing_is_lost_later(
    net: Net, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    memory, keeper = kept(net, tmp_path)
    fill(memory)
    keeper.flush()
    with full_disk(monkeypatch):
        for number in range(50):
            memory.add_node(f"ball_{number}", "ball")
            keeper.flush()
            net.pump(0.5)
    assert len([record for record in caplog.records if record.levelno == logging.ERROR]) == 1
    assert "the state cannot be kept in" in caplog.text and "No space left on device" in caplog.text
    assert len(files(tmp_path)) < 8
    net.pump(2.0)
    keeper.flush()
    assert "the state is kept again" in caplog.text
    again, _ = kept(crash(net, keeper), tmp_path)
    assert state(again) == state(memory)


def test_a_folder_that_was_removed_is_told_and_the_memory_goes_on(
    net: Net, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    memory, keeper = kept(net, tmp_path / "state")
    shutil.rmtree(tmp_path / "state")
    fill(memory)
    keeper.flush()
    assert "the folder was removed" in caplog.text
    assert "cube_1" in memory
    memory.close()


def test_every_kind_of_change_is_recorded(net: Net, tmp_path: Path) -> None:
    """One after the other: a way past the recorder would be lost."""
    memory, keeper = kept(net, tmp_path)
    peer = net.join("peer")
    net.pump(1.0)

    def check() -> None:
        net.pump(1.2)
        keeper.flush()
        shutil.copytree(tmp_path, tmp_path.with_suffix(".copy"), ignore=shutil.ignore_patterns("lock"))
        again, second = kept(Net(), tmp_path.with_suffix(".copy"))
        assert state(again) == state(memory)
        assert again.replica.graph.store.context == memory.replica.graph.store.context
        second.abandon()
        shutil.rmtree(tmp_path.with_suffix(".copy"))

    for writer in (memory, peer):
        writer.add_node("world", "world")
        writer.add_node("cube_1", "cube", mass=1.0)
        check()
        writer.update_node("cube_1", mass=2.0)
        check()
        writer.add_edge("world", "cube_1", "RT", pose=Pose())
        check()
        writer.update_edge("world", "cube_1", "RT", pose=Pose((1.0, 0.0, 0.0)))
        check()
        writer.remove_attribute("cube_1", "mass")
        check()
        writer.remove_edge("world", "cube_1", "RT")
        check()
        writer.remove_node("cube_1")
        check()


def test_an_addition_that_came_late_brings_back_nothing_that_was_told_to_be_gone() -> None:
    store, pending = Store(), PendingWrites()
    store.recorder = pending.add
    store.join(Delta(context=[("a", 1, 2)], live=frozenset(), examined=[]))  # the end of a reply: all of `a` is gone
    store.join(Delta(adds=[Add(("a", 1), "thing", "cube")], context=[("a", 1, 2)]))  # was under way for long
    assert not store.entries
    restored = Store()
    for delta in pending.take():
        restored.join(delta)
    assert not restored.entries and restored.context == store.context
