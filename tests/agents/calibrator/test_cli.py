"""`dsr calibrate`: on recordings, and on a running graph."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import dsr
from agents.calibrator.cli import app
from dsr.cli.common import console
from dsr.math3d.transforms import Pose
from dsr.vocabulary.calibration import ADOPTED, CALIBRATION, LOOKING, REFUSED, Report
from tests.agents.calibrator.scenes import CLUSTER, DOWN, Stage, cubes

NOWHERE = (0.0,) * 6 + (1.0,)


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setattr(console, "width", 160)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, list(arguments), catch_exceptions=False)


def record(folder: Path, objects: dict[str, Pose] | None = None) -> str:
    """A second without and two with something to see."""
    stage = Stage(objects=objects, recording=folder)
    with stage.lockstep:
        stage.wait(1.0)
        stage.look(2.0)
    return str(folder)


def test_a_recording_tells_where_the_camera_is(tmp_path: Path) -> None:
    folder = record(tmp_path / "run")
    result = run("--recording", folder, "--json")
    assert result.exit_code == 0
    report = json.loads(result.stdout)
    metres, radians = Pose(report["after"][:3], report["after"][3:]).distance(DOWN)
    assert metres < 0.003 and radians < 0.006 and report["adopted"]
    text = run("--recording", folder, "--camera", "camera", "--method", "closed_form").stdout
    assert "mount = { translation = [0.3" in text and "cube_4" in text and "world -> camera" in text


def test_the_part_of_a_recording_and_weak_geometry(tmp_path: Path) -> None:
    folder = record(tmp_path / "run", cubes(CLUSTER))
    result = run("--recording", folder)
    assert result.exit_code == 1 and "geometry is weak" in result.stdout
    assert run("--recording", folder, "--force").exit_code == 0
    with pytest.raises(dsr.DsrError, match="seen nothing of use"):
        run("--recording", folder, "--until", "0.8")


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--until", "3"], "--from and --until go with --recording only"),
        (["--from", "3"], "--from and --until go with --recording only"),
        (["--recording", "run", "--views", "3"], "--views goes without --recording"),
    ],
)
def test_options_that_would_change_nothing_are_refused(arguments: list[str], why: str) -> None:
    with pytest.raises(dsr.ConfigError, match=why):
        run(*arguments)


@pytest.mark.parametrize(
    ("times", "why"),
    [
        (["--from", "2", "--until", "1"], "--until 1 is not after --from 2"),
        (["--from", "40"], "the recording ends at"),
    ],
)
def test_a_part_that_is_none_is_told(tmp_path: Path, times: list[str], why: str) -> None:
    folder = record(tmp_path / "run")
    with pytest.raises(dsr.DsrError, match=why):
        run("--recording", folder, *times)


def test_a_recording_in_which_the_camera_was_given_another_pose_is_used_only_in_part(tmp_path: Path) -> None:
    stage = Stage(recording=tmp_path / "run")
    with stage.lockstep:
        stage.look(2.0)
        stage.memory.add_edge("world", "camera", "RT", pose=DOWN)
        stage.look(2.0)
    with pytest.raises(dsr.DsrError, match=r"another pose after 2\.\d s.*use --from"):
        run("--recording", str(tmp_path / "run"))
    assert json.loads(run("--recording", str(tmp_path / "run"), "--until", "1.9", "--json").stdout)["shift_m"] > 0.03
    assert json.loads(run("--recording", str(tmp_path / "run"), "--from", "2.2", "--json").stdout)["unchanged"]


def test_nothing_is_written_into_a_recording(tmp_path: Path) -> None:
    folder = record(tmp_path / "run")
    before = {file: file.stat().st_mtime_ns for file in Path(folder).iterdir()}
    run("--recording", folder)
    assert {file: file.stat().st_mtime_ns for file in Path(folder).iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--method", "magic"], "unknown method"),
        (["--recording", "x.mcap"], "cannot be read"),
        ([], "no graph runs"),
        (["--move"], "--views of 2 or more"),
    ],
)
def test_wrong_input_is_told(arguments: list[str], expected: str) -> None:
    with pytest.raises(dsr.DsrError, match=expected):
        run(*arguments)


class Answerer(threading.Thread):
    """Answers the first request in a graph."""

    def __init__(self, memory: dsr.Memory, **answer: str) -> None:
        super().__init__(daemon=True)
        self.memory, self.answer = memory, answer
        self._pause = threading.Event()
        self.asked: dict[str, Any] = {}

    def run(self) -> None:
        while not self.memory.nodes(CALIBRATION):
            self._pause.wait(0.02)
        (node,) = self.memory.nodes(CALIBRATION)
        self.asked = dict(node.attributes)
        self.memory.update_node(node.name, **self.answer)


def test_a_running_system_is_asked() -> None:
    report = Report(
        "camera", "world", "powell", True, "it is elsewhere", NOWHERE, NOWHERE, (), 0.1, 0.2, 9.0, False, 1, 1, 1,
        (),
    )  # fmt: skip
    with dsr.connect("calibrated", agent="somebody") as memory:
        memory.add_node("camera", "camera")
        text = json.dumps({field: getattr(report, field) for field in report.__struct_fields__})
        answerer = Answerer(memory, status=ADOPTED, report=text)
        answerer.start()
        result = run("--method", "powell", "--views", "2", "--camera", "camera", "--json")
        answerer.join(5.0)
        assert result.exit_code == 0 and json.loads(result.stdout)["text"] == "it is elsewhere"
        assert answerer.asked == {
            "target": "camera",
            "method": "powell",
            "forced": False,
            "views": 2,
        }
        (answered,) = memory.nodes(CALIBRATION)
        assert answered["status"] == ADOPTED, "it stays, so that others see the report"
        memory.remove_node(answered.name)
        answerer = Answerer(memory, status=REFUSED, explanation="there is no camera")
        answerer.start()
        with pytest.raises(dsr.DsrError, match="there is no camera"):
            run()
        with pytest.raises(dsr.DsrError, match="did you mean 'camera'"):
            run("--camera", "camra")


def test_without_a_calibrator_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.calibrator.cli._UNANSWERED", 0.3)
    with dsr.connect("calibrated", agent="somebody") as memory:
        memory.add_node("camera", "camera")
        with pytest.raises(dsr.DsrError, match="no agent of class"):
            run()
        assert memory.nodes(CALIBRATION) == []


def test_one_that_ends_while_it_looks_is_not_waited_for_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agents.calibrator.cli._SILENT", 0.5)
    with dsr.connect("calibrated", agent="somebody") as memory:
        memory.add_node("camera", "camera")
        Answerer(memory, status=LOOKING, explanation="0 of 1 views").start()
        with pytest.raises(dsr.DsrError, match="does not seem to run any more"):
            run()


def test_undo_goes_with_nothing_else() -> None:
    for option in (("--force",), ("--views", "2"), ("--recording", "run")):
        with pytest.raises(dsr.ConfigError, match="--undo goes with --camera only"):
            run("--undo", *option)
