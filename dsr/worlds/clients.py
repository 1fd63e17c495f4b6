"""Agents that say in which worlds they are at home: `Reader`, `Provider`, `Monitor`, and their base."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec

from dsr.agent import Agent
from dsr.errors import ConfigError, TransportError, WorldNotFoundError
from dsr.graph.access import EVERYTHING, Access
from dsr.graph.schema import WORLD_RECORD
from dsr.graph.watch import Change
from dsr.network.keys import BASE, check_name
from dsr.worlds.source import Source

if TYPE_CHECKING:
    from dsr.memory import Memory

_ALL = (EVERYTHING,)


class WorldsConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """In which worlds an agent is at home, if not in those that its class names; base of its configuration."""

    reads: tuple[str, ...] = ()
    """Worlds that it reads."""
    writes: str = ""
    """Name of the world that the client writes."""


class Client(Agent):
    """Base of the agents that name their worlds: `reads = ("base",)`, `writes = "stable"`.

    It opens them, and makes the one that it writes if there is none. As long as one is missing, or after one was
    deleted, it waits, which its status tells, and goes on as soon as they are all there. It is woken by what changes in
    the worlds that it reads, so that `rate_hz` only matters for what depends on time, unless it is not `reactive`.

    As an agent it declares (`Agent.reads`, `Agent.writes`) everything in these worlds, or of the world that it writes
    only `contents`, and nothing in any other one.
    """

    reads: ClassVar[Any] = ()
    """Names of the worlds that it reads; once the class exists, what that amounts to as `Access`."""
    writes: ClassVar[Any] = ""
    """Name of the world that the client writes, which its configuration may replace; empty for none."""
    contents: ClassVar[Access] = Access(_ALL, _ALL, _ALL)
    """Types and attributes that the client may write there."""
    reactive = True
    rate_hz = 5.0
    Config = WorldsConfig

    inputs: ClassVar[tuple[str, ...]] = ()
    """Names of the worlds that it reads."""
    output: ClassVar[str] = ""
    """Name of the world that it writes; empty for none."""

    sources: dict[str, Memory]
    """Worlds that the client reads, by name."""
    target: Memory
    """The world that the client writes; the first that it reads if it names none."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Take down the names of the worlds, and say what they amount to as declarations. Raises `ConfigError`."""
        super().__init_subclass__(**options)
        reads, writes = cls.__dict__.get("reads", Access()), cls.__dict__.get("writes", Access())
        if not isinstance(reads, Access):
            names = (reads,) if isinstance(reads, str) else tuple(reads)
            cls.inputs = tuple(check_name("world name", name) for name in names)
        if not isinstance(writes, Access):
            cls.output = check_name("world name", writes) if writes else ""
        if cls.output and cls.output in cls.inputs:
            raise ConfigError(f"{cls.__name__} reads and writes world {cls.output!r}: a Monitor may, with writes = ''")
        cls.reads = Access(_ALL, _ALL, _ALL, worlds=cls.inputs)
        cls.writes = cls._may_write()

    @classmethod
    def _may_write(cls) -> Access:
        """What it may write: `contents`, and the list of worlds if it has to make its own."""
        if not cls.output:
            return Access(worlds=())
        nodes = (*cls.contents.nodes, *(() if cls.output == BASE else (WORLD_RECORD, "world")))
        edges, attributes, exclusive = cls.contents.edges, cls.contents.attributes, cls.contents.exclusive
        return Access(nodes, edges, attributes, exclusive=exclusive, worlds=(cls.output,))

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> type[Agent]:
        """This class at home in the worlds that `config` names. Raises `ConfigError` for names that cannot be used."""
        given = {key: config[key] for key in ("reads", "writes") if config.get(key)}
        if not given or not _are_names(given):
            return cls
        return type(cls.__name__, (cls,), {**given, "__module__": cls.__module__, "__doc__": cls.__doc__})

    def world_names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the worlds that the client reads, and of those that it writes."""
        return self.inputs, tuple(self._may_write().worlds or ())

    # ---- the life of an agent

    def setup(self) -> None:
        """Prepare; who overrides this calls it too."""
        self.sources = {}
        wake = self.wake if self.reactive else None
        self._sources = {name: Source(self.memory, name, wake) for name in self.inputs}
        self._target: Memory | None = None
        self._made = False
        self._waiting = ""
        self._records = self.memory.watch(node_type=WORLD_RECORD, existing=False, notify=self.wake)
        if not self.inputs and not self.output:
            raise ConfigError(f"agent {self.name!r} names no world that it reads or writes")

    def tick(self, now: float) -> None:
        """`update`, if all worlds are there."""
        self._records.poll()
        if self._is_ready():
            self.update(now)

    def opened(self) -> None:
        """Called when all worlds are there: at the beginning, and again after one was missing."""

    def update(self, now: float) -> None:
        """Do a step of work at time `now` (s): something has changed, or the next step is due."""

    def changes(self) -> dict[str, list[Change]]:
        """Return the changes in each world that the client reads since the last call; at first all elements that are
        there.
        """
        return {name: source.take() for name, source in self._sources.items()}

    # ---- opening

    def _is_ready(self) -> bool:
        """Whether all worlds are there; opens those that are not open."""
        missing, lost = self._missing()
        if missing:
            if missing != self._waiting:
                self.log.warning("%s; it waits for that", missing)
            self.degraded = self._waiting = missing
            return False
        if lost:
            if self._waiting:
                self.log.info("all its worlds are there: it goes on")
            self.degraded = self._waiting = ""
            self.opened()
        return True

    def _missing(self) -> tuple[str, bool]:
        """Why it has to wait, empty if it has not, and whether a world was opened."""
        problems, news = [], False
        for name, source in self._sources.items():
            if source.is_open:
                continue
            try:
                self.sources[name] = source.open()
                news = True
            except (WorldNotFoundError, TransportError) as error:
                problems.append(str(error))
        if (self.output or not problems) and (self._target is None or self._target.closed):
            try:
                self.target = self._target = self._open_target()
                news = True
            except (WorldNotFoundError, TransportError) as error:
                problems.append(str(error))
        return "; ".join(problems), news

    def _open_target(self) -> Memory:
        """The world that it writes; it makes it once, but not again when somebody deleted it."""
        if not self.output:
            return next(iter(self.sources.values()))
        if self.output == BASE:
            return self.memory
        if self._made:
            return self.memory.world(self.output)
        memory = self._make_output()
        self._made = True
        return memory

    def _make_output(self) -> Memory:
        """The world that it writes, made if there is none."""
        return self.memory.create_world(self.output, exist_ok=True)


class Reader(Client):
    """Reads worlds and writes none."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.output:
            raise ConfigError(f"{cls.__name__} is a Reader and writes world {cls.output!r}: make it a Filter")


class Provider(Client):
    """Writes a world from data outside of all worlds: sensors, files, people."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.inputs:
            raise ConfigError(f"{cls.__name__} is a Provider and reads {', '.join(cls.inputs)}: make it a Filter")


class Monitor(Client):
    """Watches worlds and adds its findings (relations, events, marks) to the first one that it reads.

    With `writes` it adds that to another world.
    """

    @classmethod
    def _may_write(cls) -> Access:
        found = super()._may_write()
        if cls.output or not cls.inputs:
            return found
        return Access(cls.contents.nodes, cls.contents.edges, cls.contents.attributes, worlds=cls.inputs[:1])


def _are_names(given: Mapping[str, Any]) -> bool:
    """Whether worlds are named as `WorldsConfig` wants it; if not, the configuration is refused later."""
    reads, writes = given.get("reads", ()), given.get("writes", "")
    listed: Iterable[Any] = reads if isinstance(reads, list | tuple) else (None,)
    return isinstance(writes, str) and all(isinstance(name, str) for name in listed)
