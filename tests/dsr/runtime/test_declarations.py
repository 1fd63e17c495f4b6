"""An agent's class that would do nothing, or declares what cannot be, is refused at its start and not restarted."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from dsr.agent import Agent
from dsr.declared import configured_class
from dsr.errors import AgentError, ConfigError
from dsr.graph.access import Access
from dsr.runtime.agent_process import run_command_line
from dsr.runtime.launcher import Launcher
from dsr.runtime.orders import EXIT_USAGE
from dsr.runtime.system import AgentSpec, load_system

HEAD = "from dsr import Access, Agent, AttributeType, main\n\n\nclass Odd(Agent):\n"
TICK = "    def tick(self, now):\n        pass\n"


def kind_of(**members: Any) -> type[Agent]:
    """An agent class with these members."""
    return type("Odd", (Agent,), {"__module__": __name__, **members})


def takes_now(self: Agent, now: float) -> None:
    """The tick of an agent that does its work somehow."""


def sets_up(self: Agent) -> None:
    """The set-up of an agent that does its work there."""


async def late(self: Agent, now: float) -> None:
    """What nobody awaits."""


async def late_for_ever(self: Agent, now: float) -> AsyncIterator[None]:
    """What nobody awaits nor iterates."""
    yield


def bit_by_bit(self: Agent, now: float) -> Iterator[None]:
    """What nobody iterates."""
    yield


@pytest.mark.parametrize(
    ("members", "said"),
    [
        ({}, "has no method tick(self, now): it would do nothing"),
        ({"tik": takes_now}, "is its method 'tik' meant to be 'tick'?"),
        ({"tcik": takes_now}, "is its method 'tcik' meant to be 'tick'?"),
        ({"Tick": takes_now}, "is its method 'Tick' meant to be 'tick'?"),
        ({"on_tick": takes_now}, "is its method 'on_tick' meant to be 'tick'?"),
        ({"update": takes_now}, "is its method 'update' meant to be 'tick'?"),
        ({"setup": sets_up, "tik": takes_now}, "if 'setup' does all its work, give it a 'tick' with `pass`"),
        ({"teardown": sets_up}, "has no method tick"),
        ({"tick": 5}, "has tick = 5, which is no method; expected: def tick(self, now)"),
        ({"tick": late}, "has an async 'tick', which nobody awaits"),
        ({"tick": late_for_ever}, "has an async 'tick', which nobody awaits"),
        ({"tick": staticmethod(late)}, "has an async 'tick', which nobody awaits"),
        ({"tick": bit_by_bit}, "has a generator 'tick' (it contains `yield`), which nobody iterates"),
        ({"tick": sets_up}, "has tick(self: 'Agent') -> 'None', which cannot be called so"),
        ({"tick": takes_now, "setup": takes_now}, "expected: def setup(self)"),
        ({"tick": takes_now, "rate_hz": 0}, "has rate_hz = 0: expected a positive number"),
        ({"tick": takes_now, "rate_hz": "5"}, "has rate_hz = '5': expected a positive number"),
        ({"tick": takes_now, "rate_hz": float("nan")}, "has rate_hz = nan: expected a positive number"),
        ({"tick": takes_now, "writes": ("cube",)}, "has writes = ('cube',): expected an Access"),
        ({"tick": takes_now, "reads": None}, "has reads = None: expected an Access"),
    ],
)
def test_a_class_that_cannot_work_is_refused_by_name_and_file(members: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)) as refused:
        AgentSpec("odd", kind_of(**members))
    assert str(refused.value).startswith(f"{__file__}: agent class 'Odd' ")


@pytest.mark.parametrize(
    "members",
    [
        {"tick": takes_now},
        {"tick": takes_now, "tik": takes_now},
        {"tick": lambda self, now, more=None: None},
        {"tick": staticmethod(lambda now: None)},
        {"setup": sets_up},
        {"setup": sets_up, "_add": takes_now, "name_of": sets_up},
    ],
)
def test_a_class_that_works_is_taken(members: dict[str, Any]) -> None:
    kind = kind_of(**members)
    assert configured_class(kind, {}) is kind


def test_one_that_gets_its_tick_by_its_configuration_is_taken() -> None:
    whole = kind_of(tick=takes_now)
    partly = kind_of(configured=classmethod(lambda cls, config: whole))
    assert configured_class(partly, {}) is whole


def test_an_agent_that_is_started_by_itself_ends_at_once(caplog: pytest.LogCaptureFixture) -> None:
    assert run_command_line(kind_of(tik=takes_now), ["--graph", "nowhere"]) == EXIT_USAGE
    assert "agent class 'Odd' has no method tick" in caplog.text


@pytest.mark.parametrize("names", ["cube", ("cube", 3), 5, None])
def test_an_access_takes_collections_of_names(names: Any) -> None:
    with pytest.raises(AgentError, match=r"nodes=.*expected a collection of names, such as"):
        Access(nodes=names)


def system_of(folder: Path, body: str, options: str = "") -> Path:
    """The file of a system with the agent Odd."""
    (folder / "odd.py").write_text(HEAD + body)
    file = folder / "odd.toml"
    file.write_text(f'graph = "odd"\n[[agent]]\nname = "odd"\nclass = "odd:Odd"\n{options}')
    return file


@pytest.fixture(autouse=True)
def _fresh_modules(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Let each test have a module `odd` of its own."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    sys.modules.pop("odd", None)


def test_a_system_with_such_a_class_is_refused_with_file_and_line(tmp_path: Path) -> None:
    file = system_of(tmp_path, "    def tik(self, now):\n        pass\n")
    with pytest.raises(ConfigError, match=r"odd\.toml:4: .*odd\.py: agent class 'Odd' has no method tick.*'tik'"):
        load_system(file)


@pytest.mark.parametrize("options", ["", 'process = "shared"\n[[agent]]\nname = "mate"\nclass = "odd:Mate"\n'])
@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('    reads = Access(nodes=("tabel",))\n' + TICK, "declared node type 'tabel' is not in the schema; did"),
        ('    writes = Access(attributes=("mas",))\n' + TICK, "declared attribute 'mas' is not in the schema"),
        (
            '    writes = Access(nodes=("cup",))\n\n    def setup(self):\n'
            '        self.memory.schema.register_node_type("cup", "a trophy")\n\n' + TICK,
            "node type 'cup' is built in and means",
        ),
        (
            '    def setup(self):\n        self.memory.add_node("c", "cube")\n\n' + TICK,
            "agent 'odd' writes nodes of type 'cube', which it does not declare",
        ),
        ("    def setup(self):\n        self.rate_hz = 0.0\n\n" + TICK, "rate 0.0 Hz: expected a positive number"),
    ],
)
def test_a_wrong_declaration_ends_the_start_at_once(tmp_path: Path, body: str, said: str, options: str) -> None:
    """Whether the agent has a process of its own or shares one."""
    mate = "\n\nclass Mate(Agent):\n    shares_process = True\n\n" + TICK
    system = load_system(system_of(tmp_path, body + mate, options))
    with Launcher(system, tmp_path / "run") as launcher:
        with pytest.raises(AgentError, match=r"agent 'odd' ended with exit code 2") as refused:
            launcher.wait_ready()
        assert said in str(refused.value)
        assert {row.agent: row.restarts for row in launcher.rows()}["odd"] == 0


def test_dsr_run_says_so_and_ends(tmp_path: Path) -> None:
    file = system_of(tmp_path, '    reads = Access(nodes=("tabel",))\n' + TICK)
    command = [sys.executable, "-m", "dsr.cli", "run", str(file)]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert run.returncode != 0
    assert "declared node type 'tabel' is not in the schema; did you mean 'table'?" in run.stdout + run.stderr
    assert "restart" not in run.stdout + run.stderr
