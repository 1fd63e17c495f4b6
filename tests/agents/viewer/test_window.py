"""The rerun window as a process: private, without analytics, and gone when it should be."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from agents.viewer import window
from agents.viewer.window import ViewerWindow, WindowError
from dsr.runtime.display import has_display


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A stand-in for the viewer that writes down how it was called and ignores requests to end."""
    file = tmp_path / "rerun"
    file.write_text(f"""#!{sys.executable}
import os, signal, socket, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("args", *sys.argv[1:], "CI=" + os.environ["CI"], flush=True)
os.mkdir(os.environ["TMPDIR"] + "/rerun-data")
server = socket.create_server(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1])))
time.sleep(1000)
""")
    file.chmod(0o755)
    monkeypatch.setattr(window, "native_viewer", lambda: file)
    monkeypatch.setattr(window, "_PATIENCE", 0.3)
    monkeypatch.setenv("DISPLAY", ":77")
    return file


def test_it_listens_on_this_machine_only_and_ends_even_if_it_hangs(program: Path, tmp_path: Path) -> None:
    opened = ViewerWindow(tmp_path / "log", "1GB")
    assert opened.exit_code is None
    opened.close()
    opened.close()
    assert opened.exit_code is not None
    assert {file.name for file in tmp_path.iterdir()} == {"rerun", "log"}
    said = (tmp_path / "log").read_text()
    assert "--bind 127.0.0.1" in said and "--memory-limit 1GB" in said and "CI=1" in said
    assert f"--port {opened.url.split(':')[2].split('/')[0]}" in said


def test_a_viewer_that_never_listens_is_an_error_and_does_not_stay(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(window, "_START_PATIENCE", 1.0)
    program.write_text(f"#!{sys.executable}\nimport os, time\nprint(os.getpid(), flush=True)\ntime.sleep(1000)")
    with pytest.raises(WindowError, match="does not start"):
        ViewerWindow(tmp_path / "log", "1GB")
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "log").read_text() or "999999999"), 0)


def test_a_viewer_that_cannot_be_started_is_an_error(program: Path, tmp_path: Path) -> None:
    program.chmod(0o644)
    with pytest.raises(WindowError, match="cannot be started"):
        ViewerWindow(tmp_path / "log", "1GB")


def test_a_viewer_that_is_not_installed_is_an_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(WindowError, match="not installed"):
        ViewerWindow(tmp_path / "log", "1GB")


@pytest.mark.parametrize(
    ("environment", "platform", "expected"),
    [({}, "linux", False), ({"DISPLAY": ":0"}, "linux", True), ({"WAYLAND_DISPLAY": "w"}, "linux", True),
     ({"DISPLAY": ""}, "linux", False), ({}, "darwin", True), ({}, "win32", True)],
)  # fmt: skip
def test_a_display_is_found(environment: dict[str, str], platform: str, expected: bool) -> None:
    assert has_display(environment, platform) is expected


def test_the_real_viewer_neither_collects_nor_leaves_anything(tmp_path: Path) -> None:
    """With analytics on, this prints their configuration and writes it to the home directory."""
    environment = {**window.private_environment(os.environ, tmp_path), "HOME": str(tmp_path)}
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        environment.pop(name, None)
    command = [str(window.native_viewer()), "analytics", "config"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert "analytics_enabled" not in result.stdout + result.stderr
    assert list(tmp_path.iterdir()) == []
