"""Which agents make up a system: read from `etc/systems/*.toml` and checked before anything starts."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import importlib.util
import logging
import sys
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from dsr.agent import Agent
from dsr.config.extras import MissingExtraError, check_installed, missing_extra
from dsr.config.own_packages import OWN_PACKAGES, stranger
from dsr.config.toml import TomlFile, convert
from dsr.declared import configured_class
from dsr.errors import ConfigError, DsrError, suggest
from dsr.files.built_in import ETC
from dsr.graph.access import check_writers
from dsr.network.keys import check_interest, check_name
from dsr.runtime.native_output import silenced

SHARED = "shared"
"""Process of the agents that may share one, where the system file names none."""
RUN = "run"
"""No agent and no process has this name: the log of `dsr run` itself has it."""
RUN_FOLDER = "{run}"
"""Stands in a system file for the folder of the run."""
_log = logging.getLogger("dsr.system")


@dataclass(frozen=True)
class AgentSpec:
    """One agent of a system: what to run under which name and configuration.

    Raises `ConfigError` for a class that would do nothing, or whose declarations cannot be.
    """

    name: str
    kind: type[Agent]
    config: Mapping[str, Any] = field(default_factory=dict)
    program: str = ""
    """`module:Class`, which `python -m dsr.runtime` starts as a process; empty for one that only runs in lockstep."""
    restart: bool = True
    """Start it again when it crashed."""
    ready_timeout: float = 30.0
    """s it may take until its first good tick, beside the time in which it waits for a processor."""
    process: str = ""
    """Name of the process in which it runs, together with all others of that process; empty for the default."""
    interest: tuple[str, ...] | None = None
    """Parts of the graph that it holds, "*" for all; None for those that its class declares."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", configured_class(self.kind, self.config))
        if self.interest is not None:
            object.__setattr__(self, "interest", check_interest(self.interest))
        if not self.process:
            object.__setattr__(self, "process", SHARED if self.kind.shares_process else self.name)


@dataclass(frozen=True)
class System:
    """The agents that work on one graph."""

    graph: str
    agents: tuple[AgentSpec, ...]
    folder: Path | None = None
    """Folder of the system's file; None without one. Agents of one's own may lie beside the file."""

    def __post_init__(self) -> None:
        check_name("graph name", self.graph)
        check_writers({spec.name: spec.kind.writes for spec in self.agents})
        self._check_processes()

    def _check_processes(self) -> None:
        names = {spec.name for spec in self.agents}
        if RUN in names | self.processes().keys():
            raise ConfigError(f"no agent and no process can be called {RUN!r}: the log of `dsr run` has that name")
        for process, specs in self.processes().items():
            if len(specs) > 1 and process in names:
                shared = ", ".join(spec.name for spec in specs)
                raise ConfigError(
                    f"process {process!r}, which {shared} share, has the name of an agent; "
                    f"name it otherwise, or give {process} alone its own name"
                )

    def processes(self) -> dict[str, list[AgentSpec]]:
        """The agents by the process in which they run, in order."""
        found: dict[str, list[AgentSpec]] = {}
        for spec in self.agents:
            found.setdefault(spec.process, []).append(spec)
        return found

    def apart(self, *names: str) -> System:
        """A copy in which each agent called so has a process of its own. Raises `ConfigError` for an unknown name."""
        chosen = [self.agent(name) for name in names]
        agents = (dataclasses.replace(spec, process=spec.name) if spec in chosen else spec for spec in self.agents)
        return dataclasses.replace(self, agents=tuple(agents))

    def final(self, *names: str) -> System:
        """A copy in which agents called so are not started again when they crash. Raises `ConfigError`."""
        chosen = [self.agent(name) for name in names]
        agents = (dataclasses.replace(spec, restart=False) if spec in chosen else spec for spec in self.agents)
        return dataclasses.replace(self, agents=tuple(agents))

    def agent(self, name: str) -> AgentSpec:
        """The agent called `name`. Raises `ConfigError`."""
        for spec in self.agents:
            if spec.name == name:
                return spec
        raise ConfigError(f"no agent {name!r}; {suggest(name, (spec.name for spec in self.agents))}")

    def with_config(self, agent: str, **fields: Any) -> System:
        """A copy in which `agent` is configured with `fields` too. Raises `ConfigError`."""
        spec = self.agent(agent)
        changed = dataclasses.replace(spec, config={**spec.config, **fields})
        convert(changed.config, spec.kind.Config, f"configuration of agent {agent!r}")
        agents = tuple(changed if other is spec else other for other in self.agents)
        return dataclasses.replace(self, agents=agents)

    def without(self, *names: str) -> System:
        """A copy without the agents called `names`. Raises `ConfigError` for a name that is not there."""
        gone = [self.agent(name) for name in names]
        return dataclasses.replace(self, agents=tuple(spec for spec in self.agents if spec not in gone))

    def on_graph(self, graph: str) -> System:
        """A copy that works on another graph."""
        return dataclasses.replace(self, graph=graph)

    def in_folder(self, folder: Path) -> System:
        """A copy in whose configurations "{run}" is replaced by `folder`."""
        agents = (dataclasses.replace(spec, config=_replace(spec.config, str(folder))) for spec in self.agents)
        return dataclasses.replace(self, agents=tuple(agents))


def _replace(value: Any, folder: str) -> Any:
    """A configuration with its strings filled in."""
    if isinstance(value, str):
        return value.replace(RUN_FOLDER, folder)
    if isinstance(value, Mapping):
        return {key: _replace(item, folder) for key, item in value.items()}
    return [_replace(item, folder) for item in value] if isinstance(value, list) else value


class _AgentTable(msgspec.Struct, frozen=True):
    name: str
    agent_class: str = msgspec.field(name="class")
    config: dict[str, Any] = {}
    restart: bool = True
    ready_timeout: float = 30.0
    process: str = ""
    """Name of the process that it shares with all others of that process; its own name for one of its own."""
    interest: list[str] | None = None
    """Parts of the graph that the agent holds, "*" for all; by default those that its class declares."""
    optional: bool = False
    """Whether the system runs without the agent where the libraries of its extra are not installed."""


class _SystemFile(msgspec.Struct, frozen=True):
    graph: str
    agent: list[_AgentTable]


def load_system(name_or_path: str | Path, only: Collection[str] | None = None, *, beside: bool = True) -> System:
    """The system of a file, or the one of that name in `etc/systems`.

    Args:
        name_or_path: which system.
        only: names of the agents that are wanted; the classes of others are not loaded. Default: all.
        beside: whether modules that lie beside the file may be imported, which runs what stands in them.

    Raises:
        ConfigError: naming file and line: for unknown fields, classes that cannot be loaded, names used twice,
            configurations that their agent refuses, two agents that must not write the same thing.
    """
    file = find_system(name_or_path)
    source = TomlFile(file)
    tables = source.convert(_SystemFile)
    folder = file.resolve().parent
    wanted = [(i, table) for i, table in enumerate(tables.agent) if only is None or table.name in only]
    read = [_read_agent(source, index, table, folder, beside) for index, table in wanted]
    for count, (index, table) in enumerate(wanted):
        if table.name in {other.name for _, other in wanted[:count]}:
            raise source.error(f"two agents are called {table.name!r}", ("agent", index, "name"))
    specs = [spec for spec in read if spec is not None]
    if only is None and not specs:
        raise source.error("no agent is left to run" if tables.agent else "expected an agent at least", ("agent",))
    with _located(source, ()):
        return System(tables.graph, tuple(specs), folder)


def _read_agent(source: TomlFile, index: int, table: _AgentTable, folder: Path, beside: bool) -> AgentSpec | None:
    """The agent of one table, with its class loaded and its configuration checked; None if it is left out."""
    path = ("agent", index)
    with _located(source, (*path, "name")):
        check_name("agent name", table.name)
    with _located(source, (*path, "class")):
        try:
            kind = load_class(table.agent_class, folder, beside=beside)
        except MissingExtraError as error:
            if not table.optional:
                raise
            _log.warning("%s is left out: %s", table.name, error)
            return None
        configured_class(kind, table.config)
    if table.config:
        source.convert(kind.Config, (*path, "config"))
    with _located(source, (*path, "process")):
        process = check_name("process name", table.process) if table.process else ""
    with _located(source, (*path, "interest")):
        interest = None if table.interest is None else check_interest(table.interest)
    return AgentSpec(
        table.name, kind, table.config, table.agent_class, table.restart, table.ready_timeout, process, interest
    )


@contextlib.contextmanager
def _located(source: TomlFile, path: tuple[str | int, ...]) -> Iterator[None]:
    try:
        yield
    except DsrError as error:
        raise source.error(str(error), path) from error


def load_class(name: str, folder: Path | None = None, *, beside: bool = True) -> type[Agent]:
    """The agent class `module:Class`; modules in `folder` are found too. Raises `ConfigError`.

    Importing a module runs what stands in it. Unless `beside`, only modules that are installed are imported.
    """
    module, _, cls = name.partition(":")
    if not beside and not _is_installed(module.partition(".")[0], folder):
        raise ConfigError(f"class {name!r} is not of an installed package, and --no-import forbids to import others")
    if beside and folder is not None and str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        with silenced():  # pybullet introduces itself
            kind = getattr(importlib.import_module(module), cls)
    except Exception as error:  # whatever the module does when it is imported
        if other := stranger(module):
            raise ConfigError(f"class {name!r} cannot be loaded: {other}") from error
        if absent := missing_extra(error):
            raise MissingExtraError(f"class {name!r} cannot be loaded: {absent}") from error
        reason = f"{type(error).__name__}: {error}"
        raise ConfigError(f"class {name!r} cannot be loaded ({reason}); expected 'module:Class'") from error
    if not (isinstance(kind, type) and issubclass(kind, Agent)):
        raise ConfigError(f"class {name!r} is no dsr.agent.Agent")
    check_installed(kind.libraries, f"class {name!r} cannot be loaded")
    return kind


def _is_installed(package: str, folder: Path | None) -> bool:
    """Whether a package is found elsewhere than in `folder` or where this process runs; it is not imported."""
    if package in OWN_PACKAGES:
        return True
    try:
        found = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return False
    if found is None:
        return False
    places = [Path(place).resolve() for place in (found.submodule_search_locations or [found.origin or ""])]
    near = {Path.cwd().resolve(), *([folder.resolve()] if folder else [])}
    return not any(near & {place, *place.parents} for place in places)


def agent_names(file: Path) -> list[str]:
    """Names of the agents in a system file; their classes are not loaded. Raises `ConfigError`."""
    return [table.name for table in TomlFile(file).convert(_SystemFile).agent]


def known_systems() -> dict[str, Path]:
    """The files of the systems that have a name: the built-in ones, and those in `./etc/systems`."""
    return {file.stem: file for folder in (ETC, Path("etc")) for file in folder.glob("systems/*.toml")}


def find_system(name_or_path: str | Path, folder: Path | None = None) -> Path:
    """The file of a system: a path that ends in `.toml`, relative to `folder`, or the name of one in `etc/systems`.

    Without `folder`, paths are relative to where the process runs. Raises `ConfigError` for an unknown name.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return path if folder is None else folder / path
    known = known_systems()
    if str(name_or_path) not in known:
        hint = suggest(str(name_or_path), known)
        path_too = "" if hint.endswith("?") else ", or a path ending in '.toml'"
        raise ConfigError(f"unknown system {str(name_or_path)!r}; {hint}{path_too}")
    return known[str(name_or_path)]
