"""The keys under which everything of one graph and its worlds travels (PROTOCOL: `dsr/v1/<graph>/...`)."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from functools import lru_cache

from dsr.errors import ConfigError

PROTOCOL = "dsr/v1"
BASE = "base"
"""The world that a system is launched with: its graph."""
WHOLE = ""
"""The part of the base that each process holds: what is in no other part."""
ALL = "*"
"""Stands in an interest for all parts that are listed, and those that will be."""
_NAME = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")
_PART = re.compile(r"[A-Za-z0-9_]{1,64}")

_KEY = re.compile(r"[A-Za-z0-9_.-]{1,256}(/[A-Za-z0-9_.-]{1,256}){0,8}")


def check_name(kind: str, name: str) -> str:
    """Return `name` if it can be a part of a key, else raise `ConfigError`."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ConfigError(f"{kind} {name!r}: expected 1 to 64 letters, digits, '_', '-' or '.', the first not a '.'")
    return name


def is_key(text: str) -> bool:
    """Whether `text`, which may come from anywhere, names one key: parts between slashes, no wildcards."""
    return _KEY.fullmatch(text) is not None


def agent_of(rid: str) -> str:
    """The agent whose replica has the id `rid`: the part before the boot nonce."""
    return rid.rpartition("-")[0]


def check_part(name: str) -> str:
    """Return `name` if a part of a graph can be called so, else raise `ConfigError`: replica ids hold it."""
    if not isinstance(name, str) or not _PART.fullmatch(name):
        raise ConfigError(f"part {name!r}: expected 1 to 64 letters, digits or '_'")
    return name


def check_interest(names: Iterable[str]) -> tuple[str, ...]:
    """The names of an interest, each once. Raises `ConfigError` for one that no part has; `ALL` stands for all."""
    listed = (names,) if isinstance(names, str) else tuple(dict.fromkeys(names))
    return tuple(name if name == ALL else check_part(name) for name in listed)


@lru_cache(maxsize=1 << 14)
def part_of(rid: str) -> str:
    """The part of the graph to which all dots of replica `rid` belong; `WHOLE` for a replica of the base itself.

    An id of a part is `<agent>-<part>.<nonce>`, and no nonce of another one holds a '.'.
    """
    _, agent, rest = rid.rpartition("-")
    part, dot, _ = rest.partition(".")
    return part if agent and dot else WHOLE


def part_rid(rid: str, part: str, number: int) -> str:
    """The id under which the process of replica `rid` takes part in `part`, for the time with this `number`."""
    nonce = hashlib.blake2b(f"{rid}/{part}/{number}".encode(), digest_size=4).hexdigest()
    return f"{agent_of(rid)}-{part}.{nonce}"


def without_part(topic: str) -> str:
    """A topic below the graph's root without the part of the graph to which it belongs: replica ids name that, too."""
    return topic.split("/", 2)[2] if topic.startswith("part/") and topic.count("/") > 1 else topic


def descriptor_key(key: str) -> str:
    """Key of the descriptors of large messages of `key` (`bulk.py`); no wildcard matches a part that begins with @."""
    return f"{key}/@shm"


class Keys:
    """Key builder of one graph; each method names one kind of traffic.

    Args:
        graph: name of the graph.
        world: which of its worlds; only the keys of replicas depend on it, all else belongs to the whole system.
        channel: where replicas of that world meet (see dsr/worlds/registry.py); nothing for the base.
        part: which part of the base (see dsr/parts); what is in no part if empty.
    """

    def __init__(self, graph: str, world: str = BASE, channel: str = "", *, part: str = WHOLE) -> None:
        self.graph = check_name("graph name", graph)
        self.world = check_name("world name", world)
        self.root = f"{PROTOCOL}/{graph}"
        self.state = self.root if world == BASE else f"{self.root}/world/{world}/{check_name('channel', channel)}"
        """Root of what replicas tell each other."""
        if part:
            self.state = f"{self.root}/part/{check_part(part)}"
        self.part = part if world == BASE else None
        """The part of which all dots are that travel under these keys; None in a world, which has dots of any part."""

    def delta(self, rid: str = "*") -> str:
        """Durable changes of replica `rid`."""
        return f"{self.state}/d/{rid}"

    def of_all_parts(self, pattern: str) -> str:
        """A pattern of this class for what is in no part, as the pattern for all parts of the graph."""
        return f"{self.root}/part/*/{pattern.removeprefix(f'{self.root}/')}"

    def stream(self, rid: str = "*") -> str:
        """Bundles of high-rate values of replica `rid`."""
        return f"{self.state}/rt/{rid}"

    def digest(self, rid: str = "*") -> str:
        """Key on which replica `rid` publishes its digest."""
        return f"{self.state}/dig/{rid}"

    def sync(self, rid: str = "*") -> str:
        """Key on which replica `rid` answers requests for missing changes."""
        return f"{self.state}/sync/{rid}"

    def presence(self, agent: str = "*", rid: str = "*") -> str:
        """Liveliness token of a replica of this world; in the base, that of the process."""
        return f"{self.state}/live/{agent}/{rid}"

    def blob(self, name: str) -> str:
        """Frames named `name` (may contain slashes)."""
        return f"{self.root}/blob/{name}"

    @property
    def place(self) -> str:
        """What these keys are about, such as `part/kitchen`: below the graph's root, that of what replicas tell."""
        return self.state.removeprefix(f"{self.root}/")

    def holders(self, rid: str = "*") -> str:
        """Key on which the process of replica `rid` answers who asks which worlds and parts it holds."""
        return f"{self.root}/holders/{rid}"

    def mesh(self, rid: str = "*") -> str:
        """Key on which replica `rid` answers requests for meshes."""
        return f"{self.root}/mesh/{rid}"

    def live(self, agent: str = "*", rid: str = "*") -> str:
        """Liveliness token of a process: of its replica of the base."""
        return f"{self.root}/live/{agent}/{rid}"

    def status(self, agent: str = "*") -> str:
        """State, rate, latency and last error of an agent, at 1 Hz."""
        return f"{self.root}/status/{agent}"

    def log(self, agent: str = "*") -> str:
        """Log records of an agent."""
        return f"{self.root}/log/{agent}"

    def device(self, name: str) -> str:
        """Traffic between a driver and its device, e.g. `arm/state` (outside the graph)."""
        return f"{self.root}/device/{name}"

    def service(self, name: str) -> str:
        """Key on which requests of the service `name` are answered, e.g. `what_if`."""
        return f"{self.root}/service/{name}"

    def truth(self) -> str:
        """Ground truth of a simulated reality: for judges and recordings, never for agents."""
        return f"{self.root}/truth"
