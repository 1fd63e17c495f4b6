"""Years of the whole memory, shortened to days; and that what is found can be seen again, and shortened."""

from __future__ import annotations

import errno
import json
import os
import sys
from pathlib import Path
from unittest import mock

import pytest

from benchmarks.years import __main__ as command
from benchmarks.years.beginning import begun
from benchmarks.years.differences import Differences
from benchmarks.years.disk import FailingDisk, failing_disks
from benchmarks.years.meshes import MOST_TRIANGLES, PIECE
from benchmarks.years.mutants import MUTANTS
from benchmarks.years.running import Setting, quiet, run, shortest
from benchmarks.years.shrinking import shrunk
from benchmarks.years.steps import Step, day
from benchmarks.years.world import World
from dsr.crdt.delta import Delta
from dsr.files import private_files
from dsr.files.private_files import new_file, replacing
from dsr.persistence.generations import Generations
from dsr.replication.lacking import Lacking


@pytest.mark.parametrize("seed", range(4))
def test_days_of_the_whole_memory(seed: int) -> None:
    outcome = run(Setting(seed, days=3))
    assert not outcome.problem
    assert outcome.slept > 1.5 * 86400.0 and outcome.lived > 36.0
    assert sum(outcome.met.values()) > 200 and outcome.met["kill"] > 3


EMPTY_FORK = [
    Step("make", 17, 39023), Step("heal"), Step("sleep", amount=67592.0), Step("kill", 25, 61094, 2.0),
    Step("suspend", 21), Step("pass"), Step("power", 9), Step("pass", amount=1.1), Step("make", 27, 40329),
    Step("make", 17, 31257), Step("delete", 35, 7957), Step("heal"),
]  # fmt: skip
"""A world is forked before its content has come, the fork is forked, and the first fork is deleted."""


def test_a_failure_of_ten_years_stays_mended() -> None:
    assert not run(Setting(100948), EMPTY_FORK).problem


def test_an_edge_may_go_with_a_node_of_which_one_incarnation_is_left() -> None:
    """Who removed the node died, and others had heard of a part of the removal alone."""
    assert not run(Setting(700135)).problem


def test_a_history_follows_from_its_seed() -> None:
    first, again, other = (run(Setting(seed, days=1)) for seed in (7, 7, 8))
    assert first == again and first != other


def test_a_difference_needs_a_removal_whose_dot_is_missing() -> None:
    for removed in (True, False):
        world = World([0.0, 0.0, 0.0])
        world.add_node(0, "a", "cube", 1)
        for _ in range(20):
            world.advance(0.1)
        differences = Differences(world)
        with differences.watched(), quiet():
            world.partition(0b011)
            dot = world.memory(2)._graph.node("a").created[0]
            if removed:
                world.remove_node(2, "a")  # and nobody hears of it but the second one, in part
            world.memory(1)._graph.join(Delta(removed=[dot]), world.clock.now())
            for _ in range(20):
                world.advance(0.1)
        assert bool(differences.explained) == removed and bool(differences.unexplained) != removed
        assert "a" not in world.memory(0), "they did not ask each other"


def test_a_wrong_design_makes_differences_without_a_reason() -> None:
    mutant = next(each for each in MUTANTS if each.title.startswith("additions of deltas are left out"))
    with mock.patch.object(mutant.target, mutant.name, mutant.wrong(getattr(mutant.target, mutant.name))):
        assert "have seen the same, and only one holds" in run(Setting(10, days=1, steps=150)).problem


def test_meshes_come_in_pieces_and_wrong_ones_are_not_taken() -> None:
    received = mismatched = 0
    for seed in (0, 2, 4):
        with quiet(), begun(3, seed) as history:
            history.take(Step("add", 0, 1))
            history.take(Step("mesh", 0, MOST_TRIANGLES - 1))
            history.take(Step("heal"))
            (hash,) = history.meshes.made
            for participant in history.participants:
                assert participant.memory.meshes.store.get(hash) == history.meshes.made[hash]
                received += participant.memory.meshes.statistics.received
                mismatched += participant.memory.meshes.statistics.mismatched
    assert received >= 6 * 4 * PIECE and mismatched


def test_a_failure_is_made_shorter() -> None:
    setting = Setting(5, days=1, steps=100)
    with mock.patch.object(Lacking, "_is_behind", lambda *arguments: False):
        problem = run(setting).problem
        assert problem
        steps = shortest(setting, setting.history(), problem)
        assert 1 < len(steps) < 20 and run(setting, steps).problem == problem
    assert not run(setting, steps).problem


def test_shrinking_leaves_what_matters() -> None:
    steps = day(1, 0, 50)
    needed = {steps[3], steps[17], steps[44]}
    assert set(shrunk(steps, lambda fewer: needed <= set(fewer))) == needed
    assert len(shrunk(steps, lambda fewer: needed <= set(fewer), runs=3)) > len(needed)


def test_a_power_cut_leaves_what_was_flushed_and_a_part_of_the_rest(tmp_path: Path) -> None:
    lengths = set()
    for seed in range(20):
        disk = FailingDisk(tmp_path / str(seed), seed)
        with failing_disks([disk]):
            file = new_file(disk.root / "journal")
            private_files.sync_folder(disk.root)
            file.write(b"a" * 100)
            file.flush()
            os.fsync(file.fileno())
            file.write(b"b" * 100)
            file.flush()
            file.write(b"c" * 100)  # never handed to the disk
        disk.let_go()
        disk.lose_power()
        left = (disk.root / "journal").read_bytes()
        assert left.startswith(b"a" * 100) and len(left) <= 200
        lengths.add(len(left))
    assert len(lengths) > 5


def test_names_that_were_not_flushed_may_be_lost_and_removed_ones_may_be_back(tmp_path: Path) -> None:
    found = set()
    for seed in range(30):
        disk = FailingDisk(tmp_path / str(seed), seed)
        with failing_disks([disk]):
            with replacing(disk.root / "kept") as file:
                file.write(b"1")
            new_file(disk.root / "new").close()
            (disk.root / "kept").unlink()
        disk.let_go()
        disk.lose_power()
        found.add(tuple(sorted(path.name for path in disk.root.iterdir())))
    assert found == {("kept",), ("kept", "new"), ("new",)}


def test_a_full_disk_takes_a_part_and_says_so(tmp_path: Path) -> None:
    disk = FailingDisk(tmp_path / "disk", 0)
    with failing_disks([disk]):
        journal = Generations(disk.root).begin()
        disk.full = True
        journal.write(b"x" * 1000)
        with pytest.raises(OSError) as error:
            journal.flush()
        assert error.value.errno == errno.ENOSPC and disk.met["no room"] == 1
        with pytest.raises(OSError):
            new_file(disk.root / "other")


def test_the_counts_are_written_as_json(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "years.json"
    monkeypatch.setattr(sys, "argv", ["years", "--seed", "2", "--days", "1", "--json", str(file)])
    with pytest.raises(SystemExit) as end:
        command.main()
    counts = json.loads(file.read_text(encoding="utf-8"))
    assert end.value.code == 0 and counts["histories"] == 1 and counts["problems"] == {}
    assert counts["met"] and all(number > 0 for number in counts["met"].values())
