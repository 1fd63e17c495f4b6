"""Sweeps: seeds, workers that crash or hang, statistics, the command."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from agents.scenario import sweep_cli
from agents.scenario.cli import app
from agents.scenario.options import parse_seeds
from agents.scenario.run.runner import run_lockstep
from agents.scenario.run.staging import make_run
from agents.scenario.run.statistics import summarise
from agents.scenario.run.sweep import RunOutcome, Sweep
from agents.scenario.run.sweep_report import show_sweep
from agents.scenario.sweep_cli import make_jobs, write_curves
from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError

SCENARIO = """
name = "tiny"
title = "One cube"
duration = 3.0
settle = 1.5

[random]
position = 0.01

[[object]]
name = "cube_1"
marker_id = 1
position = [0.35, 0.0, 0.02]

[[expect]]
check = "perceived"
"""


@pytest.fixture
def tiny(tmp_path: Path) -> str:
    file = tmp_path / "tiny.toml"
    file.write_text(SCENARIO)
    return str(file)


@pytest.mark.parametrize(
    ("text", "seeds"), [("7", [7]), ("0-3", [0, 1, 2, 3]), ("2,0-2, 9 ", [2, 0, 1, 9]), ("5-5", [5])]
)
def test_seeds_are_numbers_and_ranges(text: str, seeds: list[int]):
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "3-", "-3", "5-2", "1,,2", "0-999999999"])
def test_wrong_seeds_are_refused(text: str):
    with pytest.raises(ConfigError, match="--seeds"):
        parse_seeds(text)


def test_a_sweep_gives_the_results_of_single_runs(tiny: str):
    jobs = make_jobs([tiny], [3, 4], "poses", [None])
    with Sweep(jobs, workers=1) as running:
        outcomes = list(running.outcomes())
    assert [(outcome.seed, outcome.passed, outcome.crash) for outcome in outcomes] == [(3, True, ""), (4, True, "")]
    alone = run_lockstep(make_run(tiny, seed=4, sensor="poses"))
    assert outcomes[1].metrics == alone.metrics != outcomes[0].metrics


def test_a_run_that_dies_is_counted_and_the_others_go_on(tiny: str, tmp_path: Path):
    endless = tmp_path / "endless.toml"
    endless.write_text(SCENARIO.replace("tiny", "endless").replace("duration = 3.0", "duration = 3000.0"))
    with Sweep(make_jobs([str(endless), tiny], [0], "poses", [None]), workers=1) as running:

        def kill() -> None:
            for _ in range(1000):
                for worker in running._workers:
                    if worker.job is not None and worker._process is not None and worker._process.pid is not None:
                        return os.kill(worker._process.pid, signal.SIGKILL)
                WALL_CLOCK.wait(threading.Event(), 0.01)
            return None

        killer = threading.Thread(target=kill)
        killer.start()
        first, second = running.outcomes()
        killer.join()
    assert not first.passed and first.crash.startswith("the process ended with signal 9")
    assert (second.scenario, second.passed) == ("tiny", True)


def test_a_run_that_hangs_is_given_up(tiny: str):
    with Sweep(make_jobs([tiny], [0], "poses", [None]), workers=1, limit=0.01) as running:
        (outcome,) = running.outcomes()
    assert not outcome.passed and outcome.crash == "took more than 0 s of real time"


def test_what_is_wrong_with_a_run_is_its_failure(tiny: str):
    jobs = make_jobs([tiny], [0], "poses", [None])
    Path(tiny).write_text(SCENARIO.replace("perceived", "perceive"))
    with Sweep(jobs, workers=1) as running:
        (outcome,) = running.outcomes()
    assert not outcome.passed and outcome.crash.startswith("ConfigError") and "perceive" in outcome.crash


def outcome_of(seed: int, policy: str | None = None, **fields: object) -> RunOutcome:
    values = {"scenario": "tiny", "sensor": "poses", "passed": True, "failed": [], "found": [], "wall_s": 2.0}
    return RunOutcome(seed=seed, policy=policy, **{**values, **fields})  # type: ignore[arg-type]


def test_statistics_of_runs():
    runs = [outcome_of(seed, metrics={"recovery_time_max_s": float(seed)}) for seed in range(20)]
    runs.append(outcome_of(20, passed=False, failed=["edges", "mission"], found=["none", "failed"]))
    runs.append(outcome_of(21, passed=False, crash="signal 11"))
    (summary,) = summarise(runs)
    spread = summary.metrics["recovery_time_max_s"]
    assert (summary.runs, summary.passed) == (22, 20)
    assert (spread.count, spread.median, spread.p95, spread.worst) == (20, 9.5, pytest.approx(18.05), 19.0)
    assert summary.failures == {"edges": [20], "mission": [20], "signal 11": [21]}


def test_curves_of_runs(tmp_path: Path):
    name = "unseen_error_cube_m"
    runs = [outcome_of(seed, curves={name: [(3.0, 0.01 * seed), (4.0, 0.02)][: 1 + seed % 2]}) for seed in range(3)]
    (summary,) = summarise(runs)
    assert [(time, spread.count) for time, spread in summary.curves[name]] == [(3.0, 3), (4.0, 1)]
    assert summary.curves[name][0][1].median == pytest.approx(0.01)
    write_curves([summary], tmp_path / "curves.csv")
    assert (tmp_path / "curves.csv").read_text().splitlines() == [
        "scenario,policy,curve,time_s,count,median,p95,worst",
        f"tiny,,{name},3,3,0.01,0.019,0.02",
        f"tiny,,{name},4,1,0.02,0.02,0.02",
    ]


def test_policies_stand_side_by_side():
    runs = [
        outcome_of(0, "hypotheses", metrics={"recovery_time_max_s": 0.5, "wrong_beliefs": 0}),
        outcome_of(0, "algorithm1", metrics={"wrong_beliefs": 3}, passed=False, failed=["edges"], found=["none"]),
    ]
    console = Console(record=True, width=160, file=io.StringIO())
    show_sweep(summarise(runs), console, metrics=True)
    shown = console.export_text()
    assert re.search(r"tiny +│ hypotheses +│ +1/1 +│ 0.50 / 0.50 s", shown)
    assert re.search(r"tiny +│ algorithm1 +│ +0/1 +│ +- ", shown)
    assert re.search(r"wrong_beliefs +│ +0 / 0 / 0 +│ +3 / 3 / 3", shown)
    assert "tiny, algorithm1: edges: 1 of 1, seeds 0" in shown and "1 of 2 runs passed" in shown


def test_the_command_writes_all_runs_and_tells_whether_all_passed(tiny: str, tmp_path: Path):
    Path(tiny).write_text(SCENARIO + "value = false\n")
    file = tmp_path / "sweep.json"
    result = CliRunner().invoke(app, ["sweep", tiny, "--seeds", "5", "--jobs", "1", "--json-file", str(file)])
    assert result.exit_code == 1 and "tiny: perceived (value false): 1 of 1, seeds 5" in result.output
    report = json.loads(file.read_text())
    assert report["complete"] and report["runs"][0]["found"] == ["cube_1: true"]
    assert report["summaries"][0]["metrics"]["samples"]["count"] == 1


def test_policy_both_runs_each_seed_twice():
    policies = sweep_cli._policies([sweep_cli.SweptPolicy.BOTH])
    jobs = make_jobs(["hovering_1"], [1, 2], "poses", policies)
    assert [(job.seed, job.policy) for job in jobs] == [
        (seed, policy) for seed in (1, 2) for policy in ("hypotheses", "algorithm1")
    ]


def test_ctrl_c_shows_what_was_done_and_leaves_nothing_behind(tiny: str, tmp_path: Path):
    file = tmp_path / "sweep.json"
    arguments = ["sweep", tiny, "--seeds", "0-99", "--jobs", "1", "--json-file", str(file)]
    code = f"from agents.scenario.cli import app; app({arguments!r})"
    marked = {**os.environ, "DSR_TEST_SWEEP": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=marked, start_new_session=True
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()  # ten runs are done
        os.killpg(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=30)
    assert process.returncode == 130
    assert re.search(r"stopped after \d+ of 100 runs", output) and "runs passed" in output
    assert not json.loads(file.read_text())["complete"]
    assert _processes_with(f"DSR_TEST_SWEEP={tmp_path}") == []


def _processes_with(variable: str) -> list[str]:
    """Processes whose environment has the variable."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            environment = (folder / "environ").read_bytes()
            command = (folder / "cmdline").read_bytes()
        except OSError:
            continue
        if variable.encode() in environment.split(b"\0"):
            found.append(command.replace(b"\0", b" ").decode(errors="replace"))
    return found
