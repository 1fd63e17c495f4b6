"""Terminals that cannot show every character, or nothing but text: no command breaks off, and all stays readable."""

from __future__ import annotations

import ast
import io
import os
import pty
import subprocess
import sys
import unicodedata
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rich.console import Console

from dsr.cli.common import console, errors
from dsr.cli.main import main
from dsr.cli.streams import REPLACED, prepare_output, redraws
from dsr.memory import Memory
from tests.command_tree import leaves
from tests.commands.conftest import CUBE
from tests.commands.printed import PRINTED, Place

ROOT = Path(__file__).parents[2]
PRINTING = ("dsr", "agents", "planner", "surprise", "simulation_handler", "benchmarks")
HELD = "käse ☃"
"""An attribute of the cube."""
ENVIRONMENTS = {
    "Latin-1": ({"PYTHONIOENCODING": "latin-1"}, "käse ?".encode("latin-1")),
    "ASCII": ({"PYTHONIOENCODING": "ascii"}, b"k?se ?"),
    "C": ({"LC_ALL": "C"}, HELD.encode()),  # Python takes that for UTF-8
    "POSIX alone": ({"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}, b"k?se ?"),
}
"""What is set, and how the attribute looks."""


def dsr(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "dsr.cli", *arguments]
    return subprocess.run(command, env=os.environ | environment, capture_output=True, timeout=60, check=False)


def ascii_stream(monkeypatch: pytest.MonkeyPatch) -> io.TextIOWrapper:
    """Standard output from now on, which can hold nothing but ASCII."""
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii", write_through=True)
    monkeypatch.setattr(sys, "stdout", stream)
    return stream


def written(stream: io.TextIOWrapper) -> str:
    assert isinstance(stream.buffer, io.BytesIO)
    return stream.buffer.getvalue().decode("ascii")


@pytest.mark.parametrize(("environment", "shown"), ENVIRONMENTS.values(), ids=ENVIRONMENTS)
def test_what_cannot_be_encoded_is_replaced(memory: Memory, environment: dict[str, str], shown: bytes) -> None:
    result = dsr("show", CUBE, **environment)
    assert (result.returncode, result.stderr) == (0, b"")
    assert shown in result.stdout
    wrong = dsr("scenario", "check", "nothing_☃", **environment)
    assert wrong.returncode == 1 and b"Traceback" not in wrong.stderr


@pytest.mark.parametrize("command", PRINTED)
def test_every_command_prints_in_ascii(
    command: str,
    memory: Memory,
    cli: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = ascii_stream(monkeypatch)
    prepare_output()
    paper = Console(file=stream, width=80, highlight=False)
    for one in (console, errors):
        monkeypatch.setattr(one, "print", paper.print)
    PRINTED[command](Place(memory, cli, tmp_path, monkeypatch))
    text = written(stream)
    assert text.strip()
    assert "?" not in text.replace("k?se ?", "")  # all but what the graph holds has a replacement that says something


@pytest.mark.parametrize("command", leaves())
def test_every_help_prints_in_ascii(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = ascii_stream(monkeypatch)
    monkeypatch.setattr(sys, "argv", ["dsr", *command.split(), "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    assert f"Usage: dsr {command}" in written(stream) and "--help" in written(stream)


def test_every_sign_that_is_printed_has_a_replacement() -> None:
    lacking = {
        (str(file.relative_to(ROOT)), character)
        for package in PRINTING
        for file in (ROOT / package).rglob("*.py")
        if "fuzz" not in file.parts  # nonsense on purpose
        for text in literals(ast.parse(file.read_text(encoding="utf-8")))
        for character in text
        if not character.isascii() and unicodedata.category(character)[0] in "SPN" and character not in REPLACED
    }
    assert not lacking
    assert all(replacement.isascii() for replacement in REPLACED.values())


def literals(tree: ast.Module) -> Iterator[str]:
    """The strings of a module, without its docstrings and other strings that stand alone."""
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
            yield node.value


def on_a_terminal(*arguments: str, **environment: str) -> str:
    """What a command that ends by itself prints on a terminal of 80 columns."""
    command = [sys.executable, "-m", "dsr.cli", *arguments]
    ours, its = pty.openpty()
    with subprocess.Popen(command, env=os.environ | environment, stdin=its, stdout=its, stderr=its) as process:
        os.close(its)
        parts = []
        while part := _read(ours):
            parts.append(part)
        assert process.wait(60) == 0
    os.close(ours)
    return b"".join(parts).decode()


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 1 << 16)
    except OSError:  # the command has ended
        return b""


def test_without_colours_there_are_none(memory: Memory) -> None:
    assert "\x1b[36m" in on_a_terminal("show", CUBE, TERM="xterm-256color")
    plain = on_a_terminal("show", CUBE, TERM="xterm-256color", NO_COLOR="1")
    assert not any(f"\x1b[{colour}m" in plain for colour in range(30, 48))
    assert "\x1b" not in on_a_terminal("show", CUBE, TERM="dumb")


def test_a_dumb_terminal_gets_one_table_of_all_agents(memory: Memory) -> None:
    assert "state" in on_a_terminal("top", TERM="dumb")  # and it ends: what cannot be redrawn is not drawn for ever


def test_only_a_terminal_that_is_not_dumb_redraws() -> None:
    found = [
        redraws(Console(file=io.StringIO(), force_terminal=is_terminal, _environ={"TERM": term}))
        for is_terminal, term in ((True, "xterm"), (True, "dumb"), (False, "xterm"))
    ]
    assert found == [True, False, False]
