"""The commands `dsr scenario` and `dsr demo`, without running a system."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from agents.scenario import cli
from agents.scenario.format.scenario import scenario_files
from agents.scenario.judge.result import Result, Verdict
from agents.scenario.run.staging import Run
from dsr.errors import ConfigError

ROOT = Path(__file__).parents[3]


def invoke(*arguments: str) -> tuple[int, str]:
    outcome = CliRunner().invoke(cli.app, arguments)
    assert outcome.exception is None or isinstance(outcome.exception, SystemExit), outcome.exception
    return outcome.exit_code, outcome.output


class Recorded:
    """Stands in for the two ways to run."""

    def __init__(self, passed: bool = True) -> None:
        self.runs: list[tuple[str, Run]] = []
        self.passed = passed
        self.error: BaseException | None = None

    def way(self, mode: Any) -> Any:
        def play(run: Run, observer: Any) -> Result:
            self.runs.append((mode, run))
            observer.running(1.0)
            if self.error:
                raise self.error
            return Result(
                scenario=run.scenario.name,
                seed=run.seed,
                mode=mode,
                sensor=run.sensor,
                passed=self.passed,
                expectations=[Verdict("resting (tolerance 1.00 mm)", self.passed, "cube_3: gap 0.10 mm")],
                metrics={"belief_gap_cube_3_m": 0.0001, "percept_error_cube_3_m": 0.0123},
                notes=["cube_4 was never seen: it has no percept metrics"],
            )

        return play


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Recorded:
    stand_in = Recorded()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "run_live", stand_in.way("live"))
    monkeypatch.setattr(cli, "run_lockstep", stand_in.way("lockstep"))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    return stand_in


def test_list_shows_every_built_in_scenario():
    code, output = invoke("list", "--json")
    assert code == 0
    assert [row["name"] for row in json.loads(output)] == sorted(scenario_files())
    assert "hovering_20" in invoke("list")[1]


def test_check_accepts_what_is_there_and_names_what_is_wrong(tmp_path: Path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("name = 'x'\ntitle = 'x'\nduration = 'long'\n")
    code, output = invoke("check", "hovering", str(wrong), str(ROOT / "etc/scenarios/hovering_1.toml"))
    assert code == 1
    assert f"{wrong}:3: duration: expected `float` (s), got 'long'" in output
    assert "hovering: 4 objects, 0 events, " in output
    assert invoke("check", "hovering")[0] == 0


def test_run_passes_the_options_on_and_leaves_the_result(recorded: Recorded, tmp_path: Path):
    arguments = ("run", "hovering", "--lockstep", "--seed", "7", "--sensor", "poses", "--json-file", "out.json")
    code, output = invoke(*arguments)
    ((mode, run),) = recorded.runs
    assert code == 0
    assert (mode, run.seed, run.sensor, run.window) == ("lockstep", 7, "poses", False)
    assert run.folder is not None and run.folder.parent == Path("runs")
    assert json.loads((tmp_path / "out.json").read_text()) == json.loads((run.folder / "result.json").read_text())
    for shown in ("12.30", "0.10", "cube_4 was never seen", "1 of 1 expectations", "result.json"):
        assert shown in output


def test_a_file_that_cannot_hold_the_result_is_refused_before_the_run(recorded: Recorded, tmp_path: Path):
    (tmp_path / "file").touch()
    outcome = CliRunner().invoke(cli.app, ["run", "hovering", "--json-file", "file/out.json"])
    assert isinstance(outcome.exception, ConfigError)
    assert "--json-file file/out.json: cannot be written" in str(outcome.exception)
    assert not recorded.runs


def test_the_exit_code_says_whether_the_expectations_hold(recorded: Recorded):
    recorded.passed = False
    code, output = invoke("run", "hovering")
    assert code == 1
    assert recorded.runs[0][0] == "live"
    assert "0 of 1 expectations" in output


@pytest.mark.parametrize(("arguments", "window"), [((), True), (("--no-viewer",), False)])
def test_a_window_needs_a_display(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], window: bool
):
    invoke("run", "hovering", *arguments)
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    invoke("run", "hovering", *arguments)
    assert [run.window for _, run in recorded.runs] == [False, window]


@pytest.mark.parametrize(("arguments", "viewer"), [((), False), (("--view",), True), (("--no-viewer",), False)])
def test_in_lockstep_the_viewer_runs_along_on_request(recorded: Recorded, arguments: tuple[str, ...], viewer: bool):
    invoke("run", "hovering", "--lockstep", *arguments)
    assert [(mode, run.viewer) for mode, run in recorded.runs] == [("lockstep", viewer)]


def test_a_view_that_is_wanted_without_a_display_is_only_recorded_and_that_is_said(
    recorded: Recorded, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert "only recorded" in invoke("run", "hovering", "--view")[1]
    assert "only recorded" not in invoke("run", "hovering")[1]
    assert not any(run.window for _, run in recorded.runs)


def test_ctrl_c_is_no_error_message(recorded: Recorded):
    recorded.error = KeyboardInterrupt()
    code, output = invoke("run", "hovering")
    assert code == 130
    assert "stopped" in output and "Traceback" not in output


def test_the_demo_runs_towers_live_from_pixels(recorded: Recorded):
    outcome = CliRunner().invoke(cli.demo, ["--seed", "3"])
    ((mode, run),) = recorded.runs
    assert outcome.exit_code == 0
    assert (mode, run.scenario.name, run.sensor, run.seed) == ("live", "towers", "pixels", 3)


@pytest.mark.parametrize("arguments", [("run", "--sensor", "eyes", "hovering"), ("run", "--seed", "-1", "hovering")])
def test_wrong_options_are_refused(recorded: Recorded, arguments: tuple[str, ...]):
    assert invoke(*arguments)[0] == 2
    assert not recorded.runs


def test_a_broken_file_hides_no_other_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "etc" / "scenarios").mkdir(parents=True)
    (tmp_path / "etc" / "scenarios" / "broken.toml").write_text("name = ")
    monkeypatch.chdir(tmp_path)
    code, output = invoke("list")
    assert code == 0 and "broken: " in output and "broken.toml:1" in output and "hovering_1" in output
