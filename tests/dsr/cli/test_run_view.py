"""`dsr run --view`: says at once why no window can be opened."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from dsr.cli.run import app
from dsr.errors import ConfigError

_SYSTEM = """

graph = "g"

[[agent]]
name = "{name}"
class = "agents.viewer:Viewer"
"""


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(("name", "said"), [("viewer", "no display.*--serve"), ("eye", "no agent 'viewer'.*dsr view")])
def test_no_window_is_told_before_anything_starts(tmp_path: Path, name: str, said: str) -> None:
    file = tmp_path / "system.toml"
    file.write_text(_SYSTEM.format(name=name))
    answer = CliRunner().invoke(app, [str(file), "--view", "--folder", str(tmp_path / "run")])
    assert isinstance(answer.exception, ConfigError)
    with pytest.raises(ConfigError, match=said):
        raise answer.exception
    assert not (tmp_path / "run").exists()
