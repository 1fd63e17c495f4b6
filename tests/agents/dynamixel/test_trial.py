"""`dsr drivers try` with an arm: reads its joints without moving it, and moves it only if somebody says so."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
from typer.testing import CliRunner

from agents.cameras import cli
from agents.cameras.arm_trial import STEP
from agents.dynamixel.servos import SERIES
from tests.agents.dynamixel.emulator import Emulator, Servo


@pytest.fixture
def line() -> Iterator[Emulator]:
    with Emulator({n: Servo(SERIES["X"], 4096, 0.3 * n) for n in (1, 2)}) as emulator:
        yield emulator


def tried(line: Emulator, *options: str, answer: str = "") -> Any:
    arguments = ["try", "dynamixel", f"port={line.port}", 'joints=["a","b"]', "series=X", "pulses=[4096]"]
    return CliRunner().invoke(cli.app, [*arguments, "--for", "0.5", *options], input=answer)


@pytest.mark.usefixtures("patient")
def test_an_arm_is_read_and_not_moved(line: Emulator) -> None:
    result = tried(line, "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["positions"] == pytest.approx({"a": 0.3, "b": 0.6}, abs=2e-3)
    assert found["samples"] > 5 and found["moved"] == {} and line.writes == 0


@pytest.mark.usefixtures("patient", "unhurried")
def test_it_is_moved_only_after_a_yes(line: Emulator) -> None:
    refused = tried(line, "--move", answer="n\n")
    assert refused.exit_code == 0 and "is there room?" in refused.output and line.writes == 0
    result = tried(line, "--move", answer="y\n")
    assert result.exit_code == 0, result.output
    assert result.output.count("moved, and was 0.00") == 2
    assert line.servos[1].position == pytest.approx(0.3, abs=0.2 * STEP)


def test_a_servo_in_trouble_is_told(line: Emulator) -> None:
    line.servos[2].heat()
    result = tried(line)
    assert result.exit_code == 1 and "servo 2 (b): overheated" in result.output


def test_servos_that_do_not_answer_are_told(line: Emulator) -> None:
    line.servos[1].silent = True
    result = tried(line)
    assert result.exit_code == 1 and "no sample came: no joints of the servos" in result.output


def test_a_camera_is_not_moved(tmp_path: Any) -> None:
    result = CliRunner().invoke(cli.app, ["try", "video", f"file={tmp_path / 'no.mp4'}", "--move", "--no-view"])
    assert result.exit_code != 0 and "no arm" in str(result.exception)
