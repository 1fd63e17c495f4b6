"""Waits until all things of a goal are believed to be somewhere, says which are missing and why, and looks for them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dsr.errors import suggest
from dsr.memory import Memory
from dsr.network.keys import agent_of
from dsr.vocabulary.goals import Goal
from dsr.vocabulary.intentions import FAILED, INVALID, WAITING
from dsr.vocabulary.relations import SURFACES, THINGS, is_present, read_relations
from dsr.vocabulary.tags import tag_of
from planner.arm import Script, Tell
from planner.arms import Arms
from planner.config import PlannerConfig
from planner.errors import GivingUp
from planner.looking import Search

_UNKNOWN = "never seen or heard of"
"""Reason why a thing is nowhere whose name no node has"""


def known_names(memory: Memory) -> set[str]:
    """Names of all that a goal can be about, believed to be somewhere or not."""
    return {node.name for kind in (*THINGS, *SURFACES) for node in memory.nodes(kind)}


def may_appear(memory: Memory, name: str) -> bool:
    """Whether a name that no node has may get one: by a tag that nobody knows, or because nothing is known so far."""
    tag = tag_of(name)
    if not known_names(memory):
        return True
    return tag is not None and all(node.get("marker_id") != tag for node in memory.nodes(THINGS))


def running_agents(memory: Memory) -> set[str]:
    """Names of the agents that run."""
    return {agent_of(rid) for rid in memory.peers}


class Waiting:
    """Waits until the things of an intention's goal are believed to be somewhere, and the agents run that believe.

    Args:
        memory: the graph.
        config: names and times.
        now: gives the time, s.
        tell: says in the graph what is waited for.
        looking: moves the arm's camera.
    """

    def __init__(
        self, memory: Memory, config: PlannerConfig, now: Callable[[], float], tell: Tell, looking: Search
    ) -> None:
        self._memory, self._config, self._now, self._tell = memory, config, now, tell
        self._looking = looking
        self._arms = Arms(memory, config)
        self._believed: set[str] = set()  # what once was
        self._lacks = False

    @property
    def is_blocked(self) -> bool:
        """Whether the intention waits for a thing, or for an agent."""
        return self._lacks or bool(self.missing_agents())

    def missing_agents(self) -> list[str]:
        """Names of the agents that must run before an action begins, and do not."""
        arms = [] if self._arms.is_any_there else [self._arms.all()[0].agent]
        return [*arms, *self._away(self._config.belief_agents)]

    def tell_missing(self) -> None:
        """Say who they are."""
        self._tell(WAITING, _not_running(self.missing_agents()))

    def lacking(self, goal: Goal) -> list[str]:
        """Names in the goal of things that are not believed to be anywhere."""
        relations = read_relations(self._memory)
        known = relations.things | relations.tables
        self._believed |= known
        lacking = [name for name in goal.things if name not in known]
        self._lacks = bool(lacking)
        return lacking

    def until_there(self, goal: Goal) -> Script:
        """Wait until everything is believed to be somewhere, and have the arm look for it.

        Raises:
            GivingUp: at once for a name that nothing has or may get, else when time is up.
        """
        waited, last, looked = 0.0, self._now(), False
        while lacking := self.lacking(goal):
            self._check_names(lacking)
            away, now = self.missing_agents(), self._now()
            waited, last = waited + (0.0 if self._away(self._config.belief_agents) else now - last), now
            limit = self._config.patience if self._is_started() else self._config.start_up
            why = self._why(lacking)
            if waited > limit:
                raise GivingUp(FAILED, f"{why}; {self._tried(waited)}")
            self._tell(WAITING, f"{why}; {_not_running(away) if away else f'gives up after {limit:g} s'}")
            if self._is_started() and not looked and not away and waited >= self._config.explained:
                yield from self._looking.look(lambda: bool(self.lacking(goal)), why)
                looked = True
            yield

    def _tried(self, waited: float) -> str:
        """What has been done to find things."""
        if problem := self._looking.problem:
            return f"waited {waited:.0f} s, and cannot look for it: {problem}"
        return f"waited {waited:.0f} s, and looked from {self._looking.places} places"

    def _check_names(self, lacking: list[str]) -> None:
        for name in lacking:
            hopeless = name not in self._memory and name not in self._believed
            if hopeless and not may_appear(self._memory, name):
                raise GivingUp(INVALID, f"nothing is called {name!r}; {suggest(name, known_names(self._memory))}")

    def _is_started(self) -> bool:
        """Whether anything at all is believed to be somewhere."""
        return bool(read_relations(self._memory).things)

    def _why(self, lacking: list[str]) -> str:
        """Why things are not believed to be anywhere; those with the same reason together."""
        reasons: dict[str, list[str]] = {}
        for name in sorted(lacking, key=lambda name: name not in self._memory):
            reasons.setdefault(self._reason(name), []).append(name)
        texts = [f"{reason}: {', '.join(names)}" for reason, names in reasons.items()]
        unknown = reasons.get(_UNKNOWN, []) if self._is_started() else []
        known = known_names(self._memory)
        return ", ".join(texts) + "".join(f" ({suggest(name, known)})" for name in unknown[:1])

    def _reason(self, name: str) -> str:
        node = self._memory.get_node(name)
        if node is None:
            return "removed from the graph" if name in self._believed else _UNKNOWN
        if not is_present(node):
            return "believed to be gone"
        if name in self._believed:
            return "no longer known where"
        return "seen, but not believed to be anywhere" if self._memory.edges("RT", dst=name) else "never seen"

    def _away(self, agents: Iterable[str]) -> list[str]:
        running = running_agents(self._memory)
        return [agent for agent in agents if agent not in running]


def _not_running(agents: list[str]) -> str:
    names = ", ".join(map(repr, agents))
    return f"agent {names} does not run" if len(agents) == 1 else f"agents {names} do not run"
