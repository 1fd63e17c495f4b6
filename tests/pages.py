"""The pages of the documentation as blocks of code, and how a block of each language is tried."""

from __future__ import annotations

import configparser
import contextlib
import importlib.util
import io
import itertools
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import typer
from typer.testing import CliRunner

from agents.calibrator.hand_eye.reading import intrinsics_for
from agents.calibrator.hand_eye.targets import read_target
from agents.object_models import parse_model
from agents.ros_bridge.messages.types import types_of
from agents.scenario.format.scenario import parse_scenario
from agents.viewer import ViewerConfig
from dsr import Memory, read_graph
from dsr.cli.main import app
from dsr.runtime.system import load_system
from tests.agents.ros_bridge.robot import bridged

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", ROOT / "ARCHITECTURE.md", *sorted(ROOT.glob("docs/**/*.md")))
PATIENCE = 60.0
"""s for an endless program to print a line, and again to end: beside 30 busy processes each takes 7 s."""
_BLOCK = re.compile(
    r"^(?:<!-- not run: (?P<excuse>.+) -->\n)?(?P<endless><!-- runs until it is stopped -->\n)?"
    r"(?:`(?P<name>[\w./-]+)`:\n)?```(?P<language>\w*)\n(?P<code>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
QUICK = re.compile(
    r"ls( --all)?|show \w+|tree|top|worlds|parts|stamps( --clean)?|logs( --lines \d+)?|visibility"
    r"|relations( cube_3)?( --from camera_overhead)?( -r \w+)*( --json)?"
    r"|timeline( (-k|-p|--kind|--since|--type|--relation|--of) [\w:-]+| --json| --open)*|timeline recording\.mcap .*"
    r"|days( --on (\w+|\"[^\"]+\")| --timezone [\w/]+| --json)*"
    r"|ask \"[^\"]+\"( --timezone [\w/]+)?( recording\.mcap)?( --at \d+| --evidence| --json)*"
    r"|tell( (--since|--about) ([\w-]+|\"[^\"]+\")| --json)*|tell recording\.mcap .*"
    r"|where cube_\d( --json)?"
    r"|record (info|export) recording\.mcap .*"
    r"|what-if( (--place|--remove|--hold|--seconds|--worlds) \S+)*( --json)?"
    r"|save scene\.json|mission --list|bench --list|drivers list|new \w+"
    r"|scenario (list|(check|truth) \S+|generate \S+ --seed \d+ -o \S+)"
    r"|robots (list|check \w+)"
    r"|security (init|add|show)(?!.*--renew) .*"
)
"""Commands of `dsr` that end by themselves within about a second; all others are only parsed."""
LOOKS = {
    "ls", "show", "tree", "top", "worlds", "parts", "relations", "visibility", "timeline", "tell", "ask", "where",
    "days", "what-if", "stamps",
}  # fmt: skip
"""Quick commands that change nothing: running one of them once is enough."""
ALONE = re.compile(r"(new|scenario|security|bench|drivers|robots)\b.*")
"""Quick commands that need no running system."""
_EXCERPT = 'name = "excerpt"\ntitle = "An excerpt"\nduration = 20.0\n'
_CUP = '\n[[object]]\nname = "cup_1"\nmodel = "cup"\nknown = true\nposition = [0.30, 0.10, 0.045]\n'


class Block(NamedTuple):
    """A block of code."""

    page: Path
    line: int
    """In which it begins, counted from 1."""
    language: str
    code: str
    name: str
    """Name of the file that it is; empty if it has none."""
    excuse: str
    """Why it cannot be run; empty if it can."""
    endless: bool
    """It goes on until Ctrl-C: it must print something, and end."""
    follows: bool
    """Nothing but empty lines stand between the block before and this one."""

    @property
    def where(self) -> str:
        """The place, as editors understand it."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def commands(self) -> Iterator[list[str]]:
        """Yield the words of each command of a block of the shell."""
        lines = self.code.splitlines()
        if self.language == "console":
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        yield from filter(None, (shlex.split(line, comments=True) for line in lines))


def blocks_of(page: Path) -> list[Block]:
    """Find the blocks of a page, in order. Raises `AssertionError` if one has no language or does not end."""
    return blocks_in(page.read_text(encoding="utf-8"), page)


def blocks_in(text: str, page: Path) -> list[Block]:
    """Find the blocks of the text of a page, as `blocks_of`."""
    end, blocks = 0, []
    for found in _BLOCK.finditer(text):
        line = text.count("\n", 0, found.start("language")) + 1
        follows = not text[end : found.start()].strip()
        blocks.append(
            Block(
                page, line, found["language"], found["code"], found["name"] or "", found["excuse"] or "",
                bool(found["endless"]), follows,
            )
        )  # fmt: skip
        end = found.end()
    assert len(re.findall(r"^\s*```", text, re.MULTILINE)) == 2 * len(blocks), f"{page}: a block that is not found"
    unknown = [block.where for block in blocks if block.language not in Attempt.KINDS]
    assert not unknown, f"blocks in no known language: {unknown}"
    return blocks


def is_quick(words: list[str]) -> bool:
    """Whether a command is one of `dsr` that is run."""
    return words[0] == "dsr" and QUICK.fullmatch(" ".join(words[1:])) is not None


def needs_system(blocks: list[Block]) -> bool:
    """Whether a page takes the running system `tabletop` for granted."""
    staged = ('connect("tabletop"', '"recording.mcap"')
    code = any(word in block.code for block in blocks if block.language == "python" for word in staged)
    shell = [words for block in blocks if block.language in ("sh", "console") for words in block.commands()]
    return code or any(is_quick(words) and not ALONE.fullmatch(" ".join(words[1:])) for words in shell)


class Attempt:
    """Tries blocks of a page in order, in the current folder and one namespace.

    Args:
        blocks: of the page.
        known: commands of `dsr` that ran already and need not run again; those that run now are added.
    """

    def __init__(self, blocks: list[Block], known: set[str] | None = None) -> None:
        self._blocks = blocks
        self._known = set() if known is None else known
        self._names: dict[str, Any] = {"__name__": "page"}
        self._printed = ""

    def all(self) -> None:
        """Try all blocks but those with an excuse. Raises what a block raises, with the place of the block."""
        for block in self._blocks:
            if block.name:
                Path(block.name).write_text(block.code, encoding="utf-8")
        try:
            for block in self._blocks:
                if not block.excuse:
                    self._one(block)
        finally:
            for value in self._names.values():
                if isinstance(value, Memory):
                    value.close()

    def _one(self, block: Block) -> None:
        try:
            Attempt.KINDS[block.language](self, block)
        except Exception as error:
            error.add_note(block.where)
            raise

    def python(self, block: Block) -> None:
        """Execute the block; a file as if it were imported."""
        if block.endless:
            _until_stopped(block)
            return
        if block.name:
            self._names["__name__"] = Path(block.name).stem
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block.code, block.where, "exec"), self._names)
        self._printed = printed.getvalue()

    def text(self, block: Block) -> None:
        """Compare what follows a block of Python with what that printed."""
        if block.follows and self._before(block).language == "python":
            assert block.code == self._printed, f"it printed:\n{self._printed}"

    def shell(self, block: Block) -> None:
        """Check each command, and run those that are quick."""
        for words in block.commands():
            program = Path(words[0]).name
            assert program in PROGRAMS, f"no test knows the program {program!r}"
            PROGRAMS[program](words[1:])
            if is_quick(words) and shlex.join(words) not in self._known:
                result = CliRunner().invoke(app, words[1:])
                said = f"{result.output}\n{result.exception or ''}"
                assert result.exit_code == 0, f"{shlex.join(words)}: exit code {result.exit_code}\n{said}"
                if words[1] in LOOKS:
                    self._known.add(shlex.join(words))

    def toml(self, block: Block) -> None:
        """Read a system or a scenario, or an excerpt of one."""
        text = block.code
        if "[[agent]]" in text:
            file = Path(block.name or "excerpt.toml")
            file.write_text(text if "graph =" in text else f'graph = "excerpt"\n{text}', encoding="utf-8")
            assert load_system(file).agents
        elif block.name == "layout.toml":
            Path(block.name).write_text(text, encoding="utf-8")
            assert len(read_target(f"tags:{block.name}").points)
        elif block.name == "lens.toml":
            Path(block.name).write_text(text, encoding="utf-8")
            assert intrinsics_for(Path(block.name), (640, 480)).distortion
        elif text.startswith("# excerpt"):
            parse_scenario(_EXCERPT + text + ("" if 'name = "cup_1"' in text else _CUP))
        else:
            parse_scenario(text)

    def json(self, block: Block) -> None:
        """Read a graph, or any JSON."""
        if "format" in json.loads(block.code):
            Path("shown.json").write_text(block.code, encoding="utf-8")
            assert read_graph("shown.json").nodes

    def xml(self, block: Block) -> None:
        """Read the model of an object."""
        assert parse_model(block.code.encode())

    def ini(self, block: Block) -> None:
        """Read a unit of systemd."""
        assert configparser.ConfigParser().read_string(block.code) is None

    def _before(self, block: Block) -> Block:
        place = self._blocks.index(block)
        return self._blocks[place - 1] if place else block

    KINDS: dict[str, Callable[[Attempt, Block], None]] = {  # noqa: RUF012
        "python": python, "sh": shell, "console": shell, "toml": toml, "json": json, "xml": xml, "ini": ini,
        "text": text,
    }  # fmt: skip


def _until_stopped(block: Block) -> None:
    """Start a program, wait for a line that it prints, and end it by Ctrl-C."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-u", block.name]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment) as process:
        killer = threading.Timer(PATIENCE, process.kill)
        killer.start()
        assert process.stdout is not None
        line = process.stdout.readline()
        killer.cancel()
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
    assert line, f"it printed nothing in {PATIENCE:g} s, or ended: exit code {process.returncode}, {errors.decode()}"


def check_dsr(words: list[str]) -> None:
    """Parse a command line of `dsr`; raises for a command or an option that does not exist."""
    group: Any = typer.main.get_command(app)
    while commands := getattr(group, "commands", None):
        if group.invoke_without_command and not set(commands).intersection(words):
            break  # a command that has others below it
        context = group.make_context("dsr", list(words), resilient_parsing=True)  # takes the options before a command
        _, group, words = group.resolve_command(context, [*context._protected_args, *context.args])
    group.make_context("dsr", words, resilient_parsing=False)


def check_python(words: list[str]) -> None:
    """Find the module or the file; of a measurement, the options as well."""
    if words[0] != "-m":
        assert Path(words[0]).is_file(), words[0]
        return
    found = importlib.util.find_spec(words[1])
    assert found is not None and found.origin is not None, words[1]
    if words[1].startswith("benchmarks."):
        folder = Path(found.origin).parent
        files = folder.rglob("*.py") if found.submodule_search_locations else [Path(found.origin)]
        source = "".join(file.read_text(encoding="utf-8") for file in files)
        assert not [word for word in words if word.startswith("--") and f'"{word}"' not in source], words


def check_pip(words: list[str]) -> None:
    """Find the extras of this project."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extras in re.findall(r"(?:dsr-memory|\.)\[(.+?)\]", " ".join(words)):
        assert set(extras.split(",")) <= set(project["optional-dependencies"]), extras


def check_make(words: list[str]) -> None:
    """Find the targets."""
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert {word for word in words if "=" not in word} <= set(targets), words


def check_ssh(words: list[str]) -> None:
    """A tunnel to the served view: its ports are those that `dsr view --serve` takes."""
    config = ViewerConfig()
    ports = [forward.split(":") for option, forward in itertools.pairwise(words) if option == "-L"]
    assert sorted(int(port) for _, _, port in ports) == sorted((config.port, config.web_port))
    assert all(here == there and address == config.bind for here, address, there in ports)


def check_ros2(words: list[str]) -> None:
    """Find the types of a call of a service, fill its request, and find the name among those that the bridge serves."""
    if words[:2] != ["service", "call"]:
        assert words[0] == "run" or words[:2] in (["bag", "info"], ["bag", "play"]), words
        return
    name, type, *request = words[2:]
    fields = json.loads(request[0]) if request else {}
    assert types_of("jazzy").new(f"{type}_Request", **fields), words
    with bridged() as system:
        assert (name, type) in {(one.topic.name, one.topic.type) for one in system.ros.services}


def check_colcon(words: list[str]) -> None:
    """Find the packages that are to be built."""
    assert words[:2] == ["build", "--packages-select"]
    assert all((ROOT / "etc/ros" / package / "package.xml").is_file() for package in words[2:])


PROGRAMS: dict[str, Callable[[list[str]], None]] = {
    "dsr": check_dsr, "python": check_python, "pip": check_pip, "make": check_make,
    "ssh": check_ssh, "ros2": check_ros2, "colcon": check_colcon, "cd": lambda _: None, "export": lambda _: None,
}  # fmt: skip
"""How the words after the name of each program are checked."""
