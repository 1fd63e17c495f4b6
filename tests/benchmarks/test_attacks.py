"""Every attack of `benchmarks.attacks`, in memory; one of them over Zenoh; and that an attack that succeeds is told."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from benchmarks.attacks import __main__ as command
from benchmarks.attacks.arenas import LocalArena, zenoh_arena
from benchmarks.attacks.attack import Attack, Outcome
from benchmarks.attacks.registry import attacks

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
