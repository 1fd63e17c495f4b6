"""`dsr doctor`."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from dsr.cli import doctor
from dsr.cli.doctor import app
from dsr.config.extras import EXTRAS


def without(*modules: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make modules look as if they were not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name in modules else find(name, *a))


def test_zenoh_sessions_meet_and_leave_nothing_behind(private_runtime_dir: Path) -> None:
    assert doctor.check_zenoh().state == "ok"
    assert list((private_runtime_dir / "dsr").iterdir()) == []


def test_here_all_that_is_needed_is_there() -> None:
    checks = [doctor.check_python(), doctor.check_packages(), doctor.check_runtime_folder()]
    assert [check.state for check in checks] == ["ok"] * 3


def test_a_missing_package_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    without("mcap", "scipy", monkeypatch=monkeypatch)
    check = doctor.check_packages()
    assert check.state == "missing"
    assert check.detail == "not installed: mcap, scipy; run: pip install 'dsr-memory[cli,sim]'"


def test_an_extra_that_nobody_asked_for_is_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """With `dsr-memory[cli]` alone, all that was asked for is there."""
    without(*(module for module, extra in EXTRAS.items() if extra in ("sim", "view")), monkeypatch=monkeypatch)
    checks = [doctor.check_packages(), doctor.check_pybullet(), doctor.check_viewer()]
    assert [check.state for check in checks] == ["limited"] * 3
    assert "for agents and simulated worlds, the live view: pip install 'dsr-memory[sim,view]'" in checks[0].detail
    assert "dsr-memory[sim]" in checks[1].detail and "dsr-memory[view]" in checks[2].detail


@pytest.mark.parametrize(("compiler", "expected"), [("/usr/bin/c++", "ten minutes"), (None, "apt install g++")])
def test_without_pybullet_the_compiler_matters(
    monkeypatch: pytest.MonkeyPatch, compiler: str | None, expected: str
) -> None:
    without("pybullet", monkeypatch=monkeypatch)
    monkeypatch.setattr(shutil, "which", lambda name: compiler)
    check = doctor.check_pybullet()
    assert check.state == "missing" and expected in check.detail


def test_without_egl_or_a_display_things_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: SimpleNamespace(returncode=3))
    monkeypatch.setattr(os, "environ", {})
    assert doctor.check_opengl().state == "limited"
    assert doctor.check_display().state == "limited"


def test_the_library_of_realsense_cameras_is_optional(monkeypatch: pytest.MonkeyPatch) -> None:
    without("pyrealsense2", monkeypatch=monkeypatch)
    check = doctor.check_realsense()
    assert check.state == "limited" and check.detail.endswith("pip install 'dsr-memory[realsense]'")


def test_a_library_that_cannot_be_loaded_is_told_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    said = "Traceback\nImportError: libusb-1.0.so.0: cannot open shared object file"
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: SimpleNamespace(returncode=1, stderr=said))
    check = doctor.check_realsense()
    assert check.state == "limited"
    assert check.detail == f"{said.splitlines()[1]}; Debian, Ubuntu: apt install libusb-1.0-0"


def test_a_runtime_folder_that_cannot_be_written_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "runtime_dir", lambda: tmp_path / "none")
    results = {check.name: check for check in only(doctor.check_runtime_folder, monkeypatch)}
    assert results["runtime folder"].state == "missing"


def only(check: Any, monkeypatch: pytest.MonkeyPatch) -> list[doctor.Check]:
    """Run all checks, the others replaced by one that succeeds."""
    for name in [name for name in vars(doctor) if name.startswith("check_") and name != check.__name__]:
        monkeypatch.setattr(doctor, name, lambda: doctor.Check("other", "ok", ""))
    return list(doctor.run_checks())


@pytest.mark.parametrize(("state", "code"), [("ok", 0), ("limited", 0), ("missing", 1)])
def test_the_exit_code_tells_whether_something_is_missing(
    monkeypatch: pytest.MonkeyPatch, state: Any, code: int
) -> None:
    monkeypatch.setattr(doctor, "run_checks", lambda: [doctor.Check("x", state, "detail")])
    assert CliRunner().invoke(app).exit_code == code
    assert '"detail"' in CliRunner().invoke(app, ["--json"]).output


def test_the_solver_tells_its_version() -> None:
    assert doctor.check_solver().state == "ok"


def test_a_missing_solver_is_a_limit_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    code = "import planner.solver as s; s.PACKAGE = 'no_such_package'; print(s.probe())"
    monkeypatch.setattr(doctor, "_SOLVER_PROBE", code)
    check = doctor.check_solver()
    assert check.state == "limited"
    assert check.detail.startswith("the solver Fast Downward is not installed; run: pip install 'dsr-memory[planning]'")


def test_doctor_says_which_ros_is_spoken(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor.check_ros().state == "ok" and "rmw_zenoh and DDS" in doctor.check_ros().detail
    missing = {"cyclonedds"}
    real = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in missing else real(name))
    assert doctor.check_ros().state == "ok" and "dsr-memory[ros-dds]" in doctor.check_ros().detail
    missing.add("rosbags")
    assert doctor.check_ros().state == "limited" and "dsr-memory[ros]" in doctor.check_ros().detail
