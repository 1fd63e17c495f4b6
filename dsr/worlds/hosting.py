"""An agent that was written for the base, at work in another world."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import msgspec

from dsr.agent import Agent, make_agent
from dsr.declared import configured_class
from dsr.errors import ConfigError
from dsr.worlds.clients import Monitor, WorldsConfig

if TYPE_CHECKING:
    from dsr.memory import Memory


class HostedConfig(WorldsConfig, frozen=True, forbid_unknown_fields=True):
    """The worlds in which the agent is at work, and its own configuration."""

    agent: dict[str, Any] = msgspec.field(default_factory=dict)
    """The configuration of the agent itself."""


class Hosted(Monitor):
    """Runs the agent `hosts`, as it is, in another world: this world is the agent's memory.

    Without `writes` that is the first world of `reads`. With `writes` it is an overlay of that world, made if there is
    none: the agent reads the first world through it, live, and what it writes stays in the overlay.
    """

    hosts: ClassVar[type[Agent]] = Agent
    Config = HostedConfig
    config: HostedConfig
    reactive = False

    def __init_subclass__(cls, **options: Any) -> None:
        cls.contents = cls.hosts.writes
        cls.rate_hz = cls.hosts.rate_hz
        cls.publishes = cls.hosts.publishes
        cls.libraries = cls.hosts.libraries
        super().__init_subclass__(**options)

    def setup(self) -> None:
        """Check the configuration of the agent. Raises `ConfigError`."""
        super().setup()
        self._agent: Agent | None = None
        if not self.inputs:
            raise ConfigError(f"agent {self.name!r} names no world that it reads")
        configured_class(self.hosts, self.config.agent)
        self._make(self.memory)

    def opened(self) -> None:
        """Set the agent up, anew if its world was made anew."""
        self._end()
        agent = self._make(self.target)
        self._agent = agent
        agent.setup()

    def update(self, now: float) -> None:
        """Let the agent do a step."""
        self.changes()
        if self._agent is not None:
            with self.target.batch():
                self._agent.tick(now)
            self.degraded = self._agent.degraded

    def teardown(self) -> None:
        """Tear the agent down."""
        self._end()

    def _make(self, memory: Memory) -> Agent:
        return make_agent(
            self.hosts, name=self.name, config=self.config.agent, bus=self.bus, keys=self.keys, clock=self.clock,
            memory=memory, seed=self.seed,
        )  # fmt: skip

    def _end(self) -> None:
        agent, self._agent = getattr(self, "_agent", None), None
        if agent is not None:
            agent.teardown()

    def _make_output(self) -> Memory:
        """The overlay: the one that is there, or a new one. Raises `ConfigError` if another kind of world is there."""
        parent = self.inputs[0]
        known = next((info for info in self.memory.worlds() if info.name == self.output), None)
        if known is None:
            return self.memory.fork(self.output, of=parent, follow=True)
        if not known.follows or known.parent != parent:
            raise ConfigError(f"world {self.output!r} is there already, and no overlay of {parent!r}: delete it first")
        return self.memory.create_world(self.output, exist_ok=True)
