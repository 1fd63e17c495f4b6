"""Every attack of `benchmarks.attacks`, in memory; one of them over Zenoh; and that an attack that succeeds is told."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from benchmarks.attacks import __main__ as command
from benchmarks.attacks.arenas import LocalArena, zenoh_arena
from benchmarks.attacks.attack import Attack, Outcome
from benchmarks.attacks.registry import attacks
from dsr.crdt.delta import Delta
from dsr.crdt.hlc import HybridClock
from dsr.graph.graph import Graph
from dsr.replication import clock_votes
from dsr.replication.clock_votes import ClockVerdict

CASES = [(attack, graph) for attack in attacks().values() for graph in attack.settings]


@pytest.mark.parametrize(("attack", "graph"), CASES, ids=[f"{attack.name}-{graph}" for attack, graph in CASES])
def test_what_must_hold_does(attack: Attack, graph: str) -> None:
    outcome = attack.run(LocalArena(attack.grants if graph == "secured" else None))
    assert outcome.held, f"{attack.holds}: {outcome.effect}"


@pytest.mark.parametrize("graph", ["open", "secured"])
def test_the_same_attack_runs_over_zenoh(graph: str) -> None:
    attack = attacks()["uninvited-reply"]
    with zenoh_arena(attack.grants if graph == "secured" else None) as arena:
        outcome = attack.run(arena)
    assert outcome.held, outcome.effect


def _follow_to_a_horizon(self: HybridClock, stamp: int, now: float) -> None:
    self.latest = max(self.latest, min(stamp, 1 << 62))


OLD_DESIGNS: list[tuple[str, Any, str, Any]] = [
    ("stamp-elsewhere", HybridClock, "observe", _follow_to_a_horizon),
    ("stamp-greatest", Graph, "_stamp", lambda self, key, owners, attribute, tick: tick),
    ("stamp-cleaned", Graph, "renew", lambda self, key, now: Delta()),
    ("clock-votes", clock_votes, "agent_of", lambda rid: rid),
    ("clock-of-two", ClockVerdict, "_most", lambda self, agents: 2 * len(agents) > self.agents),
]


@pytest.mark.parametrize(("name", "owner", "part", "old"), OLD_DESIGNS, ids=[name for name, *_ in OLD_DESIGNS])
def test_designs_that_did_not_hold_are_found(name: str, owner: Any, part: str, old: Any) -> None:
    with mock.patch.object(owner, part, old):
        assert not attacks()[name].run(LocalArena()).held


def test_an_attack_that_succeeds_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = Attack("bad", "does harm", "no harm is done", lambda arena: Outcome(False, "harm", {"harms": 1.0}))
    monkeypatch.setattr(command, "attacks", lambda: {"bad": broken})
    monkeypatch.setattr(sys, "argv", ["attacks", "--json", str(tmp_path / "rows.json")])
    with pytest.raises(SystemExit) as end:
        command.main()
    (row,) = json.loads((tmp_path / "rows.json").read_text())["rows"]
    assert end.value.code == 1 and "BROKEN" in capsys.readouterr().out
    assert row["outcome"] == {"held": False, "effect": "harm", "figures": {"harms": 1.0}}
    assert row["holds"] == "no harm is done" and row["graph"] == "open"


def test_a_name_that_is_no_attack_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["attacks", "nonsense"])
    with pytest.raises(SystemExit, match="uninvited-reply"):
        command.main()
