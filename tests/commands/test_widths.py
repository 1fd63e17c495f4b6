"""Nothing that a command prints is cut at 80 or 120 columns, however long names and numbers are."""

from __future__ import annotations

import io
import itertools
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table
from typer.testing import CliRunner

from dsr.cli.common import add_names, console, errors
from dsr.cli.main import app
from dsr.memory import Memory
from tests.command_tree import leaves
from tests.commands.conftest import CUBE, WORLD
from tests.commands.printed import PRINTED, SENTENCES, Place

ENDLESS = 10_000  # columns: nothing is folded


def characters(text: str) -> Counter[str]:
    """How often each character that says something occurs: without the lines of tables and trees, and white space."""
    return Counter(c for c in text if not c.isspace() and not 0x2500 <= ord(c) <= 0x257F)


class Paper:
    """Prints everything at a width, and once more without any; nothing may be lost at that width."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.calls = 0

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as a console does. Fails if a line is too long or something is cut."""
        self.calls += 1
        narrow, endless = (self._printed(width, objects, options) for width in (self.width, ENDLESS))
        assert characters(narrow) == characters(endless), f"\n{narrow}"
        if not options.get("soft_wrap"):
            assert max(map(len, narrow.splitlines()), default=0) <= self.width, f"\n{narrow}"

    @staticmethod
    def _printed(width: int, objects: Any, options: Any) -> str:
        stream = io.StringIO()
        Console(file=stream, width=width, highlight=False).print(*objects, **options)
        return stream.getvalue()


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("command", PRINTED)
def test_nothing_is_cut(
    command: str, width: int, memory: Memory, cli: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paper = Paper(width)
    for one in (console, errors):
        monkeypatch.setattr(one, "print", paper.print)
    PRINTED[command](Place(memory, cli, tmp_path, monkeypatch))
    assert paper.calls


@pytest.mark.parametrize("path", leaves())
def test_help_fills_its_lines(path: str) -> None:
    """No line ends before the next word would not fit any more, as where a docstring breaks its lines."""
    printed = CliRunner().invoke(app, [*path.split(), "--help"], env={"COLUMNS": "80"}).output
    lines = [line.rstrip() for line in itertools.takewhile(lambda line: "╭" not in line, printed.splitlines())]
    text = [line for line in lines if "Usage:" not in line]
    assert any(text)
    for line, following in itertools.pairwise(text):
        if line and following:
            assert len(line) + 1 + len(following.split()[0]) > 78, f"{line}\n{following}"


def test_every_command_is_looked_at() -> None:
    assert PRINTED.keys() | SENTENCES == leaves().keys() and not PRINTED.keys() & SENTENCES


def test_what_is_cut_is_noticed() -> None:
    table = Table()
    add_names(table, "name")
    table.add_column("place", no_wrap=True)
    table.add_row("x" * 100, "y" * 100)
    with pytest.raises(AssertionError, match="…"):
        Paper(80).print(table)


@pytest.mark.parametrize(("command", "name"), [("ls", CUBE), ("worlds", WORLD)])
def test_in_a_pipe_a_name_stands_on_one_line(memory: Memory, command: str, name: str) -> None:
    wide = dict(os.environ)
    assert name in printed(command, env=wide)
    assert name not in printed(command, env=wide | {"COLUMNS": "80"})


def printed(command: str, env: dict[str, str]) -> str:
    """The output of `dsr` as a process with this environment, into a pipe.

    A process inherits `COLUMNS` from pytest otherwise: readline sets it behind the back of `os.environ`.
    """
    program = [sys.executable, "-m", "dsr.cli", command]
    return subprocess.run(program, env=env, capture_output=True, text=True, timeout=60, check=True).stdout
