"""Names and texts from the network never command the terminal, and no markup in them is obeyed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable

import pytest

from dsr import Memory
from dsr.cli.common import console, errors, shown
from dsr.cli.main import main
from dsr.cli.status_table import status_table
from dsr.crdt.delta import Add, Delta, Write
from dsr.replication.wire import encode_delta
from dsr.runtime.launcher import AgentRow
from dsr.runtime.logs import PlainFormatter

EVIL = "\x1b]0;owned\x07\x1b[2J[bold red]x[/]\x9b31m\u202e"
NAME = f"cube{EVIL}"


@pytest.fixture
def evil(memory: Memory) -> Memory:
    """The graph with a cube, a type, an attribute, a value and an edge that are out to do harm."""
    delta = Delta(
        adds=[
            Add(("evil-1", 1), NAME, "cube"),
            Add(("evil-1", 2), f"other{EVIL}", f"type{EVIL}"),
            Add(("evil-1", 3), (NAME, f"other{EVIL}", f"has{EVIL}"), f"has{EVIL}", (("evil-1", 1),), (("evil-1", 2),)),
        ],
        writes=[Write(("evil-1", 1), f"note{EVIL}", 1, "evil-1", ("evil-1", 4), f"value{EVIL}")],
        context=[("evil-1", 1, 4)],
    )
    memory.restore(encode_delta(delta))
    return memory


@pytest.mark.parametrize("arguments", [("ls",), ("show", NAME), ("tree",), ("top",)])
def test_commands_show_text_only(
    evil: Memory, cli: Callable[..., str], arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(console, "width", 400)
    output = cli(*arguments)
    assert not [character for character in output if not character.isprintable() and character != "\n"]
    assert "[bold red]x[/]" in output or arguments == ("top",)


def test_errors_show_text_only(
    evil: Memory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["dsr", "show", "nothing_like_that"])
    monkeypatch.setattr(errors, "_file", sys.stderr)
    with pytest.raises(SystemExit):
        main()
    output = capsys.readouterr().err
    assert "\\x1b" in output and "\x1b" not in output


def test_the_status_table_shows_text_only() -> None:
    with console.capture() as capture:
        console.print(status_table([AgentRow(f"a{EVIL}", "ready", 1, None, 0, f"error{EVIL}")], "title"))
    assert "\x1b]" not in capture.get() and "\\x1b[2J[bold red]x[/]" in capture.get()


def test_logs_show_text_only() -> None:
    record = logging.LogRecord("dsr", logging.WARNING, "", 1, "from %s", (EVIL,), None)
    assert PlainFormatter("%(message)s").format(record) == f"from {shown(EVIL).replace(chr(92) + '[', '[')}"
