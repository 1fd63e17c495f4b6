"""The commands of `dsr`: found, described without an import, imported when used."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from dsr.cli import commands
from dsr.cli.commands import OWN, Commands, file_of, load_command, plugins
from dsr.config.extras import EXTRAS
from dsr.errors import ConfigError

LIGHT = """
import sys
from dsr.cli.main import app
app(["--help"], standalone_mode=False)
sys.stderr.write(" ".join(sys.modules))
"""


def test_each_is_described_as_it_describes_itself() -> None:
    group = Commands(name="dsr")
    assert {"demo", "scenario", "record"} <= plugins().keys()
    for name in (*OWN, *plugins()):
        told, own = group.commands[name].help or "", load_command(name)
        help_text = " ".join((own.help or own.callback.__doc__ or "").split())
        assert told.rstrip() and help_text.startswith(told.rstrip()), name


def test_the_help_imports_no_command_and_nothing_heavy() -> None:
    result = subprocess.run([sys.executable, "-c", LIGHT], capture_output=True, text=True, check=True)
    loaded = set(result.stderr.split())
    assert "typer" in loaded
    assert loaded.isdisjoint({"numpy", "zenoh", "msgspec", "pybullet", "dsr.memory", "agents", "planner"})


def test_what_cannot_be_imported_is_told_when_it_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {
        "gone": EntryPoint("gone", "no_such_package.cli:app", commands.GROUP),
        "lacking": EntryPoint("lacking", "dsr.clock:no_such_app", commands.GROUP),
    }
    monkeypatch.setattr(commands, "plugins", lambda: found)
    group = Commands(name="dsr")
    assert group.commands["gone"].help == "(is not installed)"
    for name in found:
        with pytest.raises(ConfigError, match=f"the command '{name}' cannot be loaded"):
            load_command(name)


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "lacks.py").write_text('"""`dsr lacks`: needs a viewer."""\nimport rerun_that_is_not_there\n')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(EXTRAS, "rerun_that_is_not_there", "view")
    plugin = EntryPoint("lacks", "lacks:app", commands.GROUP)
    monkeypatch.setattr(commands, "plugins", lambda: {"lacks": plugin})
    assert file_of(plugin) == tmp_path / "lacks.py"
    assert Commands(name="dsr").commands["lacks"].help == "`dsr lacks`: needs a viewer."
    with pytest.raises(ConfigError, match=r"run: pip install 'dsr-memory\[view\]'"):
        load_command("lacks")
