"""The policy of a security folder: the grant of each agent, read from and written to `policy.json`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import msgspec

from dsr.agent import Agent
from dsr.config.toml import convert
from dsr.errors import ConfigError, suggest
from dsr.files.data_files import read_text
from dsr.graph.access import EVERYTHING, Access, WriteGuard
from dsr.network.keys import check_name, check_part
from dsr.runtime.system import System
from dsr.vocabulary.halting import HALT_ATTRIBUTES, HALT_NODE, HALTER
from dsr.vocabulary.proposed_acts import CONFIRMER, DECISIONS

LAUNCHER = "launcher"
READER = "dsr"
"""The command line tools: they only read."""

_OWN_TRAFFIC = ("d", "rt", "dig", "sync", "mesh", "holders", "live", "status", "log", "world", "part")
"""First parts of the keys that each agent has for itself."""
_BUS_KEY = re.compile(r"[A-Za-z0-9_.-]+(/([A-Za-z0-9_.-]+|\*))*(/\*\*)?")


class Grant(msgspec.Struct, frozen=True, omit_defaults=True):
    """The permissions of one agent besides reading everything."""

    nodes: tuple[str, ...] = ()
    """Node types that it may create, write and remove; "*" for all."""
    edges: tuple[str, ...] = ()
    """Edge types that the agent may write; the pose of an edge needs no further grant."""
    attributes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()
    """Keys of the bus outside the graph, below the graph's root: `device/arm/command`, `blob/**`."""
    parts: tuple[str, ...] = ("*",)
    """Parts of the graph (dsr/parts) in which the agent may write and answer; "*" for all."""
    read_only: bool = False
    """Whether the agent may send nothing at all."""
    trusted: bool = False
    """Whether others believe the agent's claims about third ones: it hands the whole graph on to newcomers and repairs
    losses.
    """
    relay: bool = False
    """Whether the agent passes on messages of others, on their keys: a router between machines."""

    @property
    def writes(self) -> Access:
        """The part that concerns the graph."""
        return Access(self.nodes, self.edges, self.attributes)

    def includes_part(self, name: str) -> bool:
        """Whether it may write into the part `name`; all may write into what is in no part."""
        return not name or name in self.parts or EVERYTHING in self.parts


class AccessPolicy(msgspec.Struct, frozen=True):
    """The grants by agent name; whoever is not listed may nothing, not even read."""

    agents: dict[str, Grant]

    def grant(self, agent: str) -> Grant:
        """Look up the grant of `agent`. Raises `ConfigError` if the policy does not list it."""
        if agent not in self.agents:
            hint = suggest(agent, self.agents)
            raise ConfigError(f"agent {agent!r} has no certificate; {hint}; make one with: dsr security add")
        return self.agents[agent]

    def guards(self) -> dict[str, WriteGuard]:
        """Make a guard of the writes of each agent that may write, by agent."""
        return {name: WriteGuard(name, grant.writes) for name, grant in self.agents.items() if not grant.read_only}


def grant_for(kind: type[Agent]) -> Grant:
    """Make the grant that an agent of class `kind` declares."""
    writes = kind.writes
    return Grant(tuple(writes.nodes), tuple(writes.edges), tuple(writes.attributes), tuple(kind.publishes))


def system_grants(system: System) -> dict[str, Grant]:
    """Grants for the agents of a system, its launcher and the command line tools."""
    grants = {spec.name: grant_for(spec.kind) for spec in system.agents}
    return {**grants, **standard_grants()}


def standard_grants() -> dict[str, Grant]:
    """Grants for those that every system has: launcher, command line tools, emergency stop, who confirms acts."""
    return {
        LAUNCHER: Grant(publishes=("device/**",), trusted=True),
        READER: Grant(read_only=True),
        HALTER: Grant((HALT_NODE,), (), HALT_ATTRIBUTES, ("device/halt",)),
        CONFIRMER: Grant(publishes=(f"service/{DECISIONS}",)),
    }


def read_policy(file: Path) -> AccessPolicy:
    """The policy in `file`. Raises `ConfigError`, also for one that contradicts itself."""
    try:
        data = msgspec.json.decode(read_text(file))
    except (ConfigError, msgspec.MsgspecError) as error:
        raise ConfigError(f"no security policy can be read ({error}); make one with: dsr security init",
                          file=str(file)) from error  # fmt: skip
    return checked(convert(data, AccessPolicy, str(file)).agents)


def write_policy(file: Path, policy: AccessPolicy) -> None:
    """Write `policy` so that people can read it."""
    file.write_bytes(msgspec.json.format(msgspec.json.encode(policy), indent=2) + b"\n")


def checked(agents: Mapping[str, Grant]) -> AccessPolicy:
    """The policy with these grants. Raises `ConfigError` unless names and keys can be told apart."""
    for name, grant in agents.items():
        check_name("agent name", name)
        for other in agents:
            if other.startswith(f"{name}-"):
                raise ConfigError(f"agents {name!r} and {other!r}: no name may be another's followed by '-'")
        for key in grant.publishes:
            if not _BUS_KEY.fullmatch(key) or key.split("/")[0] in _OWN_TRAFFIC:
                raise ConfigError(f"agent {name!r} publishes {key!r}: expected a key such as 'device/arm/command', "
                                  f"'blob/**', that does not begin with {', '.join(_OWN_TRAFFIC)}")  # fmt: skip
        for part in grant.parts:
            if part != EVERYTHING:
                check_part(part)
        if (grant.read_only or grant.relay) and grant not in (Grant(read_only=True), Grant(relay=True)):
            raise ConfigError(f"agent {name!r} is {'read-only' if grant.read_only else 'a relay'}, but may do more")
    return AccessPolicy(dict(agents))
